// The reader's choice from the address, completed where the address is silent or names what was not kept.
const compareChoice = (() => {
  const MODES = { side: "Side by side", wipe: "Wipe", flip: "Flip", difference: "Difference" };
  const EXPOSURES = 10;

  // The number under a key of the address.
  const number = (key, low, high, fallback) => within(state.get(key), low, high, fallback);
  const within = (text, low, high, fallback) => {
    const value = text === null || text.trim() === "" ? NaN : Number(text);
    return Number.isFinite(value) ? numbers.clamp(value, low, high) : fallback;
  };
  const known = (key, names, fallback) => (names.includes(state.get(key)) ? state.get(key) : fallback);

  // The view of the address, by its name or its place.
  function viewIn(scene) {
    const named = scene.views.findIndex(({ name }) => name === state.get("view"));
    const place = named >= 0 ? named : number("view", 0, Infinity, 0);
    return Number.isInteger(place) && place < scene.views.length ? place : 0;
  }

  // The requested value, or the nearest kept value.
  function nearest(requested, values, kept, fallback) {
    if (requested === null || kept.length === 0) return fallback;
    if (values.includes(requested)) return requested;
    return kept.reduce((best, value) => (Math.abs(value - requested) < Math.abs(best - requested) ? value : best));
  }

  // The nearest kept seed and step, with a sentence for each that differs from the request.
  function run(scene, view) {
    const notes = [];
    const seeds = compareData.seedsOf(scene);
    const pictured = seeds.filter((seed) => compareData.stepsOf(scene, seed, view).length > 0);
    const wantedSeed = number("seed", -Infinity, Infinity, null);
    const seed = nearest(wantedSeed, seeds, pictured.length > 0 ? pictured : seeds, pictured[0] ?? seeds[0] ?? 0);
    if (wantedSeed !== null && seed !== wantedSeed) {
      notes.push(`No picture of seed ${wantedSeed} was kept of ${scene.name}; shown is seed ${seed}.`);
    }
    const steps = compareData.stepsOf(scene, seed, view);
    const own = compareData.stepsOf(scene, seed, view, state.get("method"));
    const wantedStep = number("step", 0, Infinity, null);
    const step = nearest(wantedStep, steps, own.length > 0 ? own : steps, steps.at(-1) ?? null);
    if (wantedStep !== null && step !== null && step !== wantedStep) {
      notes.push(`No picture of step ${wantedStep} was kept; shown is the nearest, step ${step}.`);
    }
    return { seed, seeds, step, steps, notes };
  }

  // The items that the reader has not filtered out, or all if none would be left.
  function allowed(items, isAllowed) {
    const left = items.filter(isAllowed);
    return left.length > 0 ? left : items;
  }

  function sceneIn(data, notes) {
    const every = data.scenes.filter(({ views }) => views.length > 0);
    const scenes = allowed(every, ({ name }) => filter.allows(name, null));
    const wanted = state.get("scene");
    const scene = scenes.find(({ name }) => name === wanted) ?? scenes[0];
    if (wanted !== null && scene.name !== wanted) {
      const isOut = every.some(({ name }) => name === wanted);
      notes.push(`${isOut ? `${wanted} is filtered out` : `There are no pictures of ${wanted}`}; shown is ${scene.name}.`);
    }
    return { scenes, scene };
  }

  function from(data) {
    const notes = [];
    const { scenes, scene } = sceneIn(data, notes);
    const view = viewIn(scene);
    const shown = scene.views[view];
    const { notes: ofRun, ...cell } = run(scene, view);
    const [truth, ...rendered] = compareData.images(data, scene, view, cell.seed, cell.step);
    const images = [truth, ...allowed(rendered, (image) => filter.allows(null, image.method))];
    const ids = images.map(({ id }) => id);
    const method = known("method", ids.slice(1), null);
    const a = known("compare.a", ids, compareData.TRUTH);
    const other = method && method !== a ? method : (ids.filter((id) => id !== a).at(-1) ?? a);
    const maps = new Set((state.get("compare.map") ?? "").split(" ").filter((name) => errorMaps.namesOf(shown).includes(name)));
    const [column, row] = (state.get("compare.pixel") ?? "").split(",").map((text) => within(text, 0, 1e6, NaN));
    const inside = Number.isInteger(column) && Number.isInteger(row) && column < shown.width && row < shown.height;
    return {
      ...cell, scenes, scene, view, shown, images, method, a,
      notes: [...notes, ...ofRun],
      b: known("compare.b", ids, other),
      mode: known("compare.mode", Object.keys(MODES), "side"),
      maps: maps.size > 0 ? [...maps] : ["colour"],
      scale: Math.round(number("compare.range", -6, 3, 0)),
      stops: number("compare.ev", -EXPOSURES, EXPOSURES, 0),
      wipe: number("compare.wipe", 0, 1, 0.5),
      zoom: number("compare.zoom", 1, 256, 1),
      x: number("compare.x", 0, 1, 0.5),
      y: number("compare.y", 0, 1, 0.5),
      pixel: inside ? [column, row] : null,
    };
  }

  return { MODES, EXPOSURES, from };
})();
