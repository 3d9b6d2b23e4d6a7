// The panels on the page: which there are for a choice, what they show once it has been computed, and painting them.
const compareView = (() => {
  const { swatch } = comparePanel;

  // Rows of maps × columns of images; where two methods are compared, maps tell how they differ.
  function plan(choice) {
    const by = (id) => choice.images.find((one) => one.id === id);
    const [truth] = choice.images;
    const [a, b] = [by(choice.a), by(choice.b)];
    const columns = {
      side: () => choice.images.map((one) => ({ key: one.id, parts: [one], against: truth })),
      wipe: () => [{ key: "wipe", parts: [a, b], against: truth }],
      flip: () => [{ key: "flip", parts: [a], against: truth }],
      difference: () => [{ key: "difference", parts: [a], against: b }],
    }[choice.mode]();
    const instead = choice.mode === "difference" ? { colour: "signed", depth: "depth_error" } : {};
    const rows = [...new Set(choice.maps.map((one) => instead[one] ?? one))];
    return { rows, columns };
  }

  function titleOf(column, choice) {
    const name = (image) => element("span", { class: "who" }, swatch(image.variable), image.name);
    if (choice.mode === "side") return [name(column.parts[0])];
    const letter = (text) => element("b", { class: "letter" }, text);
    if (choice.mode === "flip") return [letter("A"), name(column.parts[0])];
    const second = choice.mode === "wipe" ? column.parts[1] : column.against;
    const sign = choice.mode === "wipe" ? element("span", { class: "between" }, "") : element("span", {}, "−");
    return [letter("A"), name(column.parts[0]), sign, letter("B"), name(second)];
  }

  function legend(name, choice) {
    const map = errorMaps.MAPS[name];
    if (!map.colours) return [];
    const [low, high] = errorMaps.endsOf(name, choice.scale, choice.shown);
    const digits = (value) => String(Number(value.toPrecision(4))).replace("-", "−");
    const bar = element("i", { class: "ramp", "aria-hidden": "true" });
    bar.style.background = colourMaps.gradient(map.colours);
    const of = choice.mode === "difference" ? "B" : "the truth";
    const about = map.signed ? `${map.about.split(";")[0]} ${of}${map.about.slice(map.about.split(";")[0].length)}` : map.about;
    const channel = map.channelled && choice.channel !== "all" ? `, ${errorMaps.CHANNELS[choice.channel]}` : "";
    return [element("span", { class: "ends" }, digits(low), bar, digits(high)), element("span", { title: about + channel }, about + channel)];
  }

  function handle(one, to) {
    const grip = element("div", {
      class: "handle",
      role: "slider",
      tabindex: "0",
      "aria-label": "Where A ends and B begins",
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    });
    const follow = (event) => {
      const box = one.frame.getBoundingClientRect();
      to.wipe((event.clientX - box.left) / box.width);
    };
    grip.addEventListener("pointerdown", (event) => {
      event.stopPropagation();
      grip.setPointerCapture(event.pointerId);
    });
    grip.addEventListener("pointermove", (event) => grip.hasPointerCapture(event.pointerId) && follow(event));
    one.frame.append(grip);
    one.grip = grip;
  }

  function view(stage, to) {
    let panels = [];
    let built = "";
    let turn = 0;

    function build(choice) {
      const { rows, columns } = plan(choice);
      const key = JSON.stringify([choice.mode, rows, columns.map((one) => [one.key, one.parts.map((part) => part.id)])]);
      if (key !== built) {
        built = key;
        panels = [];
        stage.replaceChildren(...rows.map((name) => row(name, columns, choice)));
      }
      for (const one of panels) {
        one.column = columns.find((column) => column.key === one.column.key);
        const [image] = one.column.parts;
        one.title.replaceChildren(...titleOf(one.column, choice), ...after(one, image, choice.mode));
        one.figure.toggleAttribute("data-chosen", choice.mode === "side" && image.id === choice.method);
        one.canvas.setAttribute("aria-label", labelOf(one, choice));
      }
      stage.dataset.mode = choice.mode;
      stage.style.setProperty("--ratio", String(choice.shown.width / choice.shown.height));
      stage.style.setProperty("--columns", String(columns.length));
      for (const part of stage.querySelectorAll(".maplegend")) {
        part.replaceChildren(element("b", {}, errorMaps.titleOf(part.dataset.map, choice.channel)), ...legend(part.dataset.map, choice));
      }
    }

    const after = (one, image, mode) => {
      const alone = image.record && (mode === "side" || mode === "flip");
      return alone ? [element("small", {}, numbers.seconds(image.record.seconds)), one.save] : [one.save];
    };

    const labelOf = (one, choice) => {
      const names = one.column.parts.map((part) => part.name).join(" and ");
      const other = choice.mode === "difference" ? ` against ${one.column.against.name}` : "";
      return `${errorMaps.titleOf(one.name, choice.channel)} of ${names}${other}, ${choice.scene.name}, view ${choice.shown.name}`;
    };

    function row(name, columns, choice) {
      const own = columns.map((column) => {
        const one = comparePanel.panel({ key: `${column.key}-${name}`, label: "", title: [] });
        one.save = element("button", { type: "button", class: "png", title: "Save this panel as PNG" }, "PNG");
        one.save.addEventListener("click", () => to.save(one));
        Object.assign(one, { name, column });
        zoom.follow(one.canvas, to.gestures(one));
        if (choice.mode === "wipe") handle(one, to);
        panels.push(one);
        return one.figure;
      });
      return element(
        "div",
        { class: "maprow" },
        element("p", { class: "maplegend", "data-map": name }),
        element("div", { class: "panes" }, ...own),
      );
    }

    async function fill(one, choice, mine) {
      const { parts, against } = one.column;
      one.figure.setAttribute("aria-busy", "true");
      const jobs = parts.map((image) =>
        compareLayers.layer(compareLayers.mapOf(one.name, image, against), image, against, choice),
      );
      const settled = await Promise.allSettled(jobs);
      if (mine !== turn) return;
      const layers = settled.map((result) => (result.status === "fulfilled" ? result.value : null));
      const reasons = settled.map((result) => (result.status === "rejected" ? result.reason.message : null));
      one.show(layers);
      const tell = (texts, letters) =>
        texts.map((text, place) => (text && letters ? `${"AB"[place]}: ${text}` : text)).filter(Boolean);
      const twice = parts.length === 2;
      one.say(tell(layers.map((layer) => layer?.said), twice).join(" · "), tell(reasons, twice).join(" ") || null);
      to.painted();
    }

    function show(choice) {
      turn += 1;
      const mine = turn;
      build(choice);
      const work = panels.map((one) => fill(one, choice, mine));
      if (choice.mode === "flip") ahead(choice);
      return Promise.all(work);
    }

    // Makes ready what the next key press shows.
    function ahead(choice) {
      const [truth] = choice.images;
      for (const one of panels) {
        for (const image of choice.images) {
          compareLayers.layer(compareLayers.mapOf(one.name, image, truth), image, truth, choice).catch(() => {});
        }
      }
    }

    function paint(choice, pixel, textOf) {
      for (const one of panels) {
        one.paint(choice, choice.wipe, pixel, textOf);
        if (!one.grip) continue;
        one.grip.style.left = `${100 * choice.wipe}%`;
        one.grip.setAttribute("aria-valuenow", String(Math.round(100 * choice.wipe)));
      }
    }

    return { show, paint, panels: () => panels };
  }

  return { view };
})();
