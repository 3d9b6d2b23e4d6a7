// The place of a picture in its panel, and moving it by pointer and wheel. `at` is { zoom, x, y }: the magnification
// relative to the fitted picture, and the point of the picture, 0 … 1, in the middle of the panel; all panels share it.
const zoom = (() => {
  const MOST = 256;
  const { clamp } = numbers;

  // CSS pixels per picture pixel, and the picture's corner in the panel.
  function placed(at, panel, picture) {
    const scale = Math.min(panel.width / picture.width, panel.height / picture.height) * at.zoom;
    const corner = (room, part, length) => room / 2 - part * length * scale;
    return { scale, left: corner(panel.width, at.x, picture.width), top: corner(panel.height, at.y, picture.height) };
  }

  // `at` limited so that the panel shows as little as possible outside of the picture.
  function kept(at, panel, picture) {
    const wanted = clamp(at.zoom, 1, MOST);
    const { scale } = placed({ ...at, zoom: wanted }, panel, picture);
    const along = (value, length, room) => {
      const half = Math.min(0.5, room / 2 / (length * scale));
      return clamp(value, half, 1 - half);
    };
    return { zoom: wanted, x: along(at.x, picture.width, panel.width), y: along(at.y, picture.height, panel.height) };
  }

  // `at` magnified by a factor; the picture point under `point` of the panel stays there.
  function closer(at, factor, point, panel, picture) {
    const before = placed(at, panel, picture);
    const wanted = clamp(at.zoom * factor, 1, MOST);
    const { scale } = placed({ ...at, zoom: wanted }, panel, picture);
    const stays = (place, corner, length, room) => ((place - corner) / before.scale - (place - room / 2) / scale) / length;
    const x = stays(point.x, before.left, picture.width, panel.width);
    const y = stays(point.y, before.top, picture.height, panel.height);
    return kept({ zoom: wanted, x, y }, panel, picture);
  }

  // The picture moved by CSS pixels.
  function moved(at, dx, dy, panel, picture) {
    const { scale } = placed(at, panel, picture);
    const x = at.x - dx / (picture.width * scale);
    return kept({ zoom: at.zoom, x, y: at.y - dy / (picture.height * scale) }, panel, picture);
  }

  // Moved as little as possible so that the pixel [column, row] is visible.
  function showing(at, [column, row], panel, picture) {
    const { scale, left, top } = placed(at, panel, picture);
    const short = (start, room) => {
      const margin = Math.min(scale, room / 4);
      return Math.max(0, margin - start) || Math.min(0, room - margin - (start + scale));
    };
    return moved(at, short(left + column * scale, panel.width), short(top + row * scale, panel.height), panel, picture);
  }

  // The pixel [column, row] under a point of the panel, or null outside of the picture.
  function pixelAt(at, point, panel, picture) {
    const { scale, left, top } = placed(at, panel, picture);
    const [column, row] = [Math.floor((point.x - left) / scale), Math.floor((point.y - top) / scale)];
    const inside = column >= 0 && row >= 0 && column < picture.width && row < picture.height;
    return inside ? [column, row] : null;
  }

  // The pointer handlers of a canvas; they call closer(factor, point), drag(dx, dy), hover(point), tap(point) and fit() of
  // `to`, and hover(null) when the pointer leaves.
  // The wheel scrolls the page until the reader has clicked (`to.listening()`), unless Ctrl is held.
  function gestures(to) {
    const down = new Map();
    let travelled = 0;
    const pointOf = ({ currentTarget, clientX, clientY }) => {
      const box = currentTarget.getBoundingClientRect();
      return { x: clientX - box.left, y: clientY - box.top };
    };
    const fingers = () => {
      const [first, other] = [...down.values()];
      const middle = { x: (first.x + other.x) / 2, y: (first.y + other.y) / 2 };
      return { apart: Math.hypot(first.x - other.x, first.y - other.y), middle };
    };

    function pinch(id, point) {
      const before = fingers().apart;
      down.set(id, point);
      const { apart, middle } = fingers();
      travelled = Infinity;
      if (before > 0) to.closer(apart / before, middle);
    }

    return {
      wheel: (event) => {
        if (!event.ctrlKey && !to.listening()) return;
        event.preventDefault();
        const lines = event.deltaY * (event.deltaMode === 1 ? 33 : 1);
        to.closer(2 ** (-lines / 240), pointOf(event));
      },
      pointerdown: (event) => {
        if (event.button !== 0) return;
        if (down.size === 0) travelled = 0;
        down.set(event.pointerId, pointOf(event));
        event.currentTarget.setPointerCapture(event.pointerId);
      },
      pointermove: (event) => {
        const point = pointOf(event);
        const last = down.get(event.pointerId);
        if (last && down.size === 2) return pinch(event.pointerId, point);
        if (last) {
          travelled += Math.hypot(point.x - last.x, point.y - last.y);
          down.set(event.pointerId, point);
          if (travelled > 3) to.drag(point.x - last.x, point.y - last.y);
        }
        return to.hover(point);
      },
      pointerup: (event) => {
        if (down.delete(event.pointerId) && travelled <= 3) to.tap(pointOf(event));
      },
      pointercancel: (event) => down.delete(event.pointerId),
      pointerleave: () => to.hover(null),
      dblclick: () => to.fit(),
    };
  }

  return { placed, kept, closer, moved, showing, pixelAt, gestures };
})();
