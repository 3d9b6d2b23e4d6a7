// The picture comparer: puts choice, panels, controls, keys and the numbers of a pixel together.
const compare = (() => {
  const SETTLED = 250;
  const SHARED = ["scene", "method", "seed", "step", "view"];
  const PLACING = ["zoom", "x", "y", "wipe", "pixel"].map((name) => `compare.${name}`);

  function start(root, data) {
    const live = new Map();
    let flushing = 0;
    let choice = null;
    let hover = null;
    let loaded = [];
    let frame = 0;
    let player = 0;
    let aloud = false;
    let writing = false;
    let turn = 0;

    const get = (key) => (live.has(key) ? live.get(key) : state.get(key));

    function flush() {
      clearTimeout(flushing);
      const changes = Object.fromEntries(live);
      live.clear();
      writing = true;
      state.set(changes);
      writing = false;
    }

    // `soon`: many follow one another, as in a drag; the address is written once they have settled.
    function choose(changes, soon = false) {
      for (const [key, value] of Object.entries(changes)) {
        live.set(key, value === null || value === undefined ? null : String(value));
      }
      clearTimeout(flushing);
      if (soon) flushing = setTimeout(flush, SETTLED);
      else flush();
      if (Object.keys(changes).every((key) => PLACING.includes(key))) replace();
      else refresh();
    }

    const stage = element("div", {
      class: "stage",
      tabindex: "0",
      role: "group",
      "aria-label": "Pictures; press ? for the keys",
      "aria-describedby": "comparer-notes",
    });
    const where = element("p", { class: "where" });
    const notes = element("div", { class: "notes", role: "status", id: "comparer-notes" });
    const table = element("div", { class: "scroll probe", tabindex: "0", role: "region", "aria-label": "Numbers of a pixel" });
    const spoken = element("p", { class: "hidden", "aria-live": "polite" });
    const dialog = compareKeys.dialog();
    const probe = compareProbe.probe(table, spoken);

    const first = () => panels.panels().find((one) => one.size) ?? { size: { width: 1, height: 1 } };
    const move = (of, panel = first()) => {
      const { zoom: times, x, y } = of({ zoom: choice.zoom, x: choice.x, y: choice.y }, panel.size, choice.shown);
      const short = (value, usual, digits) => (Math.abs(value - usual) < 1e-9 ? null : Number(value.toFixed(digits)));
      choose({ "compare.zoom": short(times, 1, 4), "compare.x": short(x, 0.5, 5), "compare.y": short(y, 0.5, 5) }, true);
    };
    const closer = (factor, point, panel = first()) => {
      const middle = { x: panel.size.width / 2, y: panel.size.height / 2 };
      move((at, size, picture) => zoom.closer(at, factor, point ?? middle, size, picture), panel);
    };

    function point(pixel, soon = false) {
      hover = null;
      choose({ "compare.pixel": pixel ? pixel.join(",") : null }, soon);
    }

    const around = (values, now, by) => values[(values.indexOf(now) + by + values.length) % values.length];

    const act = {
      closer: (factor) => closer(factor),
      fit: () => choose({ "compare.zoom": null, "compare.x": null, "compare.y": null }),
      trueSize: () => closer(1 / (zoom.placed(choice, first().size, choice.shown).scale * first().size.ratio)),
      pan: (across, down) => {
        const { width, height } = first().size;
        move((at, size, picture) => zoom.moved(at, (across * width) / 8, (down * height) / 8, size, picture));
      },
      step: (across, down) => {
        const { width, height } = choice.shown;
        const [column, row] = choice.pixel ?? [Math.floor(choice.x * width) - across, Math.floor(choice.y * height) - down];
        const pixel = [
          Math.min(width - 1, Math.max(0, column + across)),
          Math.min(height - 1, Math.max(0, row + down)),
        ];
        aloud = true;
        point(pixel, true);
        move((at, size, picture) => zoom.showing(at, pixel, size, picture));
      },
      letGo: () => point(null),
      mode: (name) => choose({ "compare.mode": name === "side" ? null : name }),
      flip: () => (choice.mode === "flip" ? act.swap() : act.mode("flip")),
      swap: () => choose({ "compare.a": choice.b, "compare.b": choice.a }),
      pick: (place, second) => {
        const image = choice.images[place];
        if (!image) return;
        const mode = choice.mode === "side" ? { "compare.mode": "flip" } : {};
        const [mine, other, now, before] = second
          ? ["compare.b", "compare.a", choice.a, choice.b]
          : ["compare.a", "compare.b", choice.b, choice.a];
        choose({ ...mode, [mine]: image.id, [other]: now === image.id ? before : now });
      },
      map: (name, add) => {
        const others = choice.maps.filter((one) => one !== name);
        const chosen = !add ? [name] : choice.maps.includes(name) ? others : [...choice.maps, name];
        const text = chosen.join(" ");
        choose({ "compare.map": text === "" || text === "colour" ? null : text });
      },
      nextMap: (by) => act.map(around(Object.keys(errorMaps.MAPS), choice.maps.at(-1), by), false),
      expose: (by) => {
        const most = compareChoice.EXPOSURES;
        const stops = by === null ? 0 : Math.min(most, Math.max(-most, choice.stops + by));
        choose({ "compare.ev": stops ? Number(stops.toFixed(1)) : null });
      },
      checkpoint: (by) => {
        const place = choice.steps.indexOf(choice.step) + by;
        if (place >= 0 && place < choice.steps.length) choose({ step: choice.steps[place] });
      },
      next: (kind, by) => {
        const names = {
          scene: [choice.scenes.map((one) => one.name), choice.scene.name],
          view: [choice.scene.views.map((one) => one.name), choice.shown.name],
          seed: [choice.seeds, choice.seed],
        }[kind];
        choose({ [kind]: around(...names, by) });
      },
      wipe: (by) => choose({ "compare.wipe": Number(Math.min(1, Math.max(0, choice.wipe + by)).toFixed(4)) }, true),
      help: () => dialog.showModal(),
      play: () => {
        if (player) return stop();
        if (choice.step === choice.steps.at(-1)) choose({ step: choice.steps[0] });
        controls.playing(true);
        player = setInterval(() => {
          act.checkpoint(1);
          if (choice.step === choice.steps.at(-1)) stop();
        }, compareControls.PLAY);
        return undefined;
      },
    };

    function stop() {
      clearInterval(player);
      player = 0;
      controls.playing(false);
    }

    const panels = compareView.view(stage, {
      painted: () => repaint(),
      wipe: (part) => act.wipe(part - choice.wipe),
      save: (panel) => compareExport.save(panel, choice),
      gestures: (panel) => ({
        listening: () => root.contains(document.activeElement),
        closer: (factor, where) => closer(factor, where, panel),
        drag: (dx, dy) => move((at, size, picture) => zoom.moved(at, dx, dy, size, picture), panel),
        hover: (where) => {
          hover = zoom.pixelAt(choice, where, panel.size, choice.shown);
          repaint();
        },
        away: () => {
          hover = null;
          repaint();
        },
        tap: (where) => {
          stage.focus({ preventScroll: true });
          point(zoom.pixelAt(choice, where, panel.size, choice.shown));
        },
        fit: () => act.fit(),
      }),
    });
    const controls = compareControls.controls({ choose, act, choice: () => choice });

    // Where the pictures lie has changed, and nothing that must be computed.
    function replace() {
      choice = compareChoice.from(data, get);
      stage.toggleAttribute("data-zoomed", choice.zoom > 1);
      table.toggleAttribute("data-pixel", Boolean(choice.pixel));
      where.textContent =
        `${choice.scene.title}, view ${choice.shown.name}, seed ${choice.seed}, ` +
        `${choice.step === null ? "no checkpoint" : `step ${choice.step}`}, exposure ${numbers.fixed(choice.stops, 1)} EV`;
      repaint();
    }

    function refresh() {
      replace();
      controls.set(choice);
      const told = [...choice.said, ...(data.left_out ?? [])];
      if (notes.dataset.said !== told.join("\n")) {
        notes.dataset.said = told.join("\n");
        notes.replaceChildren(...told.map((text) => element("p", {}, text)));
      }
      turn += 1;
      const mine = turn;
      panels.show(choice);
      const work = choice.images.map((image) => (image.refs ? compareData.load(image) : Promise.reject(new Error(image.why))));
      Promise.allSettled(work).then((found) => {
        if (turn !== mine) return;
        loaded = found.map((one) => (one.status === "fulfilled" ? one.value : null));
        repaint();
      });
    }

    function repaint() {
      if (!frame) frame = requestAnimationFrame(painted);
    }

    // The panels may have changed their size, so that what fits is found here.
    function painted() {
      frame = 0;
      const panel = panels.panels()[0];
      if (!panel) return;
      const box = panel.canvas.getBoundingClientRect();
      const at = box.width ? { ...choice, ...zoom.kept(choice, box, choice.shown) } : choice;
      Object.assign(choice, { zoom: at.zoom, x: at.x, y: at.y });
      const pixel = hover ?? choice.pixel;
      panels.paint(choice, pixel, textOf);
      if (box.width) controls.magnify(zoom.placed(choice, box, choice.shown).scale);
      probe.show(choice, pixel, loaded, mapsShown(), aloud);
      aloud = false;
    }

    const textOf = (layer, place) => {
      if (layer.values) return [Number.isNaN(layer.values[place]) ? "–" : numbers.fixed(layer.values[place], 3)];
      return [...layer.shades(place)].slice(0, 3).map(String);
    };

    // The maps on the panels, for the columns of the numbers.
    function mapsShown() {
      const found = new Map();
      for (const { name, column, layers } of panels.panels()) {
        column.parts.forEach((image, which) => {
          const layer = layers[which];
          if (!layer?.values || name === "depth" || name === "opacity") return;
          if (!found.has(name)) found.set(name, new Map());
          found.get(name).set(image.id, layer.values);
        });
      }
      return [...found].map(([name, values]) => ({
        title: errorMaps.titleOf(name, choice.channel).replace(" (", "\n(") + (choice.mode === "difference" ? ", A against B" : ""),
        value: (image, place) => {
          const value = values.get(image.id)?.[place];
          return value === undefined || Number.isNaN(value) ? "–" : numbers.fixed(value, 4);
        },
      }));
    }

    root.append(controls.whole, where, notes, stage, table, spoken, dialog);
    root.hidden = false;
    compareKeys.listen(root, act);
    new ResizeObserver(() => repaint()).observe(stage);
    state.on((changed) => {
      if (writing) return;
      const ours = [...changed].filter((key) => SHARED.includes(key) || /^(compare|filter)\./.test(key));
      for (const key of ours) live.delete(key);
      if (changed.has("method") && get("method") !== choice.a) live.set("compare.b", null);
      if (changed.has("at") && state.get("at") === "pictures") document.getElementById("pictures")?.scrollIntoView();
      if (ours.length) refresh();
      if (live.size) setTimeout(flush);
    });
    choice = compareChoice.from(data, get);
    controls.set(choice);
    const near = new IntersectionObserver(
      (seen) => {
        if (!seen.some((one) => one.isIntersecting)) return;
        near.disconnect();
        refresh();
      },
      { rootMargin: "800px" },
    );
    near.observe(root);
  }

  function begin() {
    const root = document.getElementById("comparer");
    const data = compareData.read();
    if (root && data) start(root, data);
  }

  if (document.getElementById("pictures-data")) begin();
  else addEventListener("DOMContentLoaded", begin);
  return { begin };
})();
