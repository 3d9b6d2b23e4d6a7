// The axes of a chart from its data: places of values and points in the drawing, and the drawn axes.
const chartScale = (() => {
  // Matplotlib's scales; symlog is linear below its threshold.
  function forward(axis) {
    if (axis.scale === "log") return (value) => Math.log10(value);
    if (axis.scale !== "symlog") return (value) => value;
    const inner = axis.linear_below;
    const stretch = 1 / 0.9;
    return (value) => {
      const size = Math.abs(value);
      return size <= inner ? value * stretch : Math.sign(value) * inner * (stretch + Math.log10(size / inner));
    };
  }

  function backward(axis) {
    if (axis.scale === "log") return (place) => 10 ** place;
    if (axis.scale !== "symlog") return (place) => place;
    const [inner, stretch] = [axis.linear_below, 1 / 0.9];
    return (place) => {
      const size = Math.abs(place);
      return size <= inner * stretch ? place / stretch : Math.sign(place) * inner * 10 ** (size / inner - stretch);
    };
  }

  // The axis whose ends are at these shares of the length of another.
  function part(axis, from, to) {
    const [transform, value] = [forward(axis), backward(axis)];
    const [low, high] = [transform(axis.low), transform(axis.high)];
    return { ...axis, low: value(low + from * (high - low)), high: value(low + to * (high - low)) };
  }

  // The chart of a part of its drawing, [[left, right], [top, bottom]].
  function enlarged(chart, [x, y]) {
    const [left, top, width, height] = chart.box;
    const [across, up] = [x.map((at) => (at - left) / width), y.map((at) => 1 - (at - top) / height)];
    return { ...chart, x: part(chart.x, ...across), y: part(chart.y, up[1], up[0]) };
  }

  // Value → place along an axis that begins at `start` and is `length` long.
  function along(axis, start, length) {
    const transform = forward(axis);
    const [low, high] = [transform(axis.low), transform(axis.high)];
    return (value) => start + (length * (transform(value) - low)) / (high - low);
  }

  // {x, y}: value → place in the drawing, y downwards.
  function scales(chart) {
    const [left, top, width, height] = chart.box;
    return { x: along(chart.x, left, width), y: along(chart.y, top + height, -height) };
  }

  // All points that can be drawn, with their places: [{trace, index, at: [x, y]}].
  function points(chart) {
    const to = scales(chart);
    return chart.traces.flatMap((trace) => trace.y.map((_, index) => ({ trace, index, at: placeOf(chart, to, trace, index) })))
      .filter(({ at }) => at.every(Number.isFinite));
  }

  // The place of a bar is its middle.
  function placeOf(chart, to, trace, index) {
    const x = xs(chart, trace)[index];
    const high = trace.x_high?.[index];
    if (x === null || trace.y[index] === null) return [NaN, NaN];
    const y = trace.kind === "bins" ? heightOf(chart, to, trace.y[index]) : to.y(trace.y[index]);
    return [high === undefined ? to.x(x) : (to.x(x) + to.x(high)) / 2, y];
  }

  // An empty bin has no place on a logarithmic axis and lies on its foot.
  const heightOf = (chart, to, share) => to.y(Math.max(share, chart.y.low));

  function xs(chart, trace) {
    return typeof trace.x === "number" ? chart.traces[trace.x].x : trace.x;
  }

  // About six at most: round numbers on a linear or short axis, powers of ten on other axes.
  function ticks(axis) {
    const evenly = (from, to, step) => Array.from({ length: Math.floor((to - from) / step + 1e-9) + 1 }, (_, place) => from + place * step);
    if (axis.scale === "linear" || axis.low < 0 || axis.high < 30 * axis.low) {
      const size = 10 ** Math.floor(Math.log10(axis.high - axis.low)) / 2;
      const step = size * Math.ceil((axis.high - axis.low) / size / 5 - 1e-9);
      return evenly(Math.ceil(axis.low / step - 1e-9) * step, axis.high, step);
    }
    const lowest = axis.scale === "symlog" ? axis.linear_below : axis.low;
    const [from, to] = [Math.ceil(Math.log10(lowest) - 1e-9), Math.floor(Math.log10(axis.high) + 1e-9)];
    const step = Math.ceil((to - from) / 5) || 1;
    const powers = evenly(from + ((to - from) % step), to, step).map((power) => 10 ** power);
    return axis.scale === "symlog" ? [0, ...powers.filter((value) => value > lowest)] : powers;
  }

  function label(value) {
    const power = Math.log10(value);
    if (!(Math.abs(power - Math.round(power)) < 1e-6) || (value >= 0.01 && value < 999)) return numbers.brief(value);
    return `10${[...String(Math.round(power))].map((sign) => (sign === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[sign])).join("")}`;
  }

  function frame(chart) {
    const to = scales(chart);
    const [left, top, width, height] = chart.box;
    const [right, bottom] = [left + width, top + height];
    const line = (x1, y1, x2, y2, colour) => element.svg("line", { x1, y1, x2, y2, stroke: `var(${colour})`, "stroke-width": 0.8 });
    const text = (x, y, words, further = {}) =>
      element.svg("text", { x, y, fill: "var(--muted)", "font-size": 9, "text-anchor": "middle", ...further }, words);
    return [
      ...ticks(chart.x).flatMap((at) => [line(to.x(at), top, to.x(at), bottom, "--rule"), text(to.x(at), bottom + 12, label(at))]),
      ...ticks(chart.y).flatMap((at) => [line(left, to.y(at), right, to.y(at), "--rule"), text(left - 4, to.y(at) + 3, label(at), { "text-anchor": "end" })]),
      line(left, top, left, bottom, "--muted"), line(left, bottom, right, bottom, "--muted"),
      text(left + width / 2, bottom + 27, chart.x.label),
      text(10, top + height / 2, chart.y.label, { transform: `rotate(-90 10 ${top + height / 2})` }),
    ];
  }

  function outline(chart, trace) {
    const to = scales(chart);
    const steps = trace.y.map((share, place) => `V${heightOf(chart, to, share).toFixed(1)}H${to.x(trace.x_high[place]).toFixed(1)}`);
    const start = `M${to.x(xs(chart, trace)[0]).toFixed(1)} ${heightOf(chart, to, trace.y[0]).toFixed(1)}`;
    return element.svg("path", { d: `${start}${steps.join("")}`, fill: "none", stroke: `var(${trace.colour})`, "stroke-width": 1.6 });
  }
  return { points, xs, frame, outline, enlarged };
})();
