// The numbers of a pixel in every picture: a table, and a sentence for screen readers.
const compareProbe = (() => {
  const NONE = numbers.NOTHING;
  const { fixed } = numbers;

  const bytes = (picture, place) => picture.planes.map((plane) => Math.round(255 * plane[place]));
  const light = (values) =>
    values.map((v) => fixed(v, v >= 100 ? 1 : v >= 0.001 || v === 0 ? 4 : 6).padStart(6)).join(" ");
  const errors = (picture, truth, place) =>
    picture.planes.map((plane, which) => fixed(plane[place] - truth.planes[which][place], 4).padStart(7)).join(" ");

  const COLUMNS = [
    ["display 0–255", (picture, place) => bytes(picture, place).map((v) => String(v).padStart(3)).join(" ")],
    ["linear", (picture, place) => light(compareData.linearAt(picture, place))],
    ["opacity", (picture, place) => (picture.opacity ? fixed(picture.opacity[place], 3) : NONE)],
    ["depth", ({ depth, isTruth }, place) => (depth && !(isTruth && depth[place] === 0) ? fixed(depth[place], 3) : NONE)],
    ["error, display", (picture, place, truth) => (truth && picture !== truth ? errors(picture, truth, place) : NONE)],
  ];

  // `loaded`: the numbers of each image, or null; `maps`: [{ title, values }] of the visible panels, with the values of
  // each image by its id.
  function table(choice, pixel, loaded, maps) {
    const place = pixel ? pixel[1] * choice.shown.width + pixel[0] : null;
    const where = pixel ? `pixel ${pixel[0]}, ${pixel[1]}` : "point at a pixel";
    const heads = [where, ...COLUMNS.map(([title]) => title), ...maps.map(({ title }) => title)];
    const rows = choice.images.map((image, which) => {
      const own = COLUMNS.map(([, of]) => (pixel && loaded[which] ? of(loaded[which], place, loaded[0]) : NONE));
      const ofMaps = maps.map(({ values }) => fixed(values.get(image.id)?.[place], 4));
      return element("tr", { "data-image": image.id },
        element("th", { scope: "row" }, element.swatch(image.variable), image.name),
        [...own, ...ofMaps].map((text) => element("td", {}, text)));
    });
    return element("table", {},
      element("thead", {}, element("tr", {}, heads.map((text) => element("th", { scope: "col" }, text)))),
      element("tbody", {}, rows));
  }

  function sentence(choice, pixel, loaded) {
    const place = pixel[1] * choice.shown.width + pixel[0];
    const each = choice.images.map(({ name }, which) =>
      `${name} ${loaded[which] ? bytes(loaded[which], place).join(" ") : "missing"}`);
    return `Pixel ${pixel[0]}, ${pixel[1]}: ${each.join("; ")}.`;
  }

  return { table, sentence };
})();
