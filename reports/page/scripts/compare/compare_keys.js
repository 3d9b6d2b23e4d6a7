// Keys of the comparer, and the dialog that lists them.
const compareKeys = (() => {
  const LIST = [
    ["S  W  D", "side by side, wipe, difference A − B"],
    ["F", "flip; again: swap A and B in place"],
    ["1 … 9", "picture A: 1 is the ground truth; with Shift: picture B"],
    ["M", "next map; with Shift: the one before"],
    ["Shift + click", "a further row of maps, or one less; so does a click on a map once “+ row” is on"],
    ["← ↑ → ↓", "move the pixel whose numbers are shown; with Ctrl: by ten"],
    ["Shift + ← ↑ → ↓", "pan"],
    ["+  −  0", "closer, farther, fit"],
    ["O", "one picture pixel a screen pixel"],
    ["E", "half a stop brighter; with Shift: darker; R: reset"],
    [",  .", "checkpoint before, after; P: play"],
    ["V  C  N", "next view, next scene, next seed; with Shift: before"],
    ["[  ]", "wipe to the left, to the right"],
    ["Esc", "let go of the pixel"],
  ];
  const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

  // Which of the picture keys a pressed key is, by where it lies: Shift makes other signs of it.
  const digitOf = (event) => (/^Digit[1-9]$/.test(event.code) ? Number(event.code.slice(5)) : null);

  function dialog() {
    const close = element("button", { type: "button", autofocus: true }, "Close");
    const rows = LIST.map(([keys, what]) => element("div", {}, element("dt", {}, keys), element("dd", {}, what)));
    const whole = element(
      "dialog",
      { class: "keylist", "aria-label": "Keys" },
      element("h3", {}, "Keys"),
      element("dl", {}, ...rows),
      element("p", { class: "note" }, "They work once a picture or a control has been clicked or tabbed to; then the wheel zooms as well. Drag pans, a double click fits."),
      close,
    );
    close.addEventListener("click", () => whole.close());
    return whole;
  }

  // `act` does what keys ask for. What a focused control needs itself is left to it.
  function listen(root, act) {
    root.addEventListener("keydown", (event) => {
      if (event.altKey || event.metaKey || event.target.closest("dialog")) return;
      const taken = event.target.closest("select, input[type=range]");
      const arrows = MOVES[event.key];
      if (event.ctrlKey && !arrows) return;
      if (event.target.closest("select") || (taken && arrows)) return;
      const digit = digitOf(event);
      let done = true;
      if (event.target.closest("[role=slider]") && arrows) act.wipe(arrows[0] * (event.shiftKey ? 0.1 : 0.01) - arrows[1] * 0.01);
      else if (arrows && event.shiftKey) act.pan(-arrows[0], -arrows[1]);
      else if (arrows) act.step(...arrows.map((one) => one * (event.ctrlKey ? 10 : 1)));
      else if (digit) act.pick(digit - 1, event.shiftKey);
      else done = byName(event, act);
      if (done) event.preventDefault();
    });
  }

  function byName(event, act) {
    const back = event.shiftKey ? -1 : 1;
    const actions = {
      s: () => act.mode("side"),
      w: () => act.mode("wipe"),
      d: () => act.mode("difference"),
      f: () => act.flip(),
      m: () => act.nextMap(back),
      "+": () => act.closer(1.5),
      "=": () => act.closer(1.5),
      "-": () => act.closer(1 / 1.5),
      0: () => act.fit(),
      o: () => act.trueSize(),
      e: () => act.expose(0.5 * back),
      r: () => act.expose(null),
      ",": () => act.checkpoint(-1),
      ".": () => act.checkpoint(1),
      p: () => act.play(),
      v: () => act.next("view", back),
      c: () => act.next("scene", back),
      n: () => act.next("seed", back),
      "[": () => act.wipe(-0.02),
      "]": () => act.wipe(0.02),
      "?": () => act.help(),
      Escape: () => act.letGo(),
    };
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!Object.hasOwn(actions, key)) return false;
    actions[key]();
    return true;
  }

  return { dialog, listen };
})();
