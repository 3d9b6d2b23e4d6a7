// Figures: a tip describes the point under the pointer, a click or Enter shows the runs behind it, and each figure is
// saved as SVG and CSV. An element after each drawing holds its numbers and the position of its axes.
const figures = (() => {
  const NEAR = 14; // in units of the drawing, 72 per inch
  const ring = element.svg("circle", { r: 5, class: "ring" });
  const tip = element("div", { class: "tip", role: "status", hidden: true });
  let shown = null;
  document.body.append(tip);

  const svgOf = (figure) => figure.querySelector("svg.plot");

  function chartOf(figure) {
    const node = figure.querySelector("script.drawn");
    if (!figure.chart && node) setChart(figure, JSON.parse(node.textContent));
    return figure.chart;
  }

  function setChart(figure, chart) {
    figure.chart = chart;
    const [left, top, width, height] = chart.box;
    const inside = ([x, y]) => x > left - 1 && x < left + width + 1 && y > top - 1 && y < top + height + 1;
    figure.points = chartScale.points(chart).filter(({ trace, at }) =>
      (trace.kind !== "floor" || trace.y.length > 2) && (chart === figure.whole?.chart || !figure.shownPart || inside(at)) && !chartView.isHidden(figure, trace.label));
    if (shown?.figure === figure) hide();
  }

  function runsOf(chart, trace, index) {
    if (!trace.runs) return null;
    const run = chart.runs[trace.runs.length === 1 ? trace.runs[0] : trace.runs[index]];
    return trace.steps ? { ...run, step: trace.steps[index] } : run;
  }

  // The runs of a point, or of another point of its row: a printed number shares its row with the measured value.
  function behind({ chart, points }, { trace, index }) {
    const own = runsOf(chart, trace, index);
    if (own || !chart.y.rows) return own;
    const neighbour = points.find((point) => point.trace.runs && point.trace.y[point.index] === trace.y[index]);
    return neighbour ? runsOf(chart, neighbour.trace, neighbour.index) : null;
  }

  function nearest(figure, event) {
    const matrix = svgOf(figure).getScreenCTM();
    if (!matrix) return null;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    let best = null;
    let least = NEAR * NEAR;
    // the pointer selects a row over its full width, its name included
    const weight = figure.chart.y.rows ? 1e-3 : 1;
    for (const point of figure.points) {
      // a thick line lies above thin ones
      const bias = point.trace.kind === "thin" ? 4 : 0;
      const far = weight * (point.at[0] - x) ** 2 + (point.at[1] - y) ** 2 + bias;
      if (far < least) [best, least] = [point, far];
    }
    return best;
  }

  function lines(chart, { trace, index }) {
    const upTo = (high) => (high ? ` to ${numbers.brief(high[index])}` : "");
    const x = `${numbers.brief(chartScale.xs(chart, trace)[index])}${upTo(trace.x_high)}`;
    const step = trace.steps && !/step/.test(chart.x.label) ? [`step ${numbers.grouped(trace.steps[index])}`] : [];
    if (chart.y.rows) return [`${chart.y.rows[Math.round(trace.y[index])]}${upTo(trace.y_high)}: ${trace.label}`, x, ...step];
    return [trace.label, `${chart.y.label}: ${numbers.brief(trace.y[index])}${upTo(trace.y_high)}`, `${chart.x.label}: ${x}`, ...step];
  }

  function show(figure, point) {
    if (shown?.figure === figure && shown.point === point) return;
    hide();
    if (!point) return;
    shown = { figure, point };
    const svg = svgOf(figure);
    const [x, y] = point.at;
    ring.setAttribute("cx", x);
    ring.setAttribute("cy", y);
    ring.style.stroke = `var(${point.trace.colour})`;
    svg.append(ring);
    const opens = behind(figure, point) !== null;
    const whose = runsOf(figure.chart, point.trace, point.index) ? "the runs behind it" : "the runs that were measured here";
    svg.classList.toggle("open", opens);
    const [first, ...rest] = lines(figure.chart, point);
    tip.replaceChildren(element("b", {}, first), ...rest.map((line) => element("span", {}, line)), opens ? element("i", {}, `click: ${whose}`) : "");
    tip.hidden = false;
    const at = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    const room = document.documentElement.clientWidth - tip.offsetWidth - 8;
    const above = at.y - tip.offsetHeight - 12;
    tip.style.left = `${Math.min(Math.max(8, at.x + 12), room) + scrollX}px`;
    tip.style.top = `${(above < 0 ? at.y + 14 : above) + scrollY}px`;
  }

  function hide() {
    if (!shown) return;
    svgOf(shown.figure).classList.remove("open");
    ring.remove();
    tip.hidden = true;
    shown = null;
  }

  function select(figure, point) {
    const selection = point && behind(figure, point);
    if (selection) runs.open(selection, svgOf(figure));
  }

  // Left and right along a line, up and down from line to line.
  function move(figure, key) {
    const traces = [...new Set(figure.points.map(({ trace }) => trace))];
    if (traces.length === 0) return;
    const of = (trace) => figure.points.filter((point) => point.trace === trace);
    if (shown?.figure !== figure) return show(figure, of(traces.find(({ kind }) => kind === "line") ?? traces[0])[0]);
    const now = shown.point;
    const own = of(now.trace);
    const place = own.indexOf(now);
    const to = { ArrowRight: place + 1, ArrowLeft: place - 1, Home: 0, End: own.length - 1 }[key];
    if (to !== undefined) return show(figure, own[Math.min(Math.max(to, 0), own.length - 1)]);
    const line = traces.indexOf(now.trace) + (key === "ArrowDown" ? 1 : -1);
    const far = (point) => Math.abs(point.at[0] - now.at[0]);
    return show(figure, of(traces.at(line % traces.length)).reduce((best, point) => (far(point) < far(best) ? point : best)));
  }

  // A row per point or bin: its line, its numbers, and its run if it belongs to a single run.
  function csv(chart) {
    const has = (name) => chart.traces.some((trace) => trace[name]);
    const bins = chart.traces.some(({ kind }) => kind === "bins");
    const y = chart.y.rows ? "row" : chart.y.label;
    const columns = [
      ["series", (trace) => trace.label],
      [bins ? "from" : chart.x.label, (trace, index) => chartScale.xs(chart, trace)[index]],
      ...(bins ? [["to", (trace, index) => trace.x_high?.[index]]] : []),
      [y, (trace, index) => chart.y.rows?.[Math.round(trace.y[index])] ?? trace.y[index]],
      ...(has("x_high") && !bins ? [[`${chart.x.label} up to`, (trace, index) => trace.x_high?.[index]]] : []),
      ...(has("y_high") ? [[`${y} up to`, (trace, index) => trace.y_high?.[index]]] : []),
      ...(has("steps") ? [["step", (trace, index) => trace.steps?.[index]]] : []),
      ...["scene", "method", "against", "seed"].filter((key) => chart.runs?.some((run) => key in run))
        .map((key) => [key, (trace, index) => runsOf(chart, trace, index)?.[key]]),
    ];
    const rows = chart.traces.flatMap((trace) => trace.y.map((_, index) => columns.map(([, of]) => of(trace, index))));
    return download.csv([columns.map(([name]) => name), ...rows]);
  }

  // The section, the last heading above (several headings have figures of the same scene) and the figure's own title.
  function titleOf(figure, own) {
    const section = figure.closest("section");
    const above = (node) => node.compareDocumentPosition(figure) & Node.DOCUMENT_POSITION_FOLLOWING;
    const heading = [...(section?.querySelectorAll("h3, h4") ?? [])].filter(above).pop();
    return [section?.querySelector("h2")?.textContent, heading?.textContent, own].filter(Boolean)
      .map((text) => text.replace(/\s+/g, " ").trim()).join(": ");
  }

  function addSave(figure, title, kind, forms) {
    (figure.querySelector("figcaption") ?? figure).append(menu.button(`Save the ${kind}: ${title}`, () => forms));
  }

  function enhance(figure) {
    const svg = svgOf(figure);
    const title = titleOf(figure, figure.querySelector("figcaption")?.textContent);
    addSave(figure, title, "figure", [
      ["SVG", () => download.save(title, "svg", figureSvg.standalone(svg, chartOf(figure)), "image/svg+xml")],
      ["CSV", () => download.save(title, "csv", csv(chartOf(figure)), "text/csv")],
    ]);
    chartView.enhance(figure, chartOf);
    svg.tabIndex = 0;
    svg.addEventListener("pointermove", (event) => chartOf(figure) && show(figure, nearest(figure, event)));
    svg.addEventListener("pointerleave", hide);
    svg.addEventListener("blur", hide);
    svg.addEventListener("click", (event) => chartOf(figure) && select(figure, nearest(figure, event)));
    svg.addEventListener("keydown", (event) => {
      const moves = /^(Arrow|Home|End)/.test(event.key) && chartOf(figure);
      if (event.key === "Enter" && shown?.figure === figure) select(figure, shown.point);
      if (moves) move(figure, event.key);
      if (moves || (event.key === "Escape" && shown)) event.preventDefault();
      if (event.key === "Escape") hide();
    });
  }

  // The scene and the method of a figure, if all its runs share them.
  function about(figure) {
    const every = chartOf(figure)?.runs ?? [];
    const only = (name) => (every.every((run) => run[name] === every[0][name]) ? every[0]?.[name] : null);
    return { scene: only("scene"), method: only("method") };
  }

  const all = () => [...document.querySelectorAll("figure:has(script.drawn)")];

  // The place of the point that the tip describes, if it is in this figure.
  const pointed = (figure) => (shown?.figure === figure ? shown.point.at : null);

  function start() {
    all().forEach(enhance);
    chartView.startLegends();
    for (const image of document.querySelectorAll("figure > img[src^='data:image/png']")) {
      const title = titleOf(image.parentElement, image.alt);
      addSave(image.parentElement, title, "picture", [["PNG", () => download.saveFrom(title, "png", image.src)]]);
    }
  }
  return { start, all, about, enhance, setChart, chartOf, pointed };
})();
