// Small pictures of a run and of the truth in the panel of the run; drawn once they become visible.
const thumbnails = (() => {
  function thumbnail(image, words) {
    const { width, height, name } = image.view;
    const canvas = element("canvas", { width, height, role: "img", "aria-label": `${image.name}, view ${name}` });
    const near = new IntersectionObserver(async (seen) => {
      if (!seen.some(({ isIntersecting }) => isIntersecting)) return;
      near.disconnect();
      try {
        const bytes = compareData.exposed(await compareData.load(image), 0);
        canvas.getContext("2d").putImageData(new ImageData(bytes, width, height), 0, 0);
        canvas.dataset.drawn = "";
      } catch (error) {
        canvas.replaceWith(error.message);
      }
    });
    near.observe(canvas);
    return element("span", { class: "thumbnail" }, canvas, element("small", {}, words));
  }

  // The truth and the run's picture at `step`, or at its last step, of the first view with such a picture; empty if the
  // page has no picture of the run.
  function of(cell, step) {
    const data = compareData.read();
    const scene = data?.scenes.find(({ name }) => name === cell.scene);
    const own = scene?.renders.filter(({ method, seed }) => method === cell.method && seed === cell.seed) ?? [];
    if (own.length === 0) return [];
    const latest = Math.max(...own.map((render) => render.step));
    const at = own.some((render) => render.step === step) ? step : latest;
    const { view } = own.find((render) => render.step === at);
    const [truth, ...rest] = compareData.images(data, scene, view, cell.seed, at);
    return [thumbnail(truth, "ground truth"), thumbnail(rest.find(({ method }) => method === cell.method), `step ${at}`)];
  }
  return { of };
})();
