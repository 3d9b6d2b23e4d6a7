// The panels of a choice: their layout, their content once it is computed, and painting.
const compareView = (() => {
  // Rows of maps × columns of images; if two methods are compared, maps show their difference.
  function plan(choice) {
    const by = (wanted) => choice.images.find(({ id }) => id === wanted);
    const [truth] = choice.images;
    const [a, b] = [by(choice.a), by(choice.b)];
    const columns = {
      side: () => choice.images.map((image) => ({ key: image.id, parts: [image], against: truth })),
      wipe: () => [{ key: "wipe", parts: [a, b], against: truth }],
      flip: () => [{ key: "flip", parts: [a], against: truth }],
      difference: () => [{ key: "difference", parts: [a], against: b }],
    }[choice.mode]();
    const instead = choice.mode === "difference" ? { colour: "signed", depth: "depth_error" } : {};
    return { rows: [...new Set(choice.maps.map((name) => instead[name] ?? name))], columns };
  }

  function titleOf({ parts: [a, b], against }, { mode }) {
    const name = (image) => element("span", { class: "who" }, element.swatch(image.variable), image.name);
    const letter = (text) => element("b", { class: "letter" }, text);
    const seconds = a.record ? element("small", {}, numbers.seconds(a.record.seconds)) : null;
    if (mode === "side") return [name(a), seconds];
    if (mode === "flip") return [letter("A"), name(a), seconds];
    const sign = mode === "wipe" ? element("span", { class: "between" }) : element("span", {}, "−");
    return [letter("A"), name(a), sign, letter("B"), name(b ?? against)];
  }

  function legend(name, choice) {
    const { colours, about, signed } = errorMaps.MAPS[name];
    const title = element("b", {}, errorMaps.titleOf(name));
    if (!colours) return [title];
    const [low, high] = errorMaps.endsOf(name, choice.scale, choice.shown).map(numbers.brief);
    const [first, ...rest] = about.split(";");
    const words = signed ? [`${first} ${choice.mode === "difference" ? "B" : "the truth"}`, ...rest].join(";") : about;
    const ramp = element("i", { class: "ramp", "aria-hidden": "true" });
    ramp.style.background = colourMaps.gradient(colours);
    return [title, element("span", { class: "ends" }, low, ramp, high), element("span", { title: words }, words)];
  }

  // Gives the canvas panel pixel per screen pixel.
  function sized(canvas) {
    const box = canvas.getBoundingClientRect();
    const ratio = devicePixelRatio || 1;
    const [width, height] = [box.width, box.height].map((length) => Math.max(1, Math.round(length * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    return { width: box.width, height: box.height, ratio };
  }

  // Draws bitmaps from left to right; the second begins at `wipe` (0 … 1 of the panel).
  function draw(canvas, size, bitmaps, at, pixel) {
    const context = canvas.getContext("2d");
    const picture = bitmaps.find(Boolean);
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, canvas.width, canvas.height);
    if (!picture) return;
    const { scale, left, top } = zoom.placed(at, size, picture);
    context.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    context.imageSmoothingEnabled = scale * size.ratio < 1;
    context.imageSmoothingQuality = "high";
    const edges = bitmaps.length === 2 ? [0, at.wipe * size.width, size.width] : [0, size.width];
    bitmaps.forEach((bitmap, place) => {
      if (!bitmap) return;
      context.save();
      context.beginPath();
      context.rect(edges[place], 0, edges[place + 1] - edges[place], size.height);
      context.clip();
      context.drawImage(bitmap, left, top, bitmap.width * scale, bitmap.height * scale);
      context.restore();
    });
    if (!pixel) return;
    // a light frame on a dark frame, visible on any background
    const side = Math.max(scale, 9);
    const [x, y] = [left, top].map((corner, axis) => corner + pixel[axis] * scale + (scale - side) / 2);
    for (const [lineWidth, strokeStyle] of [[3, "#000"], [1.25, "#fff"]]) {
      Object.assign(context, { lineWidth, strokeStyle });
      context.strokeRect(x, y, side, side);
    }
  }

  function view(stage, to) {
    let panels = [];
    let built = "";
    let turn = 0;

    function build(choice) {
      const { rows, columns } = plan(choice);
      const key = JSON.stringify([choice.mode, rows, columns.map(({ key: name, parts }) => [name, parts.map(({ id }) => id)])]);
      if (key !== built) {
        built = key;
        panels = rows.flatMap((name) => columns.map((column) => makePanel(name, column, choice)));
        stage.replaceChildren(...rows.map((name) => element("div", { class: "maprow" },
          element("p", { class: "maplegend", "data-map": name }),
          element("div", { class: "panes" }, panels.filter((panel) => panel.name === name).map((panel) => panel.figure)))));
      }
      for (const panel of panels) {
        panel.column = columns.find((column) => column.key === panel.column.key);
        panel.title.replaceChildren(...titleOf(panel.column, choice).filter(Boolean), panel.save);
        panel.figure.toggleAttribute("data-chosen", choice.mode === "side" && panel.column.key === choice.method);
        panel.canvas.setAttribute("aria-label", labelOf(panel, choice));
      }
      stage.dataset.mode = choice.mode;
      stage.style.setProperty("--ratio", String(choice.shown.width / choice.shown.height));
      stage.style.setProperty("--columns", String(columns.length));
      for (const part of stage.querySelectorAll(".maplegend")) part.replaceChildren(...legend(part.dataset.map, choice));
    }

    function labelOf({ name, column }, choice) {
      const names = column.parts.map((part) => part.name).join(" and ");
      const other = choice.mode === "difference" ? ` against ${column.against.name}` : "";
      return `${errorMaps.titleOf(name)} of ${names}${other}, ${choice.scene.name}, view ${choice.shown.name}`;
    }

    function makePanel(name, column, choice) {
      const panel = { name, column, layers: [], size: null };
      panel.canvas = element("canvas", { role: "img", ...zoom.gestures(to.gestures(panel)) });
      panel.why = element("p", { class: "why", hidden: true });
      panel.frame = element("div", { class: "frame" }, panel.canvas, panel.why);
      panel.title = element("figcaption");
      panel.said = element("p", { class: "said" });
      const save = () => panel.canvas.toBlob((blob) => download.saveBlob(panel.canvas.getAttribute("aria-label"), "png", blob));
      panel.save = element("button", { type: "button", class: "png", title: "Save this panel as PNG", click: save }, "PNG");
      panel.figure = element("figure", { class: "pane", "data-panel": `${column.key}-${name}` }, panel.title, panel.frame, panel.said);
      if (choice.mode === "wipe") panel.frame.append(panel.grip = gripOf(panel.frame));
      return panel;
    }

    function gripOf(frame) {
      return element("div", {
        class: "handle", role: "slider", tabindex: "0", "aria-label": "Where A ends and B begins", "aria-valuemin": "0",
        "aria-valuemax": "100",
        pointerdown: ({ currentTarget, pointerId }) => currentTarget.setPointerCapture(pointerId),
        pointermove: ({ currentTarget, pointerId, clientX }) => {
          const box = frame.getBoundingClientRect();
          if (currentTarget.hasPointerCapture(pointerId)) to.wipe((clientX - box.left) / box.width);
        },
      });
    }

    async function fill(panel, choice, mine) {
      const { parts, against } = panel.column;
      panel.figure.setAttribute("aria-busy", "true");
      const settled = await Promise.allSettled(parts.map((image) => compareLayers.layer(panel.name, image, against, choice)));
      if (mine !== turn) return;
      const lettered = (texts) =>
        texts.map((text, place) => (text && parts.length === 2 ? `${"AB"[place]}: ${text}` : text)).filter(Boolean);
      panel.layers = settled.map(({ value }) => value ?? null);
      panel.canvas.hidden = !panel.layers.some(Boolean);
      panel.said.textContent = lettered(panel.layers.map((layer) => layer?.said)).join(" · ");
      panel.why.textContent = lettered(settled.map(({ reason }) => reason?.message)).join(" ");
      panel.why.hidden = !panel.why.textContent;
      panel.figure.removeAttribute("aria-busy");
      to.painted();
    }

    function show(choice) {
      turn += 1;
      build(choice);
      for (const panel of panels) fill(panel, choice, turn);
    }

    function paint(choice, pixel) {
      for (const panel of panels) {
        panel.size = sized(panel.canvas);
        draw(panel.canvas, panel.size, panel.layers.map((layer) => layer?.bitmap), choice, pixel);
        if (!panel.grip) continue;
        panel.grip.style.left = `${100 * choice.wipe}%`;
        panel.grip.setAttribute("aria-valuenow", String(Math.round(100 * choice.wipe)));
      }
    }

    return { show, paint, panels: () => panels };
  }

  return { view };
})();
