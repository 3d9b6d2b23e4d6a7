// A drawing of the page as a separate SVG file: visible colours, title and a key to the colours.
const figureSvg = (() => {
  const FONT = "system-ui, 'Segoe UI', Roboto, Arial, sans-serif";
  const [HEAD, INCH] = [34, 72];
  const KEYS = ["line", "outline", "bins", "dots", "range", "mark", "floor"];

  function resolveColours(node, style) {
    for (const { name, value } of [...node.attributes])
      if (value.includes("var(")) node.setAttribute(name, value.replace(/var\((--[\w-]+)\)/g, (_, variable) => style.getPropertyValue(variable).trim()));
    for (const child of node.children) resolveColours(child, style);
  }

  // [name, colour] of the lines that a reader must distinguish.
  function legend(chart) {
    const keys = new Map();
    for (const { kind, label, colour } of chart.traces) {
      const name = label.replace(/ (mean|points)$|: points$/, "");
      if (KEYS.includes(kind) && !keys.has(name)) keys.set(name, colour);
    }
    return keys.size <= 8 ? [...keys] : [];
  }

  function standalone(svg, chart) {
    const copy = svg.cloneNode(true);
    for (const own of copy.querySelectorAll(".ring, .part")) own.remove();
    const [left, top, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    for (const name of ["class", "tabindex"]) copy.removeAttribute(name);
    const title = element.svg("text", { x: left + 6, y: top - HEAD + 13, "font-size": 10.5, "font-weight": 600, fill: "var(--ink)" }, chart.title);
    const keys = legend(chart).map(([name, colour], place) => element.svg("tspan", { fill: `var(${colour})`, dx: place > 0 ? 8 : 0 }, `■ ${name}`));
    const key = element.svg("text", { x: left + 6, y: top - HEAD + 27, "font-size": 8.5 }, keys);
    const box = { x: left, y: top - HEAD, width, height: height + HEAD };
    const attributes = {
      xmlns: "http://www.w3.org/2000/svg", viewBox: Object.values(box).join(" "), role: "img", "font-family": FONT,
      width: `${(width / INCH).toFixed(2)}in`, height: `${(box.height / INCH).toFixed(2)}in`,
    };
    for (const [name, value] of Object.entries(attributes)) copy.setAttribute(name, value);
    copy.prepend(element.svg("title", {}, chart.title), element.svg("desc", {}, svg.getAttribute("aria-label") ?? ""),
      element.svg("rect", { ...box, fill: "var(--paper)" }), title, key);
    resolveColours(copy, getComputedStyle(document.documentElement));
    return new XMLSerializer().serializeToString(copy);
  }
  return { standalone };
})();
