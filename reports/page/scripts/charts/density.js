// Density before and after the amplifier at each checkpoint, for all points and for those inside and outside of the
// scene's true geometry. The static drawings of the last checkpoint stay below.
const density = (() => {
  const data = element.data("density-data", []);
  const colours = element.data("runs-data", { colours: {} }).colours;
  const SIDES = [["all points", ""], ["points inside geometry", "_inside"], ["points outside geometry", "_outside"]];
  const KEYS = ["scene", "method", "seed"];
  const BOX = [42, 9, 216, 142];
  const FOOT = 1e-5 / 1.6; // the start of the axis of shares; smaller shares and empty bins are drawn there
  const nodes = {};

  const amplifies = (run) => run.at.some((at) => at.after);

  const allowed = () => data.filter((run) => filter.allows(run.scene, run.method));

  // The run that is shown: the reader's selection, as far as it has histograms.
  function current() {
    let candidates = allowed();
    for (const name of KEYS) {
      const selected = candidates.filter((run) => String(run[name]) === state.get(name));
      const matching = selected.length === 0 && name === "method" ? candidates.filter(amplifies) : selected;
      if (matching.length > 0) candidates = matching;
    }
    return candidates[0];
  }

  function placeOf(run) {
    const place = run.steps.indexOf(Number(state.get("density.step") ?? NaN));
    return place < 0 ? run.steps.length - 1 : place;
  }

  // Shares before and after, or null where the side was not recorded.
  function sharesOf(at, suffix) {
    const before = at[`before${suffix}`];
    return before ? [before, at[`after${suffix}`] ?? before] : null;
  }

  // The largest share of a run, so that all its checkpoints and sides have the same axis.
  function largestShare(run) {
    const every = run.at.flatMap((at) => SIDES.flatMap(([, suffix]) => sharesOf(at, suffix) ?? []).flat());
    return Math.min(Math.max(...every), 1);
  }

  // Bins of equal width have a linear axis, others a logarithmic axis, or symlog if they include 0.
  function axisOf(edges) {
    const widths = edges.slice(1).map((high, place) => high - edges[place]);
    const [low, high] = [edges[0], edges.at(-1)];
    if (Math.max(...widths) < 3 * Math.min(...widths)) return { scale: "linear", low, high };
    if (low > 0) return { scale: "log", low, high };
    return { scale: "symlog", low, high, linear_below: Math.min(...edges.filter((edge) => edge !== 0).map(Math.abs)) };
  }

  function chartOf(run, at, title, shares) {
    const lines = [["before the amplifier", "--muted"], ["after the amplifier", colours[run.method] ?? "--ink"]];
    return {
      title, box: BOX,
      x: { label: "density σ", ...axisOf(run.edges) },
      y: { label: "share of points", scale: "log", low: FOOT, high: largestShare(run) * 1.6 },
      traces: lines.map(([label, colour], which) => ({
        label, colour, kind: "bins", x: run.edges.slice(0, -1), x_high: run.edges.slice(1), y: shares[which], runs: [0],
      })),
      runs: [{ scene: run.scene, method: run.method, seed: run.seed, step: run.steps[at] }],
    };
  }

  function draw(run, at) {
    SIDES.forEach(([words, suffix], which) => {
      const figure = nodes.figures[which];
      const shares = sharesOf(run.at[at], suffix);
      figure.hidden = !shares;
      if (figure.hidden) return;
      const title = `${run.scene}, ${run.method}, seed ${run.seed}: ${words}, step ${numbers.grouped(run.steps[at])}`;
      const chart = chartOf(run, at, title, shares);
      const svg = figure.querySelector("svg");
      const [before, after] = shares.map((side) => mean(run.edges, side));
      svg.replaceChildren(...chartScale.frame(chart), ...chart.traces.map((trace) => chartScale.outline(chart, trace)));
      svg.setAttribute("aria-label", `${title}. Mean density about ${before} before and ${after} after the amplifier.`);
      figures.setChart(figure, chart);
    });
  }

  function mean(edges, shares) {
    return numbers.brief(shares.reduce((sum, share, bin) => sum + (share * (edges[bin] + edges[bin + 1])) / 2, 0));
  }

  function show() {
    const run = current();
    nodes.root.hidden = !run;
    if (!run) return;
    const at = placeOf(run);
    KEYS.forEach((name, place) => {
      const alike = allowed().filter((each) => KEYS.slice(0, place).every((key) => each[key] === run[key]));
      const values = [...new Set(alike.map((each) => String(each[name])))];
      nodes[name].set(values.map((value) => [value, value]), String(run[name]));
    });
    nodes.step.max = run.steps.length - 1;
    nodes.step.value = at;
    nodes.step.setAttribute("aria-valuetext", `step ${run.steps[at]}`);
    nodes.stepLabel.textContent = `step ${numbers.grouped(run.steps[at])}`;
    nodes.swatch.style.background = `var(${colours[run.method] ?? "--ink"})`;
    const split = Boolean(sharesOf(run.at[at], "_inside"));
    nodes.note.textContent = [
      split ? truth(run.at[at]) : "This run did not record which points lie inside of the scene’s geometry.",
      amplifies(run) ? "" : `Nothing changes the density of ${run.method}: both lines coincide.`,
    ].filter(Boolean).join(" ");
    draw(run, at);
  }

  function truth(at) {
    const [inside, outside] = at.points ?? [0, 0];
    const words = "Inside and outside: where the scene’s geometry truly is.";
    if (!(inside + outside > 0)) return words;
    const share = numbers.fixed((100 * inside) / (inside + outside), 1);
    return `${words} ${numbers.grouped(inside)} of ${numbers.grouped(inside + outside)} points (${share}\u202f%) lie inside.`;
  }

  function start() {
    const section = document.getElementById("amplifier");
    if (!section || data.length === 0) return;
    for (const name of KEYS) nodes[name] = element.select(name, (value) => state.set({ [name]: value }));
    const go = (event) => state.set({ "density.step": current().steps[event.target.value] });
    nodes.step = element("input", { type: "range", min: 0, step: 1, "aria-label": "Checkpoint", autocomplete: "off", input: go });
    nodes.stepLabel = element("output");
    nodes.note = element("p", { class: "note" });
    nodes.swatch = element.swatch();
    nodes.figures = SIDES.map(([words]) => element("figure", {}, element("figcaption", {}, words),
      element.svg("svg", { class: "plot", viewBox: "0 0 266 187", role: "img" })));
    nodes.root = element("div", { class: "density" },
      element("div", { class: "choose" }, KEYS.map((name) => nodes[name].root), element("label", {}, "checkpoint", nodes.step), nodes.stepLabel),
      element("p", { class: "legend" }, element("span", {}, element.swatch("--muted"), "density before the amplifier"),
        element("span", {}, nodes.swatch, "after it"), "One run, checkpoint by checkpoint."),
      element("div", { class: "plots" }, nodes.figures), nodes.note);
    (section.querySelector(".fold > summary") ?? section.querySelector("h2")).after(nodes.root);
    nodes.figures.forEach(figures.enhance);
    show();
    state.on((changed) => {
      if ([...KEYS, "density.step", "filter.scenes", "filter.methods"].some((name) => changed.has(name))) show();
    });
  }
  return { start };
})();
