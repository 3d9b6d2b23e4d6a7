// A part of a chart enlarged, and lines hidden: a dragged rectangle or the keys + and − enlarge, 0 shows all again, an
// entry of a legend hides its line. Lines are moved as they were drawn; only their axes are drawn anew.
const chartView = (() => {
  const LEAST = 6; // in units of the drawing; a narrower rectangle selects all of that direction
  const STEP = 0.6;

  const isOf = (name, label) => label === name || [" ", ":", ","].some((sign) => label.startsWith(name + sign));
  const isHidden = (figure, label) => [...(figure.hiddenLines ?? [])].some((name) => isOf(name, label));

  // The complete drawing and its numbers, as they were at first.
  function original(figure) {
    const svg = figure.querySelector("svg.plot");
    const drawn = () => [...svg.childNodes].filter((node) => !node.matches?.(".ring, .part"));
    figure.whole ??= { nodes: drawn().map((node) => node.cloneNode(true)), chart: figure.chart };
    return figure.whole;
  }

  function draw(figure) {
    const svg = figure.querySelector("svg.plot");
    const { nodes, chart } = original(figure);
    const part = figure.shownPart;
    figures.setChart(figure, part ? chartScale.enlarged(chart, part) : chart);
    svg.replaceChildren(...nodes.map((node) => node.cloneNode(true)));
    if (part) enlarge(svg, chart, figure.chart, part);
    for (const { style, dataset } of svg.querySelectorAll("[data-line], [data-end]"))
      if (isHidden(figure, dataset.line ?? dataset.end) || (part && "end" in dataset)) style.display = "none";
    figure.querySelector(".all").hidden = !part;
  }

  function enlarge(svg, { box }, chart, [x, y]) {
    const [left, top, width, height] = box;
    const [wide, high] = [width / (x[1] - x[0]), height / (y[1] - y[0])];
    const to = { x: (value) => left + (value - x[0]) * wide, y: (value) => top + (value - y[0]) * high };
    const clip = svg.querySelector("clipPath")?.id;
    const pixels = svg.getScreenCTM()?.a ?? 1; // of a unit: strokes that are not scaled are in pixels
    for (const axis of svg.querySelectorAll("[data-axis]")) axis.remove();
    for (const line of svg.querySelectorAll("[data-line]")) {
      for (const node of line.querySelectorAll(":scope > path, :scope > g > path, use")) {
        if (node.tagName === "use" && Number(node.getAttribute("x")) !== 0) {
          for (const name of ["x", "y"]) node.setAttribute(name, to[name](Number(node.getAttribute(name))));
          continue;
        }
        node.removeAttribute("clip-path"); // it would be enlarged too
        node.setAttribute("transform", `matrix(${wide} 0 0 ${high} ${to.x(0)} ${to.y(0)})`);
        node.setAttribute("vector-effect", "non-scaling-stroke");
        node.style.strokeWidth *= pixels;
      }
      for (const node of line.querySelectorAll("g[clip-path]")) node.removeAttribute("clip-path");
      if (clip) line.setAttribute("clip-path", `url(#${clip})`);
    }
    svg.prepend(...chartScale.frame(chart));
  }

  // `part`: [[left, right], [top, bottom]] in the complete drawing; null for all of it.
  function show(figure, part) {
    original(figure);
    figure.shownPart = part;
    draw(figure);
  }

  // Enlarges about a point of the present view by a factor; less than 1 shows a smaller part.
  function scale(figure, factor, at) {
    const [left, top, width, height] = figure.chart.box;
    const now = figure.shownPart ?? [[left, left + width], [top, top + height]];
    const middle = at ?? [left + width / 2, top + height / 2];
    const next = now.map(([from, to], place) => {
      const [start, length] = [[left, top][place], [width, height][place]];
      const centre = from + ((middle[place] - start) / length) * (to - from);
      const reach = ((to - from) * factor) / 2;
      return [Math.max(centre - reach, start), Math.min(centre + reach, start + length)];
    });
    const isAll = next.every(([from, to], place) => to - from >= [width, height][place] - 1e-6);
    if (next.every(([from, to]) => to - from > 0.5)) show(figure, isAll ? null : next);
  }

  const canEnlarge = (figure) => Boolean(figure.querySelector("script.drawn")) && !figure.chart.y.rows;

  function enhance(figure, chartOf) {
    const svg = figure.querySelector("svg.plot");
    const all = element.button("all", "show all", () => show(figure, null), { hidden: true });
    (figure.querySelector("figcaption .save") ?? figure.querySelector("figcaption")).before(all);
    let [start, frame, dragged] = [null, null, false];
    const at = (event) => {
      const [left, top, width, height] = figure.chart.box;
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      return [numbers.clamp(x, left, left + width), numbers.clamp(y, top, top + height)];
    };
    const ends = (event) => at(event).map((value, place) => [Math.min(value, start[place]), Math.max(value, start[place])]);
    svg.addEventListener("pointerdown", (event) => {
      chartOf(figure);
      dragged = false;
      if (event.pointerType === "touch" || event.button !== 0 || !canEnlarge(figure)) return;
      start = at(event);
      event.preventDefault(); // selects no text
      svg.focus({ preventScroll: true });
    });
    svg.addEventListener("pointermove", (event) => {
      if (!start) return;
      const [x, y] = ends(event);
      if (!frame && Math.max(x[1] - x[0], y[1] - y[0]) < LEAST) return;
      if (!frame) svg.setPointerCapture(event.pointerId);
      dragged = true;
      frame ??= svg.appendChild(element.svg("rect", { class: "part" }));
      const box = { x: x[0], y: y[0], width: x[1] - x[0], height: y[1] - y[0] };
      for (const [name, value] of Object.entries(box)) frame.setAttribute(name, value);
    });
    const end = (event) => {
      if (frame && event.type === "pointerup") {
        const [left, top, width, height] = figure.chart.box;
        const now = figure.shownPart ?? [[left, left + width], [top, top + height]];
        const into = (value, place) => now[place][0] + ((value - [left, top][place]) / [width, height][place]) * (now[place][1] - now[place][0]);
        show(figure, ends(event).map(([from, to], place) => (to - from < LEAST ? now[place] : [into(from, place), into(to, place)])));
      }
      frame?.remove();
      [start, frame] = [null, null];
    };
    svg.addEventListener("pointerup", end);
    svg.addEventListener("pointercancel", end);
    svg.addEventListener("click", (event) => {
      if (dragged) event.stopImmediatePropagation();
      dragged = false;
    });
    svg.addEventListener("keydown", (event) => {
      const factor = { "+": STEP, "=": STEP, "-": 1 / STEP, "−": 1 / STEP }[event.key];
      if ((!factor && event.key !== "0") || event.ctrlKey || event.metaKey || !chartOf(figure) || !canEnlarge(figure)) return;
      event.preventDefault();
      if (factor) scale(figure, factor, figures.pointed(figure));
      else show(figure, null);
    });
  }

  // The figures that a legend explains: its own and the small ones after it, or all of its section.
  function explained(legend) {
    const own = legend.closest("figure");
    if (!own) return [...(legend.closest("section")?.querySelectorAll("figure:has(script.drawn)") ?? [])];
    const next = own.nextElementSibling;
    return [own, ...(next?.matches(".multiples") ? next.querySelectorAll("figure") : [])];
  }

  // The entries of a legend become buttons that hide and show their lines.
  function startLegends() {
    for (const legend of document.querySelectorAll(".legend")) {
      const some = explained(legend);
      const drawn = some.flatMap((figure) => [...figure.querySelectorAll("[data-line]")].map(({ dataset }) => dataset.line));
      for (const entry of legend.querySelectorAll(":scope > span")) {
        const name = entry.textContent.trim();
        if (!drawn.some((label) => isOf(name, label))) continue;
        const toggle = (event) => {
          const hide = event.currentTarget.getAttribute("aria-pressed") === "true";
          event.currentTarget.setAttribute("aria-pressed", !hide);
          for (const figure of some.filter((each) => figures.chartOf(each))) {
            original(figure);
            figure.hiddenLines ??= new Set();
            figure.hiddenLines[hide ? "add" : "delete"](name);
            draw(figure);
          }
        };
        entry.append(element.button("line", [...entry.childNodes], toggle, { "aria-pressed": "true", title: "hide or show" }));
      }
    }
  }
  return { enhance, startLegends, isHidden };
})();
