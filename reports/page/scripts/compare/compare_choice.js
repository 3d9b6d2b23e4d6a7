// What the reader compares, as the address says it, made whole where it says nothing or asks for what was not kept.
const compareChoice = (() => {
  const MODES = { side: "Side by side", wipe: "Wipe", flip: "Flip", difference: "Difference" };
  const EXPOSURES = 10;

  // The number under a key of the address.
  const number = (key, least, most, otherwise) => within(state.get(key), least, most, otherwise);
  const within = (text, least, most, otherwise) => {
    const value = text === null || text.trim() === "" ? NaN : Number(text);
    return Number.isFinite(value) ? Math.min(most, Math.max(least, value)) : otherwise;
  };
  const known = (key, names, otherwise) => (names.includes(state.get(key)) ? state.get(key) : otherwise);

  // The view that the address names, by its name or else its place.
  function viewIn(scene) {
    const named = scene.views.findIndex(({ name }) => name === state.get("view"));
    const place = named >= 0 ? named : number("view", 0, Infinity, 0);
    return Number.isInteger(place) && place < scene.views.length ? place : 0;
  }

  // What was asked for among the values, else the nearest of those that were kept.
  function nearest(asked, values, kept, usual) {
    if (asked === null || kept.length === 0) return usual;
    if (values.includes(asked)) return asked;
    return kept.reduce((best, value) => (Math.abs(value - asked) < Math.abs(best - asked) ? value : best));
  }

  // Seed and step, the nearest that were kept, with a sentence for each that was asked for and was not.
  function run(scene, view) {
    const said = [];
    const seeds = compareData.seedsOf(scene);
    const pictured = seeds.filter((seed) => compareData.stepsOf(scene, seed, view).length > 0);
    const askedSeed = number("seed", -Infinity, Infinity, null);
    const seed = nearest(askedSeed, seeds, pictured.length > 0 ? pictured : seeds, pictured[0] ?? seeds[0] ?? 0);
    if (askedSeed !== null && seed !== askedSeed) {
      said.push(`No picture of seed ${askedSeed} was kept of ${scene.name}; shown is seed ${seed}.`);
    }
    const steps = compareData.stepsOf(scene, seed, view);
    const own = compareData.stepsOf(scene, seed, view, state.get("method"));
    const askedStep = number("step", 0, Infinity, null);
    const step = nearest(askedStep, steps, own.length > 0 ? own : steps, steps.at(-1) ?? null);
    if (askedStep !== null && step !== null && step !== askedStep) {
      said.push(`No picture of step ${askedStep} was kept; shown is the nearest, step ${step}.`);
    }
    return { seed, seeds, step, steps, said };
  }

  // Those that the reader has not filtered out, or all where none is left.
  function allowed(some, isAllowed) {
    const left = some.filter(isAllowed);
    return left.length > 0 ? left : some;
  }

  function sceneIn(data, said) {
    const every = data.scenes.filter(({ views }) => views.length > 0);
    const scenes = allowed(every, ({ name }) => filter.allows(name, null));
    const asked = state.get("scene");
    const scene = scenes.find(({ name }) => name === asked) ?? scenes[0];
    if (asked !== null && scene.name !== asked) {
      const isOut = every.some(({ name }) => name === asked);
      said.push(`${isOut ? `${asked} is filtered out` : `There are no pictures of ${asked}`}; shown is ${scene.name}.`);
    }
    return { scenes, scene };
  }

  function from(data) {
    const said = [];
    const { scenes, scene } = sceneIn(data, said);
    const view = viewIn(scene);
    const shown = scene.views[view];
    const { said: ofRun, ...cell } = run(scene, view);
    const [truth, ...rendered] = compareData.images(data, scene, view, cell.seed, cell.step);
    const images = [truth, ...allowed(rendered, (image) => filter.allows(null, image.method))];
    const ids = images.map(({ id }) => id);
    const method = known("method", ids.slice(1), null);
    const a = known("compare.a", ids, compareData.TRUTH);
    const usual = method && method !== a ? method : (ids.filter((id) => id !== a).at(-1) ?? a);
    const maps = new Set((state.get("compare.map") ?? "").split(" ").filter((name) => errorMaps.namesOf(shown).includes(name)));
    const [column, row] = (state.get("compare.pixel") ?? "").split(",").map((text) => within(text, 0, 1e6, NaN));
    const inside = Number.isInteger(column) && Number.isInteger(row) && column < shown.width && row < shown.height;
    return {
      ...cell, scenes, scene, view, shown, images, method, a,
      said: [...said, ...ofRun],
      b: known("compare.b", ids, usual),
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
