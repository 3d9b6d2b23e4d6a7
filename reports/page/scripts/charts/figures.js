// Figures: the point under the pointer says what it is, a click or Enter shows the runs behind it, and each figure is
// saved as SVG and as CSV. The numbers stand beside each drawing, with where its axes lie.
const figures = (() => {
  const NEAR = 14; // of the drawing's units, 72 an inch
  const ring = element.svg("circle", { r: 5, class: "ring" });
  const tip = element("div", { class: "tip", role: "status", hidden: true });
  let shown = null;
  document.body.append(tip);

  function dataOf(figure) {
    const node = figure.querySelector("script.drawn");
    return node ? JSON.parse(node.textContent) : null;
  }

  function chartOf(figure) {
    if (!figure.chart) give(figure, dataOf(figure));
    return figure.chart;
  }

  function give(figure, chart) {
    figure.chart = chart;
    figure.points = chartScale.points(chart).filter(({ trace }) => trace.kind !== "floor" || trace.y.length > 2);
    if (shown?.figure === figure) hide();
  }

  function runsOf(chart, trace, index) {
    if (!trace.runs) return null;
    const one = { ...chart.runs[trace.runs.length === 1 ? trace.runs[0] : trace.runs[index]] };
    return trace.steps ? { ...one, step: trace.steps[index] } : one;
  }

  // Of a point, or of another one of its row: the printed number of a scene stands beside what was measured there.
  function behind(figure, { trace, index }) {
    const own = runsOf(figure.chart, trace, index);
    if (own || !figure.chart.y.rows) return own;
    const beside = figure.points.find((point) => point.trace.runs && point.trace.y[point.index] === trace.y[index]);
    return beside ? runsOf(figure.chart, beside.trace, beside.index) : null;
  }

  function nearest(figure, event) {
    const svg = figure.querySelector("svg.plot");
    const matrix = svg.getScreenCTM();
    if (!matrix) return null;
    const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    let best = null;
    let least = NEAR * NEAR;
    // a row is pointed at over its whole width, its name included
    const beside = figure.chart.y.rows ? 1e-3 : 1;
    for (const point of figure.points) {
      // a thick line lies above thin ones
      const bias = point.trace.kind === "thin" ? 4 : 0;
      const far = beside * (point.at[0] - x) ** 2 + (point.at[1] - y) ** 2 + bias;
      if (far < least) [best, least] = [point, far];
    }
    return best;
  }

  function lines(chart, { trace, index }) {
    const value = (axis, number) => (axis.rows ? axis.rows[Math.round(number)] : numbers.brief(number));
    const x = numbers.brief(chartScale.xs(chart, trace)[index]);
    const to = trace.x_high ? ` to ${numbers.brief(trace.x_high[index])}` : "";
    const up = trace.y_high ? ` to ${numbers.brief(trace.y_high[index])}` : "";
    const step = trace.steps && !/step/.test(chart.x.label) ? [`step ${numbers.grouped(trace.steps[index])}`] : [];
    const y = `${value(chart.y, trace.y[index])}${up}`;
    return [chart.y.rows ? `${y}: ${trace.label}` : trace.label, chart.y.rows ? `${x}${to}` : `${chart.y.label}: ${y}`, ...(chart.y.rows ? [] : [`${chart.x.label}: ${x}${to}`]), ...step];
  }

  function show(figure, point) {
    if (shown && shown.figure === figure && shown.point === point) return;
    hide();
    if (!point) return;
    shown = { figure, point };
    const svg = figure.querySelector("svg.plot");
    const [x, y] = point.at;
    ring.setAttribute("cx", x);
    ring.setAttribute("cy", y);
    ring.style.stroke = `var(${point.trace.colour})`;
    svg.append(ring);
    const opens = behind(figure, point) !== null;
    const whose = runsOf(figure.chart, point.trace, point.index) ? "the runs behind it" : "the runs of what was measured here";
    svg.classList.toggle("open", opens);
    const [first, ...rest] = lines(figure.chart, point);
    tip.replaceChildren(element("b", {}, first), ...rest.map((line) => element("span", {}, line)), opens ? element("i", {}, `click: ${whose}`) : "");
    tip.hidden = false;
    const at = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
    const room = document.documentElement.clientWidth;
    const left = Math.min(Math.max(8, at.x + 12), room - tip.offsetWidth - 8);
    const top = at.y - tip.offsetHeight - 12 < 0 ? at.y + 14 : at.y - tip.offsetHeight - 12;
    tip.style.left = `${left + scrollX}px`;
    tip.style.top = `${top + scrollY}px`;
  }

  function hide() {
    if (!shown) return;
    shown.figure.querySelector("svg.plot").classList.remove("open");
    ring.remove();
    tip.hidden = true;
    shown = null;
  }

  function select(figure, point) {
    const found = point && behind(figure, point);
    if (found) runs.open(found, figure.querySelector("svg.plot"));
  }

  // Left and right along a line, up and down from line to line.
  function move(figure, key) {
    chartOf(figure);
    const traces = [...new Set(figure.points.map(({ trace }) => trace))];
    if (traces.length === 0) return false;
    const now = shown?.figure === figure ? shown.point : null;
    const of = (trace) => figure.points.filter((point) => point.trace === trace);
    if (!now) {
      const first = traces.find((trace) => trace.kind === "line") ?? traces[0];
      show(figure, of(first)[0]);
      return true;
    }
    const own = of(now.trace);
    const place = own.indexOf(now);
    const line = traces.indexOf(now.trace);
    const steps = { ArrowRight: 1, ArrowLeft: -1, Home: -place, End: own.length - 1 - place };
    if (key in steps) show(figure, own[Math.min(Math.max(place + steps[key], 0), own.length - 1)]);
    else {
      const next = of(traces[(line + (key === "ArrowDown" ? 1 : -1) + traces.length) % traces.length]);
      show(figure, next.reduce((best, one) => (Math.abs(one.at[0] - now.at[0]) < Math.abs(best.at[0] - now.at[0]) ? one : best)));
    }
    return true;
  }

  // A row a point or bin: its line, numbers, and the run that it is of, where it is of one.
  function csv(chart) {
    const runKeys = ["scene", "method", "against", "seed"].filter((key) => (chart.runs ?? []).some((one) => key in one));
    const has = (name) => chart.traces.some((trace) => trace[name]);
    const bins = chart.traces.some((trace) => trace.kind === "bins");
    const wide = ["x_high", "y_high"].filter((name) => has(name) && !(bins && name === "x_high"));
    const y = chart.y.rows ? "row" : chart.y.label;
    const head = ["series", ...(bins ? ["from", "to"] : [chart.x.label]), y, ...wide.map((name) => `${name === "x_high" ? chart.x.label : y} up to`),
      ...(has("steps") ? ["step"] : []), ...runKeys];
    const rows = chart.traces.flatMap((trace) => trace.y.map((value, index) => {
      const one = runsOf(chart, trace, index) ?? {};
      const row = chart.y.rows?.[Math.round(value)] ?? value;
      return [trace.label, chartScale.xs(chart, trace)[index], ...(bins ? [trace.x_high?.[index] ?? ""] : []), row, ...wide.map((name) => trace[name]?.[index] ?? ""),
        ...(has("steps") ? [trace.steps?.[index] ?? ""] : []), ...runKeys.map((key) => one[key] ?? "")];
    }));
    return download.csv([head, ...rows]);
  }

  const sectionOf = (figure) => figure.closest("section")?.querySelector("h2")?.textContent ?? "";

  // The last heading above it: the same scene is drawn under several.
  function headingOf(figure) {
    const above = (one) => one.compareDocumentPosition(figure) & Node.DOCUMENT_POSITION_FOLLOWING;
    return [...(figure.closest("section")?.querySelectorAll("h3, h4") ?? [])].filter(above).pop()?.textContent ?? "";
  }

  function titleOf(figure) {
    const caption = figure.querySelector("figcaption")?.cloneNode(true);
    caption?.querySelector(".save")?.remove();
    return [sectionOf(figure), headingOf(figure), caption?.textContent].filter(Boolean).map((text) => text.replace(/\s+/g, " ").trim()).join(": ");
  }

  function enhance(figure) {
    const svg = figure.querySelector("svg.plot");
    const title = titleOf(figure);
    const save = menu.button(`Save the figure: ${title}`, () => [
      ["SVG", () => download.save(title, "svg", figureSvg.standalone(svg, chartOf(figure)), "image/svg+xml")],
      ["CSV", () => download.save(title, "csv", csv(chartOf(figure)), "text/csv")],
    ]);
    (figure.querySelector("figcaption") ?? figure).append(save);
    svg.tabIndex = 0;
    svg.addEventListener("pointermove", (event) => {
      chartOf(figure);
      show(figure, nearest(figure, event));
    });
    svg.addEventListener("pointerleave", hide);
    svg.addEventListener("blur", hide);
    svg.addEventListener("click", (event) => {
      chartOf(figure);
      select(figure, nearest(figure, event));
    });
    svg.addEventListener("keydown", (event) => {
      if (/^(Arrow|Home|End)/.test(event.key) && move(figure, event.key)) event.preventDefault();
      else if (event.key === "Enter" && shown?.figure === figure) select(figure, shown.point);
      else if (event.key === "Escape" && shown) {
        event.preventDefault();
        hide();
      }
    });
  }

  // A picture is saved as it lies in the page.
  function enhancePicture(figure) {
    const image = figure.querySelector("img");
    const title = [sectionOf(figure), image.alt].filter(Boolean).join(": ");
    const save = menu.button(`Save the picture: ${title}`, () => [["PNG", () => download.saveFrom(title, "png", image.src)]]);
    (figure.querySelector("figcaption") ?? figure).append(save);
  }

  // The scenes and methods of a figure, if all of it is of one.
  function about(figure) {
    const every = chartOf(figure)?.runs ?? [];
    const only = (name) => (every.length > 0 && every.every((one) => one[name] && one[name] === every[0][name]) ? every[0][name] : null);
    return { scene: only("scene"), method: only("method") };
  }

  const all = () => [...document.querySelectorAll("figure")].filter((one) => one.querySelector("script.drawn"));

  function start() {
    all().forEach(enhance);
    document.querySelectorAll("figure:has(> img[src^='data:image/png'])").forEach(enhancePicture);
  }
  return { start, all, about, enhance, give };
})();
