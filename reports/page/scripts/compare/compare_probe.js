// The numbers of one pixel in every picture: a table, and a sentence for those who do not see it.
const compareProbe = (() => {
  const { swatch } = comparePanel;
  const NONE = "–";
  const { fixed } = numbers;

  const triple = (values, digits) => values.map((v) => fixed(v, digits).padStart(digits + 2)).join(" ");
  const errorsAt = (one, truth, place) =>
    one.planes.map((plane, which) => fixed(plane[place] - truth.planes[which][place], 4).padStart(7)).join(" ");
  const bytes = (picture, place) => picture.planes.map((plane) => Math.round(255 * plane[place]));
  const light = (values) =>
    values.map((v) => fixed(v, v >= 100 ? 1 : v >= 0.001 || v === 0 ? 4 : 6).padStart(6)).join(" ");

  const COLUMNS = [
    ["display 0–255", (one, place) => bytes(one, place).map((v) => String(v).padStart(3)).join(" ")],
    ["display 0–1", (one, place) => triple(one.planes.map((plane) => plane[place]), 4)],
    ["linear", (one, place) => light(compareData.linearAt(one, place))],
    ["opacity", (one, place) => (one.opacity ? fixed(one.opacity[place], 3) : NONE)],
    ["depth", (one, place) => (one.depth && !(one.isTruth && one.depth[place] === 0) ? fixed(one.depth[place], 3) : NONE)],
    [
      "error, display",
      (one, place, truth) =>
        one === truth || !truth ? NONE : errorsAt(one, truth, place),
    ],
  ];

  function probe(place, live) {
    // `loaded`: each image with its numbers, or null; `maps`: [{ title, value(image, place) }] of the panels that are shown.
    function show(choice, pixel, loaded, maps, aloud) {
      const at = pixel ? pixel[1] * choice.shown.width + pixel[0] : null;
      const truth = loaded[0];
      const heads = [pixel ? `pixel ${pixel[0]}, ${pixel[1]}` : "point at a pixel", ...COLUMNS.map(([title]) => title), ...maps.map((one) => one.title)];
      const rows = choice.images.map((image, which) => {
        const numbers = loaded[which];
        const cells = COLUMNS.map(([, of]) => (pixel && numbers ? of(numbers, at, truth) : NONE));
        const own = maps.map((one) => (pixel ? one.value(image, at) : NONE));
        return element(
          "tr",
          { "data-image": image.id },
          element("th", { scope: "row" }, swatch(image.variable), image.name),
          ...[...cells, ...own].map((text) => element("td", {}, text)),
        );
      });
      const table = element(
        "table",
        {},
        element("thead", {}, element("tr", {}, ...heads.map((text) => element("th", { scope: "col" }, text)))),
        element("tbody", {}, ...rows),
      );
      place.replaceChildren(table);
      if (aloud && pixel) live.textContent = sentence(choice, pixel, loaded, at);
    }

    return { show };
  }

  function sentence(choice, pixel, loaded, at) {
    const each = choice.images.map((image, which) =>
      loaded[which] ? `${image.name} ${bytes(loaded[which], at).join(" ")}` : `${image.name} not there`,
    );
    return `Pixel ${pixel[0]}, ${pixel[1]}: ${each.join("; ")}.`;
  }

  return { probe, bytes };
})();
