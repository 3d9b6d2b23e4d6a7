// The content of a panel: a picture or one of its maps as a bitmap, with figures.
const compareLayers = (() => {
  const remember = kept.memory(96e6, (values) => values.byteLength);

  function bitmap(bytes, { width, height }) {
    const made = element("canvas", { width, height });
    made.getContext("2d").putImageData(new ImageData(bytes, width, height), 0, 0);
    return made;
  }

  // { bitmap, said, values } of a map of `image` against another; rejects with a sentence if there is nothing to show.
  // An image has no error against itself and shows its colour instead.
  async function layer(requested, image, against, choice) {
    const name = image === against && !errorMaps.MAPS[requested].alone ? "colour" : requested;
    const map = errorMaps.MAPS[name];
    const other = map.alone ? image : against;
    const [truth] = choice.images;
    const [test, reference, opaque] = await Promise.all([image, other, truth].map(compareData.load));
    const withoutDepth = map.depth && [image, other].find(({ refs }) => !refs.depth);
    if (withoutDepth) throw new Error(`No depth was kept of ${withoutDepth.name}.`);
    const pair = { test, truth: reference, opaque: opaque.opacity };
    const record = against.isTruth ? image.record : null;
    if (name === "colour") {
      const said = image === against ? "" : map.said(null, pair, record);
      return { bitmap: bitmap(compareData.exposed(test, choice.stops), test), said, values: null };
    }
    const key = [name, ...[image, other].map(compareData.keyOf)].join(" | ");
    const values = await remember(key, () => chunks.run(map.work(pair)));
    const ends = errorMaps.endsOf(name, choice.scale, choice.shown);
    const bytes = colourMaps.paint(values, map.colours, ...ends);
    return { bitmap: bitmap(bytes, test), said: map.said(values, pair, record), values };
  }

  return { layer };
})();
