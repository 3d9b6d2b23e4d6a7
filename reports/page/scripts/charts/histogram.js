// A histogram drawn here: outlines over the same bins, redrawn in place so that it can move.
const histogram = (() => {
  const [WIDTH, HEIGHT] = [266, 187];
  const BOX = [42, 9, 216, 142];
  const FOOT = 1e-5 / 1.6; // where the axis of shares begins: smaller ones are drawn on it, so that empty bins have a place

  // As the printed drawings choose it: even bins lie on a linear axis, others on a logarithmic one, through 0 if need be.
  function axisOf(edges) {
    const widths = edges.slice(1).map((high, place) => high - edges[place]);
    const [low, high] = [edges[0], edges[edges.length - 1]];
    if (Math.max(...widths) < 3 * Math.min(...widths)) return { scale: "linear", low, high };
    if (low > 0) return { scale: "log", low, high };
    return { scale: "symlog", low, high, linear_below: Math.min(...edges.filter((edge) => edge !== 0).map(Math.abs)) };
  }

  function ticks(axis) {
    if (axis.scale === "linear") {
      const step = 10 ** Math.floor(Math.log10(axis.high - axis.low)) / 2;
      const many = Math.floor((axis.high - axis.low) / step + 1e-9);
      const every = Math.ceil(many / 5);
      return Array.from({ length: Math.floor(many / every) + 1 }, (_, place) => axis.low + place * every * step);
    }
    const lowest = axis.scale === "symlog" ? axis.linear_below : axis.low;
    const [from, to] = [Math.ceil(Math.log10(lowest) - 1e-9), Math.floor(Math.log10(axis.high) + 1e-9)];
    const every = Math.ceil((to - from) / 5) || 1;
    const powers = [];
    for (let power = to; power >= from; power -= every) powers.unshift(10 ** power);
    return axis.scale === "symlog" ? [0, ...powers.slice(axis.linear_below < 10 ** from ? 0 : 1)] : powers;
  }

  function label(value) {
    const power = Math.log10(value);
    if (value !== 0 && Number.isInteger(Math.round(power * 1e6) / 1e6) && (value < 0.01 || value > 999)) {
      const raised = [...String(Math.round(power))].map((one) => (one === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[one])).join("");
      return `10${raised}`;
    }
    return String(Number(value.toPrecision(3)));
  }

  // A chart as the page's other drawings have it: `sides` are [[label, colour, shares], …], up to `most`.
  function chart(title, edges, sides, most, behind) {
    const traces = sides.map(([name, colour, shares], place) => ({
      label: name, kind: "bins", colour, x: place === 0 ? edges.slice(0, -1) : 0, x_high: edges.slice(1), y: shares, runs: [0],
    }));
    return {
      title, box: BOX, x: { label: "density σ", ...axisOf(edges) }, y: { label: "share of points", scale: "log", low: FOOT, high: most * 1.6 },
      traces, runs: [behind],
    };
  }

  function frame(chart) {
    const to = chartScale.of(chart);
    const [left, top, width, height] = chart.box;
    const line = (x1, y1, x2, y2, colour) => element.svg("line", { x1, y1, x2, y2, stroke: `var(${colour})`, "stroke-width": 0.8 });
    const text = (x, y, words, further = {}) => element.svg("text", { x, y, fill: "var(--muted)", "font-size": 9, "text-anchor": "middle", ...further }, words);
    const inside = (place, low, high) => place > low - 0.5 && place < high + 0.5;
    const across = ticks(chart.x).filter((at) => inside(to.x(at), left, left + width));
    const up = ticks(chart.y).filter((at) => inside(to.y(at), top, top + height));
    return [
      ...across.flatMap((at) => [line(to.x(at), top, to.x(at), top + height, "--rule"), text(to.x(at), top + height + 12, label(at))]),
      ...up.flatMap((at) => [line(left, to.y(at), left + width, to.y(at), "--rule"), text(left - 4, to.y(at) + 3, label(at), { "text-anchor": "end" })]),
      line(left, top, left, top + height, "--muted"), line(left, top + height, left + width, top + height, "--muted"),
      text(left + width / 2, top + height + 27, chart.x.label),
      text(10, top + height / 2, chart.y.label, { transform: `rotate(-90 10 ${top + height / 2})` }),
      ...chart.traces.map((trace) => element.svg("path", { fill: "none", stroke: `var(${trace.colour})`, "stroke-width": 1.6 })),
    ];
  }

  function outline(chart, trace) {
    const to = chartScale.of(chart);
    const start = to.x(chartScale.xs(chart, trace)[0]).toFixed(1);
    const steps = trace.y.map((share, place) => `${place > 0 ? "V" : ""}${chartScale.heightOf(chart, to, share).toFixed(1)}H${to.x(trace.x_high[place]).toFixed(1)}`);
    return `M${start} ${steps.join("")}`;
  }

  // Draws into `svg`, anew only where the axes are others.
  function draw(svg, chart, alt) {
    const axes = JSON.stringify([chart.x, chart.y, chart.traces.map((trace) => trace.colour)]);
    if (svg.dataset.axes !== axes) {
      svg.dataset.axes = axes;
      svg.replaceChildren(...frame(chart));
    }
    const paths = svg.querySelectorAll("path");
    chart.traces.forEach((trace, place) => paths[place].setAttribute("d", outline(chart, trace)));
    svg.setAttribute("aria-label", alt);
  }

  const empty = () => element.svg("svg", { class: "plot", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img" });
  return { chart, draw, empty, FOOT };
})();
