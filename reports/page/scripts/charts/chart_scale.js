// A chart's axes as its data says: from values to places in the drawing and what is near a place.
const chartScale = (() => {
  // Matplotlib's scales; symlog is linear below its threshold, with a decade as long as on the outside.
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

  // Value → place along an axis that begins at `start` and is `length` long.
  function along(axis, start, length) {
    const of = forward(axis);
    const [low, high] = [of(axis.low), of(axis.high)];
    return (value) => start + (length * (of(value) - low)) / (high - low);
  }

  // {x, y}: value → place in the drawing, y downwards.
  function of(chart) {
    const [left, top, width, height] = chart.box;
    return { x: along(chart.x, left, width), y: along(chart.y, top + height, -height) };
  }

  // Every point with its place: [{trace, index, at: [x, y]}], those that can be drawn.
  function points(chart) {
    const to = of(chart);
    return chart.traces.flatMap((trace) => trace.y.map((_, index) => ({ trace, index, at: placeOf(chart, to, trace, index) })))
      .filter(({ at }) => at.every(Number.isFinite));
  }

  // A bar is pointed at in its middle.
  function placeOf(chart, to, trace, index) {
    const x = xs(chart, trace)[index];
    const high = trace.x_high?.[index];
    if (x === null || trace.y[index] === null) return [NaN, NaN];
    const y = trace.kind === "bins" ? heightOf(chart, to, trace.y[index]) : to.y(trace.y[index]);
    return [high === undefined ? to.x(x) : (to.x(x) + to.x(high)) / 2, y];
  }

  // An empty bin has no place on a logarithmic axis: it lies on its foot.
  const heightOf = (chart, to, share) => to.y(Math.max(share, chart.y.low));

  function xs(chart, trace) {
    return typeof trace.x === "number" ? chart.traces[trace.x].x : trace.x;
  }
  return { of, along, points, xs, heightOf };
})();
