// One panel: a caption, a canvas and its figures. It draws what it is given and knows nothing of where that is from.
const comparePanel = (() => {
  const NUMBERS_FROM = 46;

  function swatch(variable) {
    const mark = element("i", { class: "swatch", "aria-hidden": "true" });
    mark.style.background = variable ? `var(${variable})` : "var(--ink)";
    return mark;
  }

  function sized(canvas) {
    const box = canvas.getBoundingClientRect();
    const ratio = globalThis.devicePixelRatio || 1;
    const [width, height] = [Math.max(1, Math.round(box.width * ratio)), Math.max(1, Math.round(box.height * ratio))];
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
    return { width: box.width, height: box.height, ratio };
  }

  // Draws bitmaps from left to right: the second one from `wipe` (0 … 1 of the panel) on.
  function draw(context, size, bitmaps, at, wipe, pixel) {
    const picture = bitmaps.find(Boolean);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, context.canvas.width, context.canvas.height);
    if (!picture) return;
    const { scale, left, top } = zoom.placed(at, size, picture);
    context.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    context.imageSmoothingEnabled = scale * size.ratio < 1;
    context.imageSmoothingQuality = "high";
    bitmaps.forEach((bitmap, place) => {
      if (!bitmap) return;
      context.save();
      if (bitmaps.length === 2) {
        const edge = wipe * size.width;
        context.beginPath();
        context.rect(place ? edge : 0, 0, place ? size.width - edge : edge, size.height);
        context.clip();
      }
      context.drawImage(bitmap, left, top, bitmap.width * scale, bitmap.height * scale);
      context.restore();
    });
    if (pixel) mark(context, left + pixel[0] * scale, top + pixel[1] * scale, scale);
  }

  // A frame about a pixel, light on dark, so that it is seen on any ground.
  function mark(context, x, y, scale) {
    const side = Math.max(scale, 9);
    const [left, top] = [x + (scale - side) / 2, y + (scale - side) / 2];
    for (const [width, colour] of [
      [3, "#000"],
      [1.25, "#fff"],
    ]) {
      context.lineWidth = width;
      context.strokeStyle = colour;
      context.strokeRect(left, top, side, side);
    }
  }

  // The number in each pixel, where pixels are large enough; `textOf(place)` gives its lines.
  function figures(context, size, picture, at, textOf) {
    const { scale, left, top } = zoom.placed(at, size, picture);
    if (scale < NUMBERS_FROM) return;
    const first = (corner) => Math.max(0, Math.floor(-corner / scale));
    const last = (corner, room, length) => Math.min(length, Math.ceil((room - corner) / scale));
    context.font = `${Math.min(13, scale / 4.6)}px ui-monospace, monospace`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 2.5;
    context.strokeStyle = "rgb(0 0 0 / 70%)";
    context.fillStyle = "#fff";
    for (let row = first(top); row < last(top, size.height, picture.height); row += 1) {
      for (let column = first(left); column < last(left, size.width, picture.width); column += 1) {
        const lines = textOf(row * picture.width + column);
        lines.forEach((line, place) => {
          const y = top + (row + 0.5) * scale + (place - (lines.length - 1) / 2) * Math.min(15, scale / 4);
          context.strokeText(line, left + (column + 0.5) * scale, y);
          context.fillText(line, left + (column + 0.5) * scale, y);
        });
      }
    }
  }

  // What is seen of a panel as a canvas of its own, every picture pixel an equal number of pixels wide.
  function copy(size, bitmaps, at, wipe) {
    const picture = bitmaps.find(Boolean);
    const { scale } = zoom.placed(at, size, picture);
    const seen = {
      width: Math.min(picture.width, Math.round(size.width / scale)),
      height: Math.min(picture.height, Math.round(size.height / scale)),
    };
    const times = Math.max(1, Math.ceil(512 / Math.max(seen.width, seen.height)));
    const canvas = element("canvas", { width: seen.width * times, height: seen.height * times });
    const own = { width: canvas.width, height: canvas.height, ratio: 1 };
    const zoomed = Math.max(picture.width / seen.width, picture.height / seen.height);
    const whole = Math.min(own.width / picture.width, own.height / picture.height);
    const steady = (value, length, room) => {
      const corner = Math.round(room / 2 / times - value * length);
      return (room / 2 / times - corner) / length;
    };
    const place = {
      zoom: zoomed === 1 ? 1 : times / whole,
      x: steady(at.x, picture.width, own.width),
      y: steady(at.y, picture.height, own.height),
    };
    draw(canvas.getContext("2d"), own, bitmaps, place, wipe, null);
    return canvas;
  }

  function panel(about) {
    const canvas = element("canvas", { role: "img", "aria-label": about.label });
    const frame = element("div", { class: "frame" }, canvas);
    const said = element("p", { class: "said" });
    const why = element("p", { class: "why", hidden: true });
    frame.append(why);
    const title = element("figcaption", {}, ...about.title);
    const figure = element("figure", { class: "pane", "data-panel": about.key }, title, frame, said);
    const one = { figure, canvas, frame, title, layers: [], size: null };

    one.show = (layers) => {
      one.layers = layers;
      one.canvas.hidden = !layers.some(Boolean);
      figure.removeAttribute("aria-busy");
    };
    one.say = (text, reason) => {
      said.textContent = text;
      why.textContent = reason ?? "";
      why.hidden = !reason;
    };
    one.paint = (at, wipe, pixel, textOf) => {
      one.size = sized(canvas);
      const context = canvas.getContext("2d");
      const bitmaps = one.layers.map((layer) => layer?.bitmap);
      draw(context, one.size, bitmaps, at, wipe, pixel);
      if (bitmaps.length === 1 && bitmaps[0]) {
        figures(context, one.size, bitmaps[0], at, (place) => textOf(one.layers[0], place));
      }
    };
    return one;
  }

  return { swatch, panel, copy };
})();
