// A drawing of the page as a file of its own: colours as they are seen, with its title and a key to its colours.
const figureSvg = (() => {
  const FONT = "system-ui, 'Segoe UI', Roboto, Arial, sans-serif";
  const HEAD = 34;
  const KEYS = ["line", "outline", "bins", "dots", "range", "mark", "floor"];

  function resolved(node, style) {
    for (const { name, value } of [...node.attributes])
      if (value.includes("var(")) node.setAttribute(name, value.replace(/var\((--[\w-]+)\)/g, (_, variable) => style.getPropertyValue(variable).trim()));
    for (const child of node.children) resolved(child, style);
  }

  // [name, colour] of what a reader must tell apart.
  function legend(chart) {
    const keys = new Map();
    for (const { kind, label, colour } of chart.traces) {
      const name = label.replace(/ (mean|points)$|: points$/, "");
      if (KEYS.includes(kind) && !keys.has(name)) keys.set(name, colour);
    }
    return keys.size <= 8 ? [...keys] : [];
  }

  // An <svg> of nobody else's as text on the page's ground; `box` is [left, top, width, height], `unit` of them an inch.
  function file(svg, box, title, description, unit = 72) {
    const [left, top, width, height] = box;
    const attributes = {
      xmlns: "http://www.w3.org/2000/svg", viewBox: box.join(" "), role: "img", "font-family": FONT,
      width: `${(width / unit).toFixed(2)}in`, height: `${(height / unit).toFixed(2)}in`,
    };
    for (const [name, value] of Object.entries(attributes)) svg.setAttribute(name, value);
    const ground = element.svg("rect", { x: left, y: top, width, height, fill: "var(--paper)" });
    svg.prepend(element.svg("title", {}, title), element.svg("desc", {}, description), ground);
    resolved(svg, getComputedStyle(document.documentElement));
    return new XMLSerializer().serializeToString(svg);
  }

  function standalone(svg, chart) {
    const copy = svg.cloneNode(true);
    copy.querySelector(".ring")?.remove();
    const [left, top, width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
    for (const name of ["class", "tabindex"]) copy.removeAttribute(name);
    const words = element.svg("text", { x: left + 6, y: top - HEAD + 13, "font-size": 10.5, "font-weight": 600, fill: "var(--ink)" }, chart.title);
    const keys = legend(chart).map(([name, colour], place) => element.svg("tspan", { fill: `var(${colour})`, dx: place > 0 ? 8 : 0 }, `■ ${name}`));
    const key = element.svg("text", { x: left + 6, y: top - HEAD + 27, "font-size": 8.5 }, keys);
    copy.prepend(words, key);
    return file(copy, [left, top - HEAD, width, height + HEAD], chart.title, svg.getAttribute("aria-label") ?? "");
  }
  return { file, standalone };
})();
