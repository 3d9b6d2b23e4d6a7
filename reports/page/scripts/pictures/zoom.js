// Where a picture lies in its panel, and how pointer and wheel move it. `at` is { zoom, x, y }: times the size at which
// the whole picture fits, and the point of the picture, 0 … 1, in the middle of the panel: the same for all panels.
const zoom = (() => {
  const MOST = 256;
  const limit = (value, least, most) => Math.min(most, Math.max(least, value));

  // CSS pixels a picture pixel, and where in the panel the picture's corner lies.
  function placed(at, panel, picture) {
    const scale = Math.min(panel.width / picture.width, panel.height / picture.height) * at.zoom;
    return {
      scale,
      left: panel.width / 2 - at.x * picture.width * scale,
      top: panel.height / 2 - at.y * picture.height * scale,
    };
  }

  // The same, without showing more of what lies beside the picture than needed.
  function kept(at, panel, picture) {
    const wanted = limit(at.zoom, 1, MOST);
    const { scale } = placed({ ...at, zoom: wanted }, panel, picture);
    const along = (value, length, room) => {
      const half = room / 2 / (length * scale);
      return half >= 0.5 ? 0.5 : limit(value, half, 1 - half);
    };
    return {
      zoom: wanted,
      x: along(at.x, picture.width, panel.width),
      y: along(at.y, picture.height, panel.height),
    };
  }

  // Closer by a factor; what lies under `point` of the panel stays there.
  function closer(at, factor, point, panel, picture) {
    const before = placed(at, panel, picture);
    const wanted = limit(at.zoom * factor, 1, MOST);
    const { scale } = placed({ ...at, zoom: wanted }, panel, picture);
    const stays = (place, corner, length, room) =>
      ((place - corner) / before.scale - (place - room / 2) / scale) / length;
    return kept(
      {
        zoom: wanted,
        x: stays(point.x, before.left, picture.width, panel.width),
        y: stays(point.y, before.top, picture.height, panel.height),
      },
      panel,
      picture,
    );
  }

  // The picture moved by so many CSS pixels.
  function moved(at, dx, dy, panel, picture) {
    const { scale } = placed(at, panel, picture);
    const x = at.x - dx / (picture.width * scale);
    return kept({ zoom: at.zoom, x, y: at.y - dy / (picture.height * scale) }, panel, picture);
  }

  // Moved no farther than needed for a pixel [column, row] to be seen.
  function showing(at, [column, row], panel, picture) {
    const { scale, left, top } = placed(at, panel, picture);
    const short = (start, room) => {
      const margin = Math.min(scale, room / 4);
      if (start < margin) return margin - start;
      return Math.min(0, room - margin - (start + scale));
    };
    return moved(at, short(left + column * scale, panel.width), short(top + row * scale, panel.height), panel, picture);
  }

  // The pixel [column, row] under a point of the panel, or null beside the picture.
  function pixelAt(at, point, panel, picture) {
    const { scale, left, top } = placed(at, panel, picture);
    const column = Math.floor((point.x - left) / scale);
    const row = Math.floor((point.y - top) / scale);
    const inside = column >= 0 && row >= 0 && column < picture.width && row < picture.height;
    return inside ? [column, row] : null;
  }

  // Tells `to` of what pointers do on a canvas: closer(factor, point), drag(dx, dy), hover(point), tap(point), fit();
  // hover(null) once the pointer has left.
  // The wheel is the page's own until the reader has clicked (`to.listening()`), unless Ctrl is held.
  function follow(canvas, to) {
    const down = new Map();
    let travelled = 0;
    const pointOf = (event) => {
      const box = canvas.getBoundingClientRect();
      return { x: event.clientX - box.left, y: event.clientY - box.top };
    };
    const spread = () => {
      const [one, other] = [...down.values()];
      return Math.hypot(one.x - other.x, one.y - other.y);
    };

    canvas.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && !to.listening()) return;
        event.preventDefault();
        const lines = event.deltaY * (event.deltaMode === 1 ? 33 : 1);
        to.closer(2 ** (-lines / 240), pointOf(event));
      },
      { passive: false },
    );
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      if (down.size === 0) travelled = 0;
      down.set(event.pointerId, pointOf(event));
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      const point = pointOf(event);
      const last = down.get(event.pointerId);
      if (!last) return to.hover(point);
      if (down.size === 2) {
        const before = spread();
        down.set(event.pointerId, point);
        const [one, other] = [...down.values()];
        travelled = Infinity;
        if (before > 0) to.closer(spread() / before, { x: (one.x + other.x) / 2, y: (one.y + other.y) / 2 });
        return undefined;
      }
      travelled += Math.hypot(point.x - last.x, point.y - last.y);
      down.set(event.pointerId, point);
      if (travelled > 3) to.drag(point.x - last.x, point.y - last.y);
      return to.hover(point);
    });
    canvas.addEventListener("pointerup", (event) => {
      if (down.delete(event.pointerId) && travelled <= 3) to.tap(pointOf(event));
    });
    canvas.addEventListener("pointercancel", (event) => down.delete(event.pointerId));
    canvas.addEventListener("pointerleave", () => to.hover(null));
    canvas.addEventListener("dblclick", () => to.fit());
  }

  return { placed, kept, closer, moved, showing, pixelAt, follow };
})();
