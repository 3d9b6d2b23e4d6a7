// The pictures that the page holds: which there are of a scene, view, seed and step, and loading one with its figures.
const compareData = (() => {
  const TRUTH = "truth";
  const LIMIT = 256e6;
  const bytesOf = (picture) =>
    [picture.colour, ...picture.planes, picture.opacity, picture.depth, picture.linear].reduce(
      (sum, one) => sum + (one?.byteLength ?? 0),
      0,
    );
  const remember = kept.memory(LIMIT, bytesOf);

  let data = null;
  function read() {
    data ??= element.data("pictures-data", null);
    return data && data.scenes.some((scene) => scene.views.length) ? data : null;
  }

  const idOf = (method) => (method === TRUTH ? `method ${TRUTH}` : method);
  const sorted = (values) => [...new Set(values)].sort((one, other) => one - other);
  const seedsOf = (scene) => sorted([...scene.renders, ...scene.missing].map((one) => one.seed));

  // Steps of which a scene, seed and view has a picture by any method.
  const stepsOf = (scene, seed, view) =>
    sorted(scene.renders.filter((one) => one.seed === seed && one.view === view).map((one) => one.step));

  const nearest = (values, wanted) =>
    values.reduce((best, one) => (Math.abs(one - wanted) < Math.abs(best - wanted) ? one : best), values[0]);

  // Ground truth and every method in order: { id, name, method, variable, refs, record } or, without refs, { why }.
  function images(data, scene, view, seed, step) {
    const shown = scene.views[view];
    const truth = { id: TRUTH, name: "ground truth", method: null, variable: null, view: shown, isTruth: true };
    const { display, linear, opacity, depth } = shown.truth;
    truth.refs = { colour: display, linear, opacity, depth };
    const methods = data.methods.map((method) => {
      const image = { id: idOf(method), name: method, method, variable: data.variables[method], view: shown };
      const own = scene.renders.filter((one) => one.method === method && one.seed === seed && one.view === view);
      const record = own.find((one) => one.step === step);
      if (record) return { ...image, record, refs: { ...record, linear: null } };
      const gone = scene.missing.find((one) => one.method === method && one.seed === seed);
      return { ...image, why: whyNot(method, seed, step, own, gone) };
    });
    return [truth, ...methods];
  }

  function whyNot(method, seed, step, own, gone) {
    const steps = own.map((one) => one.step);
    const instead = steps.length ? ` Kept: step ${steps.join(", ")}.` : "";
    if (gone) return `${gone.status.replaceAll("_", " ")}: ${gone.reason || "no reason recorded"}${instead && `.${instead}`}`;
    if (step === null) return `No picture of ${method}, seed ${seed}, was kept.`;
    return `No picture of ${method}, seed ${seed}, was kept at step ${step}.${instead}`;
  }

  function plane(raw, meaning, area, which) {
    const found = new Float32Array(area);
    for (let place = 0; place < area; place += 1) found[place] = meaning[raw[which * area + place]];
    return found;
  }

  async function fetched({ refs, view, isTruth }) {
    const { width, height } = view;
    const area = width * height;
    const raw = (ref) => (ref ? pixels.raw(ref, width, height) : null);
    const [colour, linear, opacity, depth] = await Promise.all(
      [refs.colour, refs.linear, refs.opacity, refs.depth].map(raw),
    );
    const shades = (found, ref) => found && plane(found, pixels.meanings(ref), area, 0);
    const meaning = pixels.meanings(refs.colour);
    return {
      width,
      height,
      isTruth: Boolean(isTruth),
      refs,
      colour,
      linear,
      planes: [0, 1, 2].map((which) => plane(colour, meaning, area, refs.colour.channels === 1 ? 0 : which)),
      opacity: shades(opacity, refs.opacity),
      depth: shades(depth, refs.depth),
    };
  }

  const keyOf = ({ refs }) =>
    [refs.colour, refs.linear, refs.opacity, refs.depth].map((ref) => `${ref?.file ?? ""}${ref?.id ?? ""}`).join(" ");

  // An image's numbers; rejects with a sentence.
  const load = (image) => remember(keyOf(image), () => fetched(image));

  // Linear light of one pixel, three numbers.
  function linearAt(picture, place) {
    if (!picture.linear) return picture.planes.map((one) => colourSpace.decode(one[place]));
    const meaning = lightOf(picture.refs.linear);
    const area = picture.width * picture.height;
    return [0, 1, 2].map((which) => meaning[picture.linear[which * area + place]]);
  }

  const tables = new WeakMap();
  function lightOf(ref) {
    if (!tables.has(ref)) tables.set(ref, pixels.meanings(ref));
    return tables.get(ref);
  }

  // Bytes RGBA of a picture `stops` brighter: its linear light × 2^stops, encoded again; at 0 its bytes as they are.
  function exposed(picture, stops) {
    const bright = picture.linear && stops !== 0;
    const [shades, ref] = bright ? [picture.linear, picture.refs.linear] : [picture.colour, picture.refs.colour];
    const light = bright ? lightOf(ref) : pixels.meanings(ref).map(colourSpace.decode);
    const table = Uint8Array.from(light, (v) => Math.round(255 * colourSpace.encode(v * 2 ** stops)));
    const area = picture.width * picture.height;
    const bytes = new Uint8ClampedArray(4 * area).fill(255);
    for (let which = 0; which < 3; which += 1) {
      const start = ref.channels === 1 ? 0 : which * area;
      for (let place = 0; place < area; place += 1) bytes[4 * place + which] = table[shades[start + place]];
    }
    return bytes;
  }

  return { TRUTH, read, images, seedsOf, stepsOf, nearest, load, keyOf, linearAt, exposed };
})();
