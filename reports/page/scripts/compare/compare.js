// The picture comparer: connects choice, panels, controls, keys and the numbers of a pixel.
(() => {
  const SHARED = ["scene", "method", "seed", "step", "view"];
  const PLACING = ["zoom", "x", "y", "wipe", "pixel"].map((name) => `compare.${name}`);

  function start(root, data) {
    const choose = (changes, soon = false) => state.set(changes, { soon });
    let choice = compareChoice.from(data);
    let hover = null;
    let loaded = [];
    let frame = 0;
    let aloud = false;
    let turn = 0;

    const stage = element("div", {
      class: "stage", tabindex: "0", role: "group", "aria-label": "Pictures; press ? for the keys",
      "aria-describedby": "comparer-notes",
    });
    const where = element("p", { class: "where" });
    const notes = element("div", { class: "notes", role: "status", id: "comparer-notes" });
    const table = element("div", { class: "scroll probe", tabindex: "0", role: "group", "aria-label": "Numbers of a pixel" });
    const spoken = element("p", { class: "hidden", "aria-live": "polite" });
    const dialog = compareControls.dialog();

    const first = () => panels.panels().find(({ size }) => size) ?? { size: { width: 1, height: 1 } };

    // `placeOf(at, size, picture)` returns the new place of a panel's picture.
    function move(placeOf, panel = first()) {
      const { zoom: times, x, y } = placeOf(choice, panel.size, choice.shown);
      const short = (value, usual, digits) => (Math.abs(value - usual) < 1e-9 ? null : Number(value.toFixed(digits)));
      choose({ "compare.zoom": short(times, 1, 4), "compare.x": short(x, 0.5, 5), "compare.y": short(y, 0.5, 5) }, true);
    }

    function closer(factor, point, panel = first()) {
      const middle = { x: panel.size.width / 2, y: panel.size.height / 2 };
      move((at, size, picture) => zoom.closer(at, factor, point ?? middle, size, picture), panel);
    }

    function point(pixel, soon = false) {
      hover = null;
      choose({ "compare.pixel": pixel ? pixel.join(",") : null }, soon);
    }

    const around = (values, now, by) => values[(values.indexOf(now) + by + values.length) % values.length];

    const act = {
      closer: (factor) => closer(factor),
      fit: () => choose({ "compare.zoom": null, "compare.x": null, "compare.y": null }),
      pan: (across, down) => move((at, size, picture) => zoom.moved(at, (across * size.width) / 8, (down * size.height) / 8, size, picture)),
      step: (across, down) => {
        const { width, height } = choice.shown;
        const [column, row] = choice.pixel ?? [Math.floor(choice.x * width) - across, Math.floor(choice.y * height) - down];
        const pixel = [numbers.clamp(column + across, 0, width - 1), numbers.clamp(row + down, 0, height - 1)];
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
        const [mine, other] = second ? ["b", "a"] : ["a", "b"];
        const rest = choice[other] === image.id ? choice[mine] : choice[other];
        choose({ ...mode, [`compare.${mine}`]: image.id, [`compare.${other}`]: rest });
      },
      map: (name, add) => {
        const others = choice.maps.filter((map) => map !== name);
        const chosen = !add ? [name] : choice.maps.includes(name) ? others : [...choice.maps, name];
        const text = chosen.join(" ");
        choose({ "compare.map": text === "" || text === "colour" ? null : text });
      },
      nextMap: (by) => act.map(around(errorMaps.namesOf(choice.shown), choice.maps.at(-1), by), false),
      expose: (by) => {
        const stops = by === null ? 0 : numbers.clamp(choice.stops + by, -compareChoice.EXPOSURES, compareChoice.EXPOSURES);
        choose({ "compare.ev": stops ? Number(stops.toFixed(1)) : null });
      },
      checkpoint: (by) => {
        const step = choice.steps[choice.steps.indexOf(choice.step) + by];
        if (step !== undefined) choose({ step });
      },
      next: (kind, by) => {
        const names = {
          scene: [choice.scenes.map(({ name }) => name), choice.scene.name],
          view: [choice.scene.views.map(({ name }) => name), choice.shown.name],
          seed: [choice.seeds, choice.seed],
        }[kind];
        choose({ [kind]: around(...names, by) });
      },
      wipe: (by) => choose({ "compare.wipe": Number(numbers.clamp(choice.wipe + by, 0, 1).toFixed(4)) }, true),
      help: () => dialog.showModal(),
    };

    const panels = compareView.view(stage, {
      painted: () => repaint(),
      wipe: (part) => act.wipe(part - choice.wipe),
      gestures: (panel) => ({
        listening: () => root.contains(document.activeElement),
        closer: (factor, at) => closer(factor, at, panel),
        drag: (dx, dy) => move((at, size, picture) => zoom.moved(at, dx, dy, size, picture), panel),
        hover: (at) => {
          hover = at && zoom.pixelAt(choice, at, panel.size, choice.shown);
          repaint();
        },
        tap: (at) => {
          stage.focus({ preventScroll: true });
          point(zoom.pixelAt(choice, at, panel.size, choice.shown));
        },
        fit: () => act.fit(),
      }),
    });
    const controls = compareControls.controls({ choose, act, choice: () => choice });

    // Only the place of the pictures has changed; nothing has to be computed.
    function replace() {
      choice = compareChoice.from(data);
      const { scene, shown, seed, step, stops } = choice;
      stage.toggleAttribute("data-zoomed", choice.zoom > 1);
      table.toggleAttribute("data-pixel", Boolean(choice.pixel));
      where.textContent = `${scene.title}, view ${shown.name}, seed ${seed}, ${step === null ? "no checkpoint" : `step ${step}`}, exposure ${numbers.fixed(stops, 1)} EV`;
      repaint();
    }

    function refresh() {
      replace();
      controls.set(choice);
      const lines = [...choice.notes, ...(data.left_out ?? [])];
      if (notes.textContent !== lines.join("")) notes.replaceChildren(...lines.map((text) => element("p", {}, text)));
      turn += 1;
      const mine = turn;
      panels.show(choice);
      Promise.allSettled(choice.images.map(compareData.load)).then((settled) => {
        if (turn !== mine) return;
        loaded = settled.map(({ value }) => value ?? null);
        repaint();
      });
    }

    function repaint() {
      if (!frame) frame = requestAnimationFrame(painted);
    }

    // The panels may have changed their size, so the zoom is limited here.
    function painted() {
      frame = 0;
      const panel = panels.panels()[0];
      if (!panel) return;
      const box = panel.canvas.getBoundingClientRect();
      if (box.width) Object.assign(choice, zoom.kept(choice, box, choice.shown));
      const pixel = hover ?? choice.pixel;
      panels.paint(choice, pixel);
      if (box.width) controls.magnify(zoom.placed(choice, box, choice.shown).scale);
      table.replaceChildren(compareProbe.table(choice, pixel, loaded, mapsShown()));
      if (aloud && pixel) spoken.textContent = compareProbe.sentence(choice, pixel, loaded);
      aloud = false;
    }

    // The maps of the panels, as columns of the table of numbers.
    function mapsShown() {
      const names = new Set(panels.panels().map(({ name }) => name).filter((name) => errorMaps.MAPS[name].colours && !errorMaps.MAPS[name].alone));
      return [...names].map((name) => ({
        title: errorMaps.titleOf(name).replace(" (", "\n(") + (choice.mode === "difference" ? ", A against B" : ""),
        values: new Map(panels.panels().filter((panel) => panel.name === name).flatMap(({ column, layers }) =>
          column.parts.map(({ id }, which) => [id, layers[which]?.values]))),
      }));
    }

    root.append(controls.root, where, notes, stage, table, spoken, dialog);
    root.hidden = false;
    compareControls.listen(root, act);
    new ResizeObserver(() => repaint()).observe(stage);
    state.on((changed) => {
      const relevant = [...changed].filter((key) => SHARED.includes(key) || /^(compare|filter)\./.test(key));
      if (changed.has("method") && state.get("method") !== choice.a) choose({ "compare.b": null });
      if (relevant.length === 0) return;
      if (relevant.every((key) => PLACING.includes(key))) replace();
      else refresh();
    });
    controls.set(choice);
    const near = new IntersectionObserver((seen) => {
      if (!seen.some(({ isIntersecting }) => isIntersecting)) return;
      near.disconnect();
      refresh();
    }, { rootMargin: "800px" });
    near.observe(root);
  }

  function begin() {
    const root = document.getElementById("comparer");
    const data = compareData.read();
    if (root && data) start(root, data);
  }

  if (document.getElementById("pictures-data")) begin();
  else addEventListener("DOMContentLoaded", begin);
})();
