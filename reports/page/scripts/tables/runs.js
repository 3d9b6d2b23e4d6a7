// The runs behind a figure, beside the page: what each of them did, what it scored, and how a difference came about.
const runs = (() => {
  const data = element.data("runs-data", null);
  const keys = ["scene", "method", "seed", "step", "against", "metric", "budget"];
  const shared = new Set(["scene", "method", "seed", "step"]);
  const body = element("div", { class: "content" });
  const close = element("button", { type: "button", class: "close", "aria-label": "Close", click: () => shut(true) }, "✕");
  const panel = element("aside", { class: "panel", id: "runs", hidden: true, tabindex: "-1", "aria-label": "The runs behind it" }, close, body);
  document.body.append(panel);
  let opener = null;

  const key = (name) => (shared.has(name) ? name : `runs.${name}`);

  // Shows the runs of a selection; `from` gets the focus back.
  function open(selection, from = null) {
    if (!data) return;
    opener = from;
    const chosen = Object.fromEntries(keys.map((name) => [key(name), selection[name] ?? null]));
    state.set({ ...chosen, "runs.open": 1 }, true);
    panel.focus({ preventScroll: true });
  }

  function shut(returning) {
    if (panel.hidden) return;
    const rest = keys.filter((name) => !shared.has(name)).map((name) => [key(name), null]);
    state.set({ ...Object.fromEntries(rest), "runs.open": null }, true);
    if (returning) opener?.focus({ preventScroll: true });
    opener = null;
  }

  function selected() {
    const found = Object.fromEntries(keys.map((name) => [name, state.get(key(name))]).filter(([, value]) => value !== null));
    for (const name of ["seed", "step"]) if (name in found) found[name] = Number(found[name]);
    return found;
  }

  function behind(one, method = one.method) {
    return data.cells.filter((cell) =>
      (!one.scene || cell.scene === one.scene) && (!method || cell.method === method) &&
      (one.seed === undefined || Number.isNaN(one.seed) || cell.seed === one.seed));
  }

  const metricOf = (name) => data.metrics.find((one) => one.name === name) ?? data.metrics[0];
  const score = (cell, name) => (cell?.status === "done" ? cell.scores[name] ?? null : null);

  // A metric of two runs: at the steps that both did, or at the training time that the quicker one took.
  function scoresAt(first, second, name, budget) {
    if (first?.status !== "done" || second?.status !== "done") return [null, null];
    if (budget !== "seconds" && first.steps === second.steps) return [score(first, name), score(second, name)];
    const axis = budget === "seconds" ? "seconds" : "step";
    const at = axis === "seconds" ? Math.min(first.seconds, second.seconds) : Math.min(first.steps, second.steps);
    return [onCurve(first, name, axis, at), onCurve(second, name, axis, at)];
  }

  // Linear in the logarithm of steps or seconds between checkpoints, as the comparisons read it.
  function onCurve(cell, name, axis, at) {
    const points = (cell.curve[axis] ?? []).map((x, place) => [x, cell.curve[name]?.[place] ?? null]).filter(([, y]) => y !== null);
    if (points.length === 0 || at < points[0][0]) return null;
    const next = points.findIndex(([x]) => x >= at);
    if (next < 0) return points[points.length - 1][1];
    if (next === 0) return points[0][1];
    const [[x0, y0], [x1, y1]] = [points[next - 1], points[next]];
    return y0 + ((y1 - y0) * Math.log(at / x0)) / Math.log(x1 / x0);
  }

  const row = (tag, ...cells) => element("tr", {}, cells.map((cell, place) =>
    element(place === 0 && tag === "td" ? "th" : tag, tag === "th" ? { scope: "col" } : place === 0 ? { scope: "row" } : {}, cell)));

  function grid(caption, head, rows) {
    return element("div", { class: "scroll" }, element("table", {}, element("caption", {}, caption),
      element("thead", {}, row("th", ...head)), element("tbody", {}, rows.map((one) => row("td", ...one)))));
  }

  const WORDS = { done: "finished", diverged: "diverged", error: "failed", not_available: "not available" };
  const APART = "not compared: the group is not whole";
  const ASIDE = "not judged";

  // Over scenes of the means over seeds, of {cell, value}: as the comparisons take it.
  function meanOf(rows) {
    const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;
    const scenes = [...new Set(rows.map(({ cell }) => cell.scene))];
    return mean(scenes.map((scene) => mean(rows.filter(({ cell }) => cell.scene === scene).map(({ value }) => value))));
  }

  // `rows` of {cell, value, aside}, which says why a pair without a value does not count.
  function said(what, rows, worded) {
    const known = rows.filter(({ value }) => value !== null);
    const compared = rows.filter(({ aside }) => aside !== APART);
    const several = new Set(known.map(({ cell }) => cell.scene)).size > 1;
    return `${what}${several ? " over scenes of the means over seeds" : ""}: ${worded(meanOf(known))}, from ${known.length} of ${compared.length} pairs.`;
  }

  const rivalOf = (one, ours) => data.cells.find((cell) => cell.scene === ours.scene && cell.seed === ours.seed && cell.method === one.against);

  // Every pair that a difference is the mean of, and what could not be paired.
  function pairs(one) {
    const metric = metricOf(one.metric);
    const digits = metric.digits + 1;
    const rows = behind(one).map((ours) => {
      const [a, b] = scoresAt(ours, rivalOf(one, ours), metric.name, one.budget);
      const aside = ours.whole === false ? APART : a === null || b === null ? ASIDE : null;
      return { cell: ours, a, b, aside, value: aside ? null : a - b };
    });
    const worded = (value) => `${numbers.signed(value, digits)}${metric.unit ? ` ${metric.unit}` : ""}`;
    const tell = rows.some(({ value }) => value !== null);
    const label = one.budget === "seconds" ? "at equal training time" : "at equal steps";
    return [
      grid(`${metric.label}, ${label}`, ["scene", "seed", one.method, one.against, "difference"], rows.map((each) => [
        each.cell.scene, String(each.cell.seed), numbers.fixed(each.a, digits), numbers.fixed(each.b, digits),
        each.aside ?? numbers.signed(each.value, digits)])),
      element("p", { class: "note" }, tell ? said("Mean", rows, worded) : "No pair has both scores."),
    ];
  }

  // When a run reached the target, and what of it counts: nothing beyond the horizon, the shortest time that a finished
  // run of the two was watched on the scene. Where nothing counts, `time` is null.
  function reachOf(cell, axis, horizon) {
    const [time, known] = data.reached?.[cell?.scene]?.[cell?.method]?.[cell?.seed]?.[axis] ?? [null, ""];
    if (time === null || cell.status === "error")
      return { own: cell && cell.status !== "done" ? WORDS[cell.status] : numbers.NOTHING, time: null };
    const worded = (value) => (axis === "seconds" ? numbers.seconds(value) : numbers.brief(Math.round(value)));
    const own = known === "never" ? `not within ${worded(time)}` : known === "earlier" ? `by ${worded(time)}` : worded(time);
    if (!horizon) return { own, time: null };
    if (known !== "never" && time <= horizon) return { own, counted: own, time, known };
    const bound = `not within ${worded(horizon)}`;
    return { own, counted: own === bound ? own : `${own}, counted as ${bound}`, time: horizon, known: "never" };
  }

  // When each of a pair reached the target, as the saving takes it.
  function times(one) {
    const axis = one.budget === "seconds" ? "seconds" : "steps";
    const rows = behind(one).map((ours) => {
      const horizon = data.horizons?.[ours.scene]?.[one.method]?.[one.against]?.[axis];
      const pair = [ours, rivalOf(one, ours)].map((cell) => reachOf(cell, axis, horizon));
      const aside = ours.whole === false ? APART : pair.some(({ time }) => time === null) ? ASIDE : null;
      return { cell: ours, pair, aside, value: aside ? null : Math.log(pair[0].time / pair[1].time) };
    });
    const worded = (value) => `${numbers.signed(-100 * Math.expm1(value), 1)}\u202f%`;
    const tell = rows.some(({ pair: [a, b], aside }) => !aside && (a.known === "reached" || a.known !== b.known));
    const label = `${axis === "seconds" ? "training time" : "training steps"} to ${numbers.fixed(data.target, 1)} dB`;
    return [
      grid(label, ["scene", "seed", one.method, one.against, "saving"], rows.map((each) =>
        [each.cell.scene, String(each.cell.seed), ...each.pair.map(({ own, counted }) => (each.aside ? own : counted)), each.aside ?? worded(each.value)])),
      element("p", { class: "note" }, tell ? said("Saving, by the mean of the logarithms of the ratios", rows, worded) : "No pair tells which was sooner."),
      element("p", { class: "note" }, "“Not within”: as long as the run was watched; “by”: its first checkpoint. “Counted as”: nothing counts beyond the shortest time that a finished run of the two was watched on the scene."),
    ];
  }

  function details(cell, one) {
    const scores = [...data.metrics.map((each) => [each.label, each.name, each.digits, each.unit]),
      ["PSNR on training views", "psnr_train", 2, "dB"], ["ceiling", "psnr_ceiling", 1, "dB"], ["floor", "psnr_floor", 1, "dB"]];
    const names = Object.keys(cell.curve);
    const lines = (cell.curve.step ?? []).map((_, place) => names.map((name) => numbers.brief(cell.curve[name][place])));
    const chosen = (cell.curve.step ?? []).indexOf(one.step);
    const table = lines.length > 0 ? grid("Checkpoints", names.map((name) => name.replace("_", " ")), lines) : null;
    if (chosen >= 0) table.querySelectorAll("tbody tr")[chosen].classList.add("chosen");
    const facts = [["steps", numbers.grouped(cell.steps)], ["training time", numbers.seconds(cell.seconds)],
      ...scores.filter(([, name]) => cell.scores[name] !== undefined)
        .map(([label, name, digits, unit]) => [label, `${numbers.fixed(cell.scores[name], digits)}${unit ? `\u202f${unit}` : ""}`]),
      ...Object.entries(cell.differing), ["record", cell.file]];
    return [
      cell.reason ? element("p", { class: "failed" }, cell.reason) : null,
      ...cell.warnings.map((text) => element("p", { class: "warned" }, text)),
      element("dl", { class: "provenance" }, facts.map(([label, value]) =>
        element("div", {}, element("dt", {}, label), element("dd", {}, value)))),
      table,
      document.getElementById("pictures") ? element("button", { type: "button", class: "act", "aria-label": "compare the pictures", click: () => {
        const [seed, step] = [cell.seed, one.step ?? null];
        const narrow = matchMedia("(max-width: 60rem)").matches;
        state.go("pictures", { scene: cell.scene, method: cell.method, seed, step, ...(narrow ? { "runs.open": null } : {}) });
      } }, ...thumbnails.of(cell, one.step), element("span", {}, "compare the pictures")) : null,
    ];
  }

  function unit(cell, one, alone) {
    const metric = metricOf(one.metric);
    const figure = cell.status === "done" ? `${metric.label} ${numbers.fixed(score(cell, metric.name), metric.digits)}` : WORDS[cell.status];
    const title = [one.scene ? null : cell.scene, one.method ? null : cell.method, `seed ${cell.seed}`].filter(Boolean).join(" · ");
    return element("details", { open: alone, class: cell.status === "done" ? null : "lost" },
      element("summary", {}, element("b", {}, title), element("span", {}, figure), cell.warnings.length > 0 ? element("span", { class: "flag" }, "warning") : null),
      details(cell, one));
  }

  function title(one) {
    const who = one.against ? `${one.method} − ${one.against}` : one.method ?? "all methods";
    return `${who}, ${one.scene ?? "all scenes"}`;
  }

  function summary(cells, metric) {
    const done = cells.map((cell) => score(cell, metric.name)).filter((value) => value !== null);
    const many = `${cells.length} run${cells.length === 1 ? "" : "s"}`;
    if (done.length === 0) return `${many}, none with a ${metric.label}.`;
    const range = `${numbers.fixed(Math.min(...done), metric.digits)} to ${numbers.fixed(Math.max(...done), metric.digits)}`;
    return `${many}, ${done.length} finished; ${metric.label} ${done.length > 1 ? range : numbers.fixed(done[0], metric.digits)}${metric.unit ? ` ${metric.unit}` : ""}.`;
  }

  function show() {
    const wanted = Boolean(data) && state.get("runs.open") !== null;
    const before = opener?.getBoundingClientRect().top;
    panel.hidden = !wanted;
    document.documentElement.classList.toggle("with-panel", wanted);
    // what was pointed at stays where it is, though the page has become narrower
    if (opener) scrollBy({ top: opener.getBoundingClientRect().top - before, behavior: "instant" });
    if (!wanted) return;
    const one = selected();
    const cells = behind(one);
    const rivals = one.against ? behind(one, one.against) : [];
    const every = [...cells, ...rivals];
    const about = one.against ? { ...one, method: undefined } : one;
    body.replaceChildren(
      element("p", { class: "eyebrow" }, "the runs behind it"),
      element("h2", {}, title(one)),
      ...(every.length === 0 ? [element("p", {}, "This report has no such run.")] : [element("p", { class: "note" }, summary(cells, metricOf(one.metric)))]),
      ...(one.against && every.length > 0 ? (one.metric === "target" ? times(one) : pairs(one)) : []),
      ...every.map((cell, place) => unit(cell, about, place === 0 && !one.against)),
    );
    panel.scrollTop = 0;
  }

  function start() {
    if (!data) return;
    state.on((changed) => {
      if ([...changed].some((name) => name === "runs.open" || keys.some((each) => key(each) === name))) show();
    });
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && !panel.hidden && !event.defaultPrevented) shut(true);
    });
    show();
  }
  return { start, open };
})();
