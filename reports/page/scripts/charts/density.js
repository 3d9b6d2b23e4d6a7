// Density before and after the amplifier, checkpoint by checkpoint, for all points and for those that truly lie inside
// and outside of the scene's matter. The printed drawings of the last checkpoint stay below.
const density = (() => {
  const data = element.data("density-data", []);
  const colours = element.data("runs-data", { colours: {} }).colours;
  const SIDES = [["all points", ""], ["points inside matter", "_inside"], ["points outside matter", "_outside"]];
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  const nodes = {};
  let timer = null;
  let shown = null; // the shares that are drawn now, by figure
  let frame = null;

  const distinct = (name, some) => [...new Set(some.map((one) => one[name]))];

  // Runs that the reader has not filtered out.
  const allowed = () => data.filter((one) => filter.allows(one.scene, one.method));

  // The run that is looked at: what the reader has selected, as far as there are histograms of it.
  function current() {
    let left = allowed();
    for (const name of ["scene", "method", "seed"]) {
      const wanted = state.get(name);
      const fitting = left.filter((one) => String(one[name]) === wanted);
      if (fitting.length > 0) left = fitting;
      else if (name === "method") {
        const changed = left.filter(amplifies);
        if (changed.length > 0) left = changed;
      }
    }
    return left[0];
  }

  const amplifies = (one) => one.at.some((at) => at.after);
  const place = (one) => {
    const found = one.steps.indexOf(Number(state.get("density.step")));
    return state.get("density.step") === null || found < 0 ? one.steps.length - 1 : found;
  };

  function sidesOf(one, at, suffix) {
    const before = one.at[at][`before${suffix}`];
    return before ? [before, one.at[at][`after${suffix}`] ?? before] : null;
  }

  // The same axis at every checkpoint and in every drawing of a run, so that only what changes moves.
  function most(one) {
    const names = SIDES.flatMap(([, suffix]) => [`before${suffix}`, `after${suffix}`]);
    const every = one.at.flatMap((at) => names.flatMap((name) => at[name] ?? []));
    return Math.min(Math.max(...every), 1);
  }

  function draw(one, at, shares) {
    const behind = { scene: one.scene, method: one.method, seed: one.seed, step: one.steps[at] };
    SIDES.forEach(([words, suffix], number) => {
      const figure = nodes.figures[number];
      figure.hidden = !shares[number];
      if (figure.hidden) return;
      const [before, after] = shares[number];
      const title = `${one.scene}, ${one.method}, seed ${one.seed}: ${words}, step ${numbers.grouped(one.steps[at])}`;
      const sides = [["before the amplifier", "--muted", before], ["after the amplifier", colours[one.method] ?? "--ink", after]];
      const chart = histogram.chart(title, one.edges, sides, most(one), behind);
      const alt = `${title}. Mean density about ${mean(one.edges, before)} before and ${mean(one.edges, after)} after the amplifier.`;
      histogram.draw(figure.querySelector("svg"), chart, alt);
      figures.give(figure, chart);
    });
  }

  function mean(edges, shares) {
    return numbers.brief(shares.reduce((sum, share, bin) => sum + (share * (edges[bin] + edges[bin + 1])) / 2, 0));
  }

  // From what is drawn to `shares` in a quarter of a second.
  function morph(one, at, shares) {
    cancelAnimationFrame(frame);
    const from = shown;
    const alike = from && from.every((side, number) => Boolean(side) === Boolean(shares[number]) && (!side || side[0].length === shares[number][0].length));
    shown = shares;
    if (!alike || still.matches) return draw(one, at, shares);
    const start = performance.now();
    const floor = (share) => Math.log(Math.max(share, histogram.FOOT));
    const between = (a, b, part) => a.map((share, bin) => Math.exp(floor(share) + part * (floor(b[bin]) - floor(share))));
    const step = (now) => {
      const part = Math.min((now - start) / 250, 1);
      draw(one, at, part === 1 ? shares : shares.map((side, number) => side && side.map((values, which) => between(from[number][which], values, part))));
      if (part < 1) frame = requestAnimationFrame(step);
    };
    frame = requestAnimationFrame(step);
  }

  function options(select, values, chosen) {
    select.replaceChildren(...values.map((value) => element("option", { value, selected: value === chosen }, String(value))));
    select.value = String(chosen);
  }

  function show() {
    const one = current();
    nodes.whole.hidden = !one;
    if (!one) return;
    const at = place(one);
    const of = (...names) => allowed().filter((each) => names.every((name) => each[name] === one[name]));
    options(nodes.scene, distinct("scene", of()), one.scene);
    options(nodes.method, distinct("method", of("scene")), one.method);
    options(nodes.seed, distinct("seed", of("scene", "method")), one.seed);
    nodes.step.max = one.steps.length - 1;
    nodes.step.value = at;
    nodes.step.setAttribute("aria-valuetext", `step ${one.steps[at]}`);
    nodes.said.textContent = `step ${numbers.grouped(one.steps[at])}`;
    nodes.play.disabled = one.steps.length < 2;
    nodes.swatch.style.background = `var(${colours[one.method] ?? "--ink"})`;
    const split = Boolean(sidesOf(one, at, "_inside"));
    nodes.note.textContent = [
      split ? truth(one.at[at]) : "This run did not record which of the points truly lie inside of the scene’s matter.",
      amplifies(one) ? "" : `Nothing changes the density of ${one.method}: both lines are one.`,
    ].filter(Boolean).join(" ");
    morph(one, at, SIDES.map(([, suffix]) => sidesOf(one, at, suffix)));
  }

  function truth(at) {
    const [inside, outside] = at.points ?? [0, 0];
    if (!(inside + outside > 0)) return "Inside and outside: where the scene’s geometry truly is.";
    const share = numbers.fixed((100 * inside) / (inside + outside), 1);
    return `Inside and outside: where the scene’s geometry truly is. ${numbers.grouped(inside)} of ${numbers.grouped(inside + outside)} points (${share}\u202f%) lie inside.`;
  }

  function go(number) {
    const one = current();
    state.set({ "density.step": one.steps[Math.min(Math.max(number, 0), one.steps.length - 1)] });
  }

  function play() {
    const playing = timer !== null;
    clearInterval(timer);
    timer = null;
    if (!playing) {
      const one = current();
      if (place(one) === one.steps.length - 1) go(0);
      timer = setInterval(() => {
        const one = current();
        if (!one || place(one) >= one.steps.length - 1) play();
        else go(place(one) + 1);
      }, 900);
    }
    nodes.play.textContent = playing ? "play" : "stop";
  }

  function chooser(name) {
    nodes[name] = element("select", { name: `density-${name}`, autocomplete: "off", change: (event) => state.set({ [name]: event.target.value }) });
    return element("label", {}, name, nodes[name]);
  }

  function start() {
    const section = document.getElementById("amplifier");
    if (!section || data.length === 0) return;
    nodes.step = element("input", { type: "range", min: 0, step: 1, "aria-label": "Checkpoint", autocomplete: "off", input: (event) => go(Number(event.target.value)) });
    nodes.play = element("button", { type: "button", class: "act", click: play }, "play");
    nodes.said = element("output", {});
    nodes.note = element("p", { class: "note" });
    nodes.figures = SIDES.map(([words]) => element("figure", {}, element("figcaption", {}, words), histogram.empty()));
    const controls = element("div", { class: "choose" }, ["scene", "method", "seed"].map(chooser), element("label", { class: "wide" }, "checkpoint", nodes.step), nodes.said, nodes.play);
    nodes.swatch = element("i", { class: "swatch" });
    const key = element("p", { class: "legend" },
      element("span", {}, element("i", { class: "swatch", style: "background: var(--muted)" }), "density before the amplifier"),
      element("span", {}, nodes.swatch, "after it"), "One run, checkpoint by checkpoint.");
    nodes.whole = element("div", { class: "density" }, controls, key, element("div", { class: "plots" }, nodes.figures), nodes.note);
    section.querySelector("h2").after(nodes.whole);
    nodes.figures.forEach(figures.enhance);
    show();
    state.on((changed) => {
      if (["scene", "method", "seed", "density.step", "filter.scenes", "filter.methods"].some((name) => changed.has(name))) show();
    });
  }
  return { start };
})();
