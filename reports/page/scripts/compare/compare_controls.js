// The comparer's controls, created once and then set to the choice, and its keys.
const compareControls = (() => {
  // The label of a group of keys, its description, and the action of each key; `back` is −1 with Shift, else 1.
  const KEYS = [
    ["S  W  D", "side by side, wipe, difference A − B", {
      s: (act) => act.mode("side"), w: (act) => act.mode("wipe"), d: (act) => act.mode("difference"),
    }],
    ["F", "flip; again: swap A and B in place", { f: (act) => act.flip() }],
    ["1 … 9", "picture A: 1 is the ground truth; with Shift: picture B", {}],
    ["M", "next map; with Shift: previous map", { m: (act, back) => act.nextMap(back) }],
    ["Shift + click", "on a map: add or remove its row", {}],
    ["← ↑ → ↓", "move the pixel whose numbers are shown; with Ctrl: by ten; with Shift: pan", {}],
    ["+  −  0", "closer, farther, fit", {
      "+": (act) => act.closer(1.5), "=": (act) => act.closer(1.5), "-": (act) => act.closer(1 / 1.5), 0: (act) => act.fit(),
    }],
    ["E", "half a stop brighter; with Shift: darker; R: reset", {
      e: (act, back) => act.expose(0.5 * back), r: (act) => act.expose(null),
    }],
    [",  .", "previous, next checkpoint", { ",": (act) => act.checkpoint(-1), ".": (act) => act.checkpoint(1) }],
    ["V  C  N", "next view, scene, seed; with Shift: previous", {
      v: (act, back) => act.next("view", back), c: (act, back) => act.next("scene", back), n: (act, back) => act.next("seed", back),
    }],
    ["[  ]", "wipe to the left, to the right", { "[": (act) => act.wipe(-0.02), "]": (act) => act.wipe(0.02) }],
    ["Esc", "deselect the pixel", { Escape: (act) => act.letGo() }],
    ["?", "these keys", { "?": (act) => act.help() }],
  ];
  const NOTE = "They work once a picture or a control has been clicked or tabbed to; then the wheel zooms as well. Drag pans, a double click fits.";
  const ACTIONS = Object.assign({}, ...KEYS.map(([, , actions]) => actions));
  const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

  const dialog = () => element.keys(KEYS, NOTE);

  // `act` holds the actions of the keys. A focused control keeps the keys that it needs itself.
  function listen(root, act) {
    root.addEventListener("keydown", (event) => {
      const arrows = MOVES[event.key];
      const taken = event.target.closest(arrows ? "select, input[type=range]" : "select");
      if (event.altKey || event.metaKey || (event.ctrlKey && !arrows) || event.target.closest("dialog") || taken) return;
      // by the position of the key: Shift changes the character of a digit
      const digit = /^Digit([1-9])$/.exec(event.code);
      const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
      if (arrows && event.target.closest("[role=slider]")) act.wipe(arrows[0] * (event.shiftKey ? 0.1 : 0.01) - arrows[1] * 0.01);
      else if (arrows && event.shiftKey) act.pan(-arrows[0], -arrows[1]);
      else if (arrows) act.step(...arrows.map((way) => way * (event.ctrlKey ? 10 : 1)));
      else if (digit) act.pick(digit[1] - 1, event.shiftKey);
      else if (Object.hasOwn(ACTIONS, key)) ACTIONS[key](act, event.shiftKey ? -1 : 1);
      else return;
      event.preventDefault();
    });
  }

  function buttons(label, names, press) {
    const all = Object.entries(names).map(([name, text]) =>
      element("button", { type: "button", "data-name": name, click: (event) => press(name, event) }, text));
    const set = (chosen) => all.forEach((each) => each.setAttribute("aria-pressed", String(chosen.includes(each.dataset.name))));
    const offer = (offered) => all.forEach((each) => (each.hidden = !offered.includes(each.dataset.name)));
    return { root: element("div", { role: "group", "aria-label": label, class: "choices" }, all), set, offer };
  }

  function slider(label, least, most, step, moved) {
    const input = element("input", { type: "range", "aria-label": label, min: least, max: most, step, input: () => moved(Number(input.value)) });
    const output = element("output");
    const set = (value, words) => {
      input.value = String(value);
      input.setAttribute("aria-valuetext", words);
      output.textContent = words;
    };
    return { root: element("label", { class: "slider" }, element("span", {}, label), input, output), input, set };
  }

  const button = (text, label, click) => element("button", { type: "button", "aria-label": label, title: label, click }, text);

  // `choose(changes, soon)` takes keys of the address.
  function controls({ choose, act, choice }) {
    const scene = element.select("Scene", (name) => choose({ scene: name }));
    const view = element.select("View", (name) => choose({ view: name }));
    const seed = element.select("Seed", (name) => choose({ seed: name }));
    const modes = buttons("How to compare", compareChoice.MODES, act.mode);
    const titles = Object.fromEntries(Object.entries(errorMaps.MAPS).map(([name, map]) => [name, map.title]));
    const maps = buttons("What to show", titles, (name, event) => act.map(name, event.shiftKey));
    const a = element.select("A", (name) => choose({ "compare.a": name }));
    const b = element.select("B", (name) => choose({ "compare.b": name }));
    const pair = element("div", { class: "pair" }, a.root, button("⇄", "Swap A and B (F)", act.swap), b.root);
    const step = slider("Checkpoint", 0, 0, 1, (place) => choose({ step: choice().steps[place] }, true));
    const most = compareChoice.EXPOSURES;
    const exposure = slider("Exposure", -most, most, 0.1, (stops) => choose({ "compare.ev": stops || null }, true));
    exposure.root.append(button("↺", "Exposure 0 (R)", () => act.expose(null)));
    const range = slider("Range of colours", -6, 3, 1, (scale) => choose({ "compare.range": scale || null }, true));
    const magnified = element("output", { class: "magnified", "aria-label": "Magnification" });
    const closer = element("div", { role: "group", "aria-label": "Zoom", class: "choices zoom" },
      button("−", "Smaller (−)", () => act.closer(1 / 1.5)), magnified,
      button("+", "Larger (+)", () => act.closer(1.5)), button("fit", "Fit (0)", act.fit));
    const line = (...parts) => element("div", { class: "line" }, parts);
    const root = element("div", { class: "controls" },
      line(scene.root, view.root, seed.root, modes.root, pair, button("?", "Keys (?)", act.help)),
      line(maps.root), line(step.root, exposure.root, range.root, closer));

    function set(now) {
      const names = now.images.map(({ id, name }) => [id, name]);
      scene.set(now.scenes.map(({ name, title }) => [name, title]), now.scene.name);
      view.set(now.scene.views.map(({ name }) => [name, name]), now.shown.name);
      seed.set(now.seeds.map((each) => [String(each), String(each)]), String(now.seed));
      modes.set([now.mode]);
      maps.set(now.maps);
      maps.offer(errorMaps.namesOf(now.shown));
      a.set(names, now.a);
      b.set(names, now.b);
      pair.hidden = now.mode === "side";
      step.input.max = String(Math.max(0, now.steps.length - 1));
      step.input.disabled = now.steps.length < 2;
      step.set(now.steps.indexOf(now.step), now.step === null ? "none kept" : `step ${now.step}${took(now)}`);
      exposure.set(now.stops, `${now.stops > 0 ? "+" : ""}${numbers.fixed(now.stops, 1)} EV`);
      exposure.root.toggleAttribute("data-hdr", now.shown.hdr);
      exposure.root.title = now.shown.hdr ? "The truth of this view is brighter than white in places" : "";
      const shown = now.maps.map((name) => (now.mode === "difference" && name === "colour" ? "signed" : name));
      range.root.hidden = !shown.some((name) => errorMaps.MAPS[name].scaled);
      range.set(now.scale, now.scale < 0 ? `÷ ${2 ** -now.scale}` : `× ${2 ** now.scale}`);
    }

    function took({ images }) {
      const seconds = images.filter(({ record }) => record).map(({ record }) => record.seconds);
      if (seconds.length === 0) return "";
      const [least, longest] = [Math.min(...seconds), Math.max(...seconds)].map((value) => value.toFixed(1));
      return ` · ${least === longest ? least : `${least}–${longest}`} s`;
    }

    const magnify = (scale) => (magnified.textContent = `${Math.round(100 * scale)} %`);
    return { root, set, magnify };
  }

  return { controls, dialog, listen };
})();
