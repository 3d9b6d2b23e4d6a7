// What the reader compares, as the address says it, made whole where it says nothing or asks for what was not kept.
const compareChoice = (() => {
  const MODES = { side: "Side by side", wipe: "Wipe", flip: "Flip", difference: "Difference" };
  const EXPOSURES = 10;

  const number = (text, least, most, otherwise) => {
    const value = text === null || text.trim() === "" ? NaN : Number(text);
    return Number.isFinite(value) ? Math.min(most, Math.max(least, value)) : otherwise;
  };
  const known = (text, names, otherwise) => (names.includes(text) ? text : otherwise);

  // The view that a text names, by its name or else its place.
  function viewIn(scene, text) {
    const named = scene.views.findIndex((one) => one.name === text);
    if (named >= 0) return named;
    const place = number(text, 0, Infinity, 0);
    return Number.isInteger(place) && place < scene.views.length ? place : 0;
  }

  // Seed and step, the nearest that were kept, with a sentence for each that was asked for and was not.
  function run(scene, view, get) {
    const said = [];
    const seeds = compareData.seedsOf(scene);
    const pictured = seeds.filter((one) => compareData.stepsOf(scene, one, view).length);
    const method = get("method");
    const askedSeed = number(get("seed"), -Infinity, Infinity, null);
    const seed =
      askedSeed === null || !seeds.length
        ? (pictured[0] ?? seeds[0] ?? 0)
        : seeds.includes(askedSeed)
          ? askedSeed
          : compareData.nearest(pictured.length ? pictured : seeds, askedSeed);
    if (askedSeed !== null && seed !== askedSeed) {
      said.push(`No picture of seed ${askedSeed} was kept of ${scene.name}; shown is seed ${seed}.`);
    }
    const steps = compareData.stepsOf(scene, seed, view);
    const own = scene.renders.filter((one) => one.method === method && one.seed === seed && one.view === view);
    const askedStep = number(get("step"), 0, Infinity, null);
    const candidates = own.length ? own.map((one) => one.step) : steps;
    const step = !steps.length
      ? null
      : askedStep === null
        ? steps.at(-1)
        : steps.includes(askedStep)
          ? askedStep
          : compareData.nearest(candidates, askedStep);
    if (askedStep !== null && step !== null && step !== askedStep) {
      said.push(`No picture of step ${askedStep} was kept; shown is the nearest, step ${step}.`);
    }
    return { seed, seeds, step, steps, said };
  }

  // Those that the reader has not filtered out, or all where none is left.
  function shownOf(some, allowed) {
    const left = some.filter(allowed);
    return left.length > 0 ? left : some;
  }

  const instead = (data, asked) =>
    data.scenes.some((one) => one.name === asked && one.views.length) ? `${asked} is filtered out` : `There are no pictures of ${asked}`;

  function from(data, get) {
    const scenes = shownOf(data.scenes.filter((one) => one.views.length), (one) => filter.allows(one.name, null));
    const asked = get("scene");
    const scene = scenes.find((one) => one.name === asked) ?? scenes[0];
    const view = viewIn(scene, get("view"));
    const { said, ...cell } = run(scene, view, get);
    if (asked !== null && scene.name !== asked) said.unshift(`${instead(data, asked)}; shown is ${scene.name}.`);
    const [truth, ...rendered] = compareData.images(data, scene, view, cell.seed, cell.step);
    const images = [truth, ...shownOf(rendered, (one) => filter.allows(null, one.method))];
    const ids = images.map((one) => one.id);
    const method = ids.slice(1).find((id) => id === get("method"));
    const a = known(get("compare.a"), ids, compareData.TRUTH);
    const others = ids.filter((id) => id !== a);
    const b = known(get("compare.b"), ids, method && method !== a ? method : (others.at(-1) ?? a));
    const maps = (get("compare.map") ?? "").split(" ").filter((one) => Object.hasOwn(errorMaps.MAPS, one));
    const [column, row] = (get("compare.pixel") ?? "").split(",").map((text) => number(text, 0, 1e6, NaN));
    const shown = scene.views[view];
    const inside = Number.isInteger(column) && Number.isInteger(row) && column < shown.width && row < shown.height;
    return {
      ...cell,
      said,
      scenes,
      scene,
      view,
      shown,
      images,
      method: method ?? null,
      mode: known(get("compare.mode"), Object.keys(MODES), "side"),
      a,
      b,
      maps: maps.length ? [...new Set(maps)] : ["colour"],
      channel: known(get("compare.channel"), Object.keys(errorMaps.CHANNELS), "all"),
      scale: Math.round(number(get("compare.range"), -6, 3, 0)),
      stops: number(get("compare.ev"), -EXPOSURES, EXPOSURES, 0),
      wipe: number(get("compare.wipe"), 0, 1, 0.5),
      zoom: number(get("compare.zoom"), 1, 256, 1),
      x: number(get("compare.x"), 0, 1, 0.5),
      y: number(get("compare.y"), 0, 1, 0.5),
      pixel: inside ? [column, row] : null,
    };
  }

  return { MODES, EXPOSURES, from };
})();
