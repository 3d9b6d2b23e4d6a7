// What a panel draws: a picture or one of its maps as a bitmap, with figures and a legend.
const compareLayers = (() => {
  const remember = kept.memory(96e6, (values) => values.byteLength);
  const painted = kept.memory(96e6, (bitmap) => 4 * bitmap.width * bitmap.height);

  // Which map is drawn of an image: it has no error against itself and shows its colour there.
  const mapOf = (name, image, against) => (image === against && !errorMaps.MAPS[name].alone ? "colour" : name);

  function missing(name, image, against) {
    const { MAPS } = errorMaps;
    const parts = MAPS[name].needs ?? [];
    for (const one of [image, ...(MAPS[name].alone ? [] : [against])]) {
      if (!one.refs) return one.why;
      if (parts.includes("depth") && !one.refs.depth) return `No depth was kept of the ${one.name}.`;
    }
    return null;
  }

  // The numbers of a map of `image` against another, a Promise of Float32Array.
  async function valuesOf(name, image, against, truth, channel) {
    const map = errorMaps.MAPS[name];
    const key = [name, map.channelled ? channel : "", ...[image, against].map(compareData.keyOf)].join(" | ");
    return remember(key, async () => {
      const [test, reference, opaque] = await Promise.all([image, against, truth].map(compareData.load));
      return chunks.run(map.work({ test, truth: reference, opaque: opaque.opacity }, channel));
    });
  }

  function bitmap(bytes, width, height) {
    const made = document.createElement("canvas");
    made.width = width;
    made.height = height;
    made.getContext("2d", { willReadFrequently: true }).putImageData(new ImageData(bytes, width, height), 0, 0);
    return made;
  }

  // { bitmap, said, values }; rejects with a sentence where there is nothing to show.
  async function layer(name, image, against, choice) {
    const map = errorMaps.MAPS[name];
    const why = missing(name, image, against);
    if (why) throw new Error(why);
    const [truth] = choice.images;
    const picture = await compareData.load(image);
    const { width, height } = picture;
    const pair = image === against || map.alone ? null : { test: picture, truth: await compareData.load(against) };
    const record = against.isTruth ? image.record : null;
    if (name === "colour") {
      const key = `colour ${choice.stops} ${compareData.keyOf(image)}`;
      const drawn = await painted(key, async () => bitmap(compareData.exposed(picture, choice.stops), width, height));
      const shades = (place) => drawn.getContext("2d").getImageData(place % width, Math.floor(place / width), 1, 1).data;
      return { bitmap: drawn, said: map.said(null, pair, record), values: null, shades };
    }
    const values = await valuesOf(name, image, map.alone ? image : against, truth, choice.channel);
    const ends = errorMaps.endsOf(name, choice.scale, choice.shown);
    const key = [name, choice.channel, ...ends, ...[image, against].map(compareData.keyOf)].join(" ");
    const drawn = await painted(key, async () => bitmap(colourMaps.paint(values, map.colours, ...ends), width, height));
    return { bitmap: drawn, said: map.said(values, pair, record, choice.channel), values };
  }

  return { mapOf, layer };
})();
