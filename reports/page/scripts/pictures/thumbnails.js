// Small pictures of a run beside the truth, where the run itself is told of; drawn once they come into sight.
const thumbnails = (() => {
  // The run's picture at `step`, or its last, of the first view of which there is one, and the truth of that view.
  function chosen(cell, step) {
    const data = compareData.read();
    const scene = data?.scenes.find((one) => one.name === cell.scene);
    const own = scene?.renders.filter((one) => one.method === cell.method && one.seed === cell.seed) ?? [];
    if (!own.length) return [];
    const steps = own.map((one) => one.step);
    const at = steps.includes(step) ? step : Math.max(...steps);
    const { view } = own.find((one) => one.step === at);
    const [truth, ...rest] = compareData.images(data, scene, view, cell.seed, at);
    return [{ ...truth, said: "ground truth" }, { ...rest.find((one) => one.method === cell.method), said: `step ${at}` }];
  }

  async function draw(canvas, image) {
    const picture = await compareData.load(image);
    const bytes = compareData.exposed(picture, 0);
    canvas.getContext("2d").putImageData(new ImageData(bytes, picture.width, picture.height), 0, 0);
    canvas.dataset.drawn = "";
  }

  function thumbnail(image) {
    const { width, height } = image.view;
    const canvas = element("canvas", { width, height, role: "img", "aria-label": `${image.name}, view ${image.view.name}` });
    const said = element("small", {}, image.said);
    const near = new IntersectionObserver((seen) => {
      if (!seen.some((one) => one.isIntersecting)) return;
      near.disconnect();
      draw(canvas, image).catch((error) => canvas.replaceWith(error.message));
    });
    near.observe(canvas);
    return element("span", { class: "thumbnail" }, canvas, said);
  }

  // None where no picture of the run is in the page.
  const of = (cell, step) => chosen(cell, step).map(thumbnail);
  return { of };
})();
