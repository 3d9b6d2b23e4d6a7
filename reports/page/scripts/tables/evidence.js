// The details behind the score of a run: its training, its density at a checkpoint, its views, and its replay command.
const evidence = (() => {
  const [WIDTH, HEIGHT] = [132, 22];
  const LAYER = "gradient_norm ";
  const SERIES = [["loss", "loss"], ["gradient norm", "gradient_norm"], ["after clipping", "clipped_norm"],
    ["learning rate", "learning_rate"], ["samples per ray", "samples_per_ray"]];
  const WORST = 3;
  let histograms = null;

  // A small line over training, on a logarithmic axis where all values are above 0.
  function spark(steps, values, label) {
    const known = values.map((value, place) => [steps[place], value]).filter(([, value]) => value !== null);
    const height = known.every(([, value]) => value > 0) ? Math.log : (value) => value;
    const [xs, ys] = [known.map(([x]) => x), known.map(([, y]) => height(y))];
    const scaled = (all, value, size) => {
      const [low, high] = [Math.min(...all), Math.max(...all)];
      return high > low ? ((value - low) / (high - low)) * size : size / 2;
    };
    const points = known.map((_, place) =>
      `${scaled(xs, xs[place], WIDTH).toFixed(1)},${(HEIGHT - scaled(ys, ys[place], HEIGHT)).toFixed(1)}`);
    const ends = [known[0], known.at(-1)].map(([, value]) => numbers.brief(value));
    const said = ends[0] === ends[1] ? ends[0] : `${ends[0]} → ${ends[1]}`;
    const drawn = element.svg("svg", { class: "spark", viewBox: `-1 -1 ${WIDTH + 2} ${HEIGHT + 2}`, role: "img", "aria-label": `${label}: ${said}` },
      element.svg("polyline", { points: points.join(" "), fill: "none", stroke: "currentColor", "stroke-width": 1.4 }));
    return element("tr", {}, element("th", { scope: "row" }, label), element("td", {}, drawn), element("td", {}, said));
  }

  function sparks(cell, series, caption) {
    const { step, ...traced } = cell.trace ?? {};
    const rows = series.filter(([, name]) => (traced[name] ?? []).some((value) => value !== null));
    if (!step || rows.length === 0) return null;
    return element.scroll(caption, element("table", { class: "sparks" }, element("caption", {}, caption),
      element("tbody", {}, rows.map(([label, name]) => spark(step, traced[name], label)))));
  }

  function training(cell) {
    const layers = Object.keys(cell.trace ?? {}).filter((name) => name.startsWith(LAYER));
    const byLayer = sparks(cell, layers.map((name) => [name.slice(LAYER.length), name]), "Norm of the gradient by layer, before clipping");
    return [sparks(cell, SERIES, "Training, from the first step to the last"),
      byLayer && element("details", {}, element("summary", {}, "gradient by layer"), byLayer)];
  }

  // The density of a checkpoint, as a link to the section where it can be moved.
  function histogram(cell, step) {
    histograms ??= element.data("density-data", []);
    const run = histograms.find((each) =>
      each.scene === cell.scene && each.method === cell.method && each.seed === cell.seed);
    if (!run) return null;
    const at = run.steps.indexOf(step);
    const place = at < 0 ? run.steps.length - 1 : at;
    const { before, after } = run.at[place];
    if (!before) return null;
    const foot = Math.log(1e-5);
    const bars = (shares, look) => element.svg("polyline", {
      points: shares.map((share, bin) => `${(bin / (shares.length - 1)) * WIDTH * 2},${HEIGHT * 2 * Math.min(1, Math.log(Math.max(share, 1e-5)) / foot)}`).join(" "),
      fill: "none", stroke: look, "stroke-width": 1.4,
    });
    const words = `density at step ${numbers.grouped(run.steps[place])}`;
    const lines = [bars(before, "var(--muted)"), after ? bars(after, "currentColor") : null];
    const click = () => state.go("amplifier", { scene: cell.scene, method: cell.method, seed: cell.seed, "density.step": run.steps[place] });
    return element.button("act", [
      element.svg("svg", { class: "spark", viewBox: `-1 -1 ${WIDTH * 2 + 2} ${HEIGHT * 2 + 2}`, "aria-hidden": "true" }, lines.filter(Boolean)),
      element("span", {}, words)], click, { "aria-label": words });
  }

  // All test views, the worst first.
  function views(cell, names, grid) {
    const scores = cell.views ?? {};
    const shown = Object.keys(scores);
    if (!names || shown.length === 0) return null;
    const order = names.map((_, place) => place).sort((a, b) => (scores.psnr?.[a] ?? Infinity) - (scores.psnr?.[b] ?? Infinity));
    const row = (place) => [names[place], ...shown.map((name) => numbers.brief(scores[name][place]))];
    const head = ["view", ...shown.map((name) => name.replace("_", " "))];
    const rest = order.slice(WORST);
    return [grid("The worst test views", head, order.slice(0, WORST).map(row)),
      rest.length > 0 ? element("details", {}, element("summary", {}, `${rest.length} better views`), grid("Better views", head, rest.map(row))) : null];
  }

  function again(cell) {
    if (!cell.replay) return null;
    const copy = element.button("act", "copy", ({ currentTarget }) => {
      navigator.clipboard?.writeText(cell.replay).then(() => { currentTarget.textContent = "copied"; });
    });
    return element("div", { class: "again" }, element("p", {}, element("b", {}, "Repeat this run bit for bit")),
      element("pre", {}, cell.replay), cell.beside ? element("p", { class: "note" }, `With ${cell.beside}.`) : null, copy);
  }
  return { training, histogram, views, again };
})();
