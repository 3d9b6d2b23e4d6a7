// The pictures of the page: those of a scene, view, seed and step, and loading one with its numbers.
const compareData = (() => {
  const TRUTH = "truth";
  const PARTS = ["colour", "linear", "opacity", "depth"];
  const remember = kept.memory(256e6, (picture) =>
    [...PARTS.map((part) => picture[part]), ...picture.planes].reduce((sum, part) => sum + (part?.byteLength ?? 0), 0));

  let data = null;
  function read() {
    data ??= element.data("pictures-data", null);
    return data && data.scenes.some((scene) => scene.views.length) ? data : null;
  }

  const sorted = (values) => [...new Set(values)].sort((a, b) => a - b);
  const seedsOf = (scene) => sorted([...scene.renders, ...scene.missing].map(({ seed }) => seed));

  const rendersOf = (scene, seed, view, method) =>
    scene.renders.filter((render) => render.seed === seed && render.view === view && (!method || render.method === method));

  // The steps with a picture of a scene, seed and view, by any method or by `method`.
  const stepsOf = (scene, seed, view, method) => sorted(rendersOf(scene, seed, view, method).map(({ step }) => step));

  // Ground truth and every method in order: { id, name, method, variable, refs, record }, or { why } instead of refs.
  function images(data, scene, view, seed, step) {
    const shown = scene.views[view];
    const { display, ...others } = shown.truth;
    const truth = { id: TRUTH, name: "ground truth", method: null, variable: null, view: shown, isTruth: true, refs: { ...others, colour: display } };
    const methods = data.methods.map((method) => {
      const id = method === TRUTH ? `method ${TRUTH}` : method;
      const image = { id, name: method, method, variable: data.variables[method], view: shown };
      const record = rendersOf(scene, seed, view, method).find((render) => render.step === step);
      if (record) return { ...image, record, refs: { ...record, linear: null } };
      return { ...image, why: whyNot(scene, view, method, seed, step) };
    });
    return [truth, ...methods];
  }

  function whyNot(scene, view, method, seed, step) {
    const steps = stepsOf(scene, seed, view, method);
    const missing = scene.missing.find((cell) => cell.method === method && cell.seed === seed);
    const instead = steps.length > 0 ? ` Kept: step ${steps.join(", ")}.` : "";
    if (missing) return `${missing.status.replaceAll("_", " ")}: ${missing.reason || "no reason recorded"}${instead && `.${instead}`}`;
    if (step === null) return `No picture of ${method}, seed ${seed}, was kept.`;
    return `No picture of ${method}, seed ${seed}, was kept at step ${step}.${instead}`;
  }

  function plane(raw, ref, area, which = 0) {
    const meaning = pixels.meanings(ref);
    return Float32Array.from({ length: area }, (_, place) => meaning[raw[which * area + place]]);
  }

  async function fetchPicture({ refs, view: { width, height }, isTruth = false }) {
    const area = width * height;
    const raw = await Promise.all(PARTS.map((part) => (refs[part] ? pixels.raw(refs[part], width, height) : null)));
    const [colour, linear, opacity, depth] = raw;
    const planes = [0, 1, 2].map((which) => plane(colour, refs.colour, area, refs.colour.channels === 1 ? 0 : which));
    return {
      width, height, isTruth, refs, colour, linear, planes,
      // three planes of linear light, computed when a map needs them
      get light() {
        return planes.map((values, which) => (linear ? plane(linear, refs.linear, area, which) : values.map(colourSpace.decode)));
      },
      opacity: opacity && plane(opacity, refs.opacity, area),
      depth: depth && plane(depth, refs.depth, area),
    };
  }

  const keyOf = ({ refs }) => PARTS.map((part) => `${refs[part]?.file ?? ""}${refs[part]?.id ?? ""}`).join(" ");

  // The numbers of an image; rejects with a sentence.
  const load = (image) => (image.refs ? remember(keyOf(image), () => fetchPicture(image)) : Promise.reject(new Error(image.why)));

  // Linear light of one pixel, three numbers.
  function linearAt(picture, place) {
    if (!picture.linear) return picture.planes.map((values) => colourSpace.decode(values[place]));
    const meaning = pixels.meanings(picture.refs.linear);
    return [0, 1, 2].map((which) => meaning[picture.linear[which * picture.width * picture.height + place]]);
  }

  // Bytes RGBA of a picture `stops` brighter: its linear light × 2^stops, encoded again; at 0 its bytes as they are.
  function exposed(picture, stops) {
    const bright = picture.linear && stops !== 0;
    const [shades, ref] = bright ? [picture.linear, picture.refs.linear] : [picture.colour, picture.refs.colour];
    const light = bright ? pixels.meanings(ref) : pixels.meanings(ref).map(colourSpace.decode);
    const table = Uint8Array.from(light, (v) => Math.round(255 * colourSpace.encode(v * 2 ** stops)));
    const area = picture.width * picture.height;
    const bytes = new Uint8ClampedArray(4 * area).fill(255);
    for (let which = 0; which < 3; which += 1) {
      const start = ref.channels === 1 ? 0 : which * area;
      for (let place = 0; place < area; place += 1) bytes[4 * place + which] = table[shades[start + place]];
    }
    return bytes;
  }

  return { TRUTH, read, images, seedsOf, stepsOf, load, keyOf, linearAt, exposed };
})();
