// A panel with the runs behind a figure: their training, their scores, and the pairs of a difference.
const runs = (() => {
  const data = element.data("runs-data", null);
  // The keys of a selection, and their names in the address.
  const KEYS = {
    scene: "scene", method: "method", seed: "seed", step: "step",
    against: "runs.against", metric: "runs.metric", budget: "runs.budget",
  };
  // The budget of a comparison: its label, the column of a curve, and the total of a run.
  const BUDGETS = {
    steps: ["steps", "step", "steps"], seconds: ["training time", "seconds", "seconds"],
    core_seconds: ["core seconds", "core_seconds", "core_seconds"],
  };
  const WORDS = { done: "finished", diverged: "diverged", error: "failed", not_available: "not available" };
  const INCOMPLETE = "not compared: the group is not complete";
  const body = element("div", { class: "content" });
  const close = element.button("close", "✕", () => shut(), { "aria-label": "Close" });
  const panel = element("aside", { class: "panel", id: "runs", hidden: true, tabindex: "-1", "aria-label": "The runs behind it" }, close, body);
  document.body.append(panel);
  let opener = null;

  // Shows the runs of a selection; `from` gets the focus back.
  function open(selection, from = null) {
    if (!data) return;
    opener = from;
    const chosen = Object.fromEntries(Object.entries(KEYS).map(([name, key]) => [key, selection[name]]));
    state.set({ ...chosen, "runs.open": 1 }, { entry: true });
    panel.focus({ preventScroll: true });
  }

  function shut() {
    if (panel.hidden) return;
    state.set({ "runs.against": null, "runs.metric": null, "runs.budget": null, "runs.open": null }, { entry: true });
    opener?.focus({ preventScroll: true });
    opener = null;
  }

  function selected() {
    const read = Object.entries(KEYS).map(([name, key]) => [name, state.get(key)]).filter(([, value]) => value !== null);
    return Object.fromEntries(read.map(([name, value]) => [name, ["seed", "step"].includes(name) ? Number(value) : value]));
  }

  const cellsOf = ({ scene, seed }, method) => data.cells.filter((cell) =>
    (!scene || cell.scene === scene) && (!method || cell.method === method) && (!Number.isFinite(seed) || cell.seed === seed));

  const metricOf = (name) => data.metrics.find((metric) => metric.name === name) ?? data.metrics[0];
  const score = (cell, name) => (cell.status === "done" ? cell.scores[name] ?? null : null);
  const unitOf = ({ unit }) => (unit ? ` ${unit}` : "");

  // A metric of two runs: after the steps that both have, or at the time of the faster run.
  function scoresAt(first, second, name, budget) {
    if (!first.judged || !second?.judged) return [null, null];
    const [, axis, length] = BUDGETS[budget] ?? BUDGETS.steps;
    if (axis === "step" && first.steps === second.steps) return [score(first, name), score(second, name)];
    const at = Math.min(first[length], second[length]);
    return [onCurve(first, name, axis, at), onCurve(second, name, axis, at)];
  }

  // Linear in the logarithm of steps or seconds between checkpoints, as in the comparisons.
  function onCurve({ curve }, name, axis, at) {
    const points = (curve[axis] ?? []).map((x, place) => [x, curve[name]?.[place] ?? null]).filter(([, y]) => y !== null);
    if (points.length === 0 || at < points[0][0]) return null;
    const next = points.findIndex(([x]) => x >= at);
    if (next < 0) return points.at(-1)[1];
    if (next === 0) return points[0][1];
    const [[x0, y0], [x1, y1]] = [points[next - 1], points[next]];
    return y0 + ((y1 - y0) * Math.log(at / x0)) / Math.log(x1 / x0);
  }

  function grid(caption, head, rows) {
    const line = (cells) => element("tr", {}, element("th", { scope: "row" }, cells[0]), cells.slice(1).map((cell) => element("td", {}, cell)));
    const heads = head.map((cell) => element("th", { scope: "col" }, cell));
    return element.scroll(caption, element("table", {}, element("caption", {}, caption),
      element("thead", {}, element("tr", {}, heads)), element("tbody", {}, rows.map(line))));
  }

  // The mean over scenes of the means over seeds of {cell, value}, as in the comparisons.
  function meanOf(rows) {
    const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
    const scenes = [...new Set(rows.map(({ cell }) => cell.scene))];
    return mean(scenes.map((scene) => mean(rows.filter(({ cell }) => cell.scene === scene).map(({ value }) => value))));
  }

  // The pairs of a selection: [cell of the method, cell of its rival].
  const pairsOf = (selection) => cellsOf(selection, selection.method).map((own) =>
    [own, data.cells.find((cell) => cell.scene === own.scene && cell.seed === own.seed && cell.method === selection.against)]);

  // All pairs behind a mean difference, and the cells without a pair.
  function differences(selection) {
    const metric = metricOf(selection.metric);
    const digits = metric.digits + 1;
    const rows = pairsOf(selection).map(([cell, rival]) => {
      const [a, b] = scoresAt(cell, rival, metric.name, selection.budget);
      const excluded = cell.whole === false ? INCOMPLETE : a === null || b === null ? "not judged" : null;
      return { cell, a, b, excluded, value: excluded ? null : a - b };
    });
    const known = rows.filter(({ value }) => value !== null);
    const compared = rows.filter(({ excluded }) => excluded !== INCOMPLETE);
    const several = new Set(known.map(({ cell }) => cell.scene)).size > 1 ? " over scenes of the means over seeds" : "";
    const mean = known.length > 0 && `Mean${several}: ${numbers.signed(meanOf(known), digits)}${unitOf(metric)}, from ${known.length} of ${compared.length} pairs.`;
    return [
      grid(`${metric.label}, at equal ${(BUDGETS[selection.budget] ?? BUDGETS.steps)[0]}`,
        ["scene", "seed", selection.method, selection.against, "difference"],
        rows.map(({ cell, a, b, excluded, value }) =>
          [cell.scene, String(cell.seed), numbers.fixed(a, digits), numbers.fixed(b, digits), excluded ?? numbers.signed(value, digits)])),
      element("p", { class: "note" }, mean || "No pair has both scores."),
    ];
  }

  // The time at which a run reached the target, or the time until which it did not.
  function reachOf(cell, axis) {
    const [time, known] = data.reached?.[cell?.scene]?.[cell?.method]?.[cell?.seed]?.[axis] ?? [null, ""];
    if (time === null || cell.status === "error") return WORDS[cell?.status] ?? numbers.NOTHING;
    const words = axis === "steps" ? numbers.brief(Math.round(time)) : numbers.seconds(time);
    return `${{ never: "not within ", earlier: "by " }[known] ?? ""}${words}`;
  }

  function times(selection) {
    const axis = selection.budget in BUDGETS ? selection.budget : "steps";
    const label = `${axis === "steps" ? "training steps" : BUDGETS[axis][0]} to ${numbers.fixed(data.target, 1)} dB`;
    return [
      grid(label, ["scene", "seed", selection.method, selection.against],
        pairsOf(selection).map(([own, rival]) => [own.scene, String(own.seed), reachOf(own, axis), reachOf(rival, axis)])),
      element("p", { class: "note" }, "“Not within”: the end of the run; “by”: its first checkpoint."),
    ];
  }

  function checkpoints({ curve }, step) {
    const names = Object.keys(curve);
    const rows = (curve.step ?? []).map((_, place) => names.map((name) => numbers.brief(curve[name][place])));
    if (rows.length === 0) return null;
    const table = grid("Checkpoints", names.map((name) => name.replace("_", " ")), rows);
    table.querySelectorAll("tbody tr")[curve.step.indexOf(step)]?.classList.add("chosen");
    return table;
  }

  function pictures(cell, step) {
    if (!document.getElementById("pictures")) return null;
    const click = () => {
      const narrow = matchMedia("(max-width: 60rem)").matches ? { "runs.open": null } : {};
      state.go("pictures", { scene: cell.scene, method: cell.method, seed: cell.seed, step, ...narrow });
    };
    return element.button("act", [thumbnails.of(cell, step), element("span", {}, "compare the pictures")].flat(), click,
      { "aria-label": "compare the pictures" });
  }

  function details(cell, step) {
    const others = [["PSNR on training views", "psnr_train", 2], ["ceiling", "psnr_ceiling", 1], ["floor", "psnr_floor", 1]];
    const scores = [...data.metrics, ...others.map(([label, name, digits]) => ({ label, name, digits, unit: "dB" }))];
    const facts = [
      ["steps", numbers.grouped(cell.steps)], ["training time", numbers.seconds(cell.seconds)],
      ...(cell.core_seconds === null ? [] : [["core seconds", numbers.brief(cell.core_seconds)]]),
      ...scores.filter(({ name }) => cell.scores[name] !== undefined)
        .map((each) => [each.label, `${numbers.fixed(cell.scores[each.name], each.digits)}${unitOf(each)}`]),
      ...costsOf(cell), ...Object.entries(cell.differing), ["record", cell.file],
    ];
    return [
      cell.reason ? element("p", { class: "failed" }, cell.reason) : null,
      ...cell.warnings.map((text) => element("p", { class: "warned" }, text)),
      pictures(cell, step), element.terms(facts, { class: "provenance" }), checkpoints(cell, step),
      evidence.histogram(cell, step), evidence.training(cell), evidence.views(cell, data.views[cell.scene], grid), evidence.again(cell),
    ].flat().filter(Boolean);
  }

  function costsOf({ costs }) {
    const bytes = (value) => `${numbers.fixed(value / 1e6, 1)}\u202fMB`;
    const words = {
      view_seconds: ["rendering a view", (value) => `${numbers.brief(1000 * value)}\u202fms`],
      weights_bytes: ["file of weights", bytes], memory_bytes: ["memory of its process", bytes], gpu_memory_bytes: ["memory of the GPU", bytes],
    };
    return Object.entries(words).filter(([name]) => costs?.[name] !== undefined).map(([name, [label, write]]) => [label, write(costs[name])]);
  }

  function unit(cell, selection, isOpen) {
    const metric = metricOf(selection.metric);
    const figure = cell.status === "done" ? `${metric.label} ${numbers.fixed(score(cell, metric.name), metric.digits)}` : WORDS[cell.status];
    const title = [selection.scene ? null : cell.scene, selection.method && !selection.against ? null : cell.method, `seed ${cell.seed}`];
    // details are created when they are unfolded: a panel may hold a hundred runs
    const fill = () => { if (node.open && node.children.length === 1) node.append(...details(cell, selection.step)); };
    const node = element("details", { open: isOpen, class: cell.status === "done" ? null : "lost", toggle: () => fill() },
      element("summary", {}, element("b", {}, title.filter(Boolean).join(" · ")), element("span", {}, figure),
        cell.warnings.length > 0 ? element("span", { class: "flag" }, "warning") : null));
    fill();
    return node;
  }

  function summary(cells, metric) {
    const scores = cells.map((cell) => score(cell, metric.name)).filter((value) => value !== null);
    const many = `${cells.length} run${cells.length === 1 ? "" : "s"}`;
    if (cells.length === 0) return "This report has no such run.";
    if (scores.length === 0) return `${many}, none with a ${metric.label}.`;
    const ends = [Math.min(...scores), Math.max(...scores)].map((value) => numbers.fixed(value, metric.digits));
    return `${many}, ${scores.length} finished; ${metric.label} ${scores.length > 1 ? ends.join(" to ") : ends[0]}${unitOf(metric)}.`;
  }

  function show() {
    const wanted = Boolean(data) && state.get("runs.open") !== null;
    const before = opener?.getBoundingClientRect().top;
    panel.hidden = !wanted;
    document.documentElement.classList.toggle("with-panel", wanted);
    // the clicked element stays in place, although the page has become narrower
    if (opener) scrollBy({ top: opener.getBoundingClientRect().top - before, behavior: "instant" });
    if (!wanted) return;
    const selection = selected();
    const cells = cellsOf(selection, selection.method);
    const every = [...cells, ...(selection.against ? cellsOf(selection, selection.against) : [])];
    const who = selection.against ? `${selection.method} − ${selection.against}` : selection.method ?? "all methods";
    const compared = selection.against && every.length > 0 ? (selection.metric === "target" ? times : differences)(selection) : [];
    body.replaceChildren(
      element("p", { class: "eyebrow" }, "the runs behind it"),
      element("h2", {}, `${who}, ${selection.scene ?? "all scenes"}`),
      element("p", { class: "note" }, summary(cells, metricOf(selection.metric))),
      ...compared, ...every.map((cell, place) => unit(cell, selection, place === 0 && !selection.against)));
    panel.scrollTop = 0;
  }

  function start() {
    if (!data) return;
    state.on((changed) => {
      if (["runs.open", ...Object.values(KEYS)].some((key) => changed.has(key))) show();
    });
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !panel.hidden && !event.defaultPrevented) shut();
    });
    show();
  }
  return { start, open };
})();
