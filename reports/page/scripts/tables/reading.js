// How the page is read by keys alone, and on paper.
const reading = (() => {
  const KEYS = [
    ["/", "filter: the rows of the table in sight, else scenes and methods"],
    ["arrows", "from cell to cell of a table, from point to point of a figure that has the focus"],
    ["Enter", "the runs behind a cell or a point"],
    ["Esc", "close"],
    ["?", "these keys"],
  ];
  const help = element.keys(KEYS);
  let opened = [];
  let printing = false;

  function search() {
    const inSight = [...document.querySelectorAll("input.rows")].find((field) => {
      const { top, bottom, height } = field.getBoundingClientRect();
      return height > 0 && bottom > 0 && top < innerHeight && field.checkVisibility();
    });
    if (inSight) inSight.focus();
    else filter.toggle(true);
  }

  // Which sections are unfolded is kept in the address.
  function keepFolds() {
    const folds = [...document.querySelectorAll("section > details.fold")];
    const name = (fold) => fold.parentElement.id;
    const unfold = () => {
      const open = new Set((state.get("open") ?? "").split("."));
      for (const fold of folds) fold.open = open.has(name(fold)) || name(fold) === state.get("at");
    };
    if (state.get("open")) unfold();
    for (const fold of folds) {
      fold.addEventListener("toggle", () => {
        if (!printing) state.set({ open: folds.filter((one) => one.open).map(name).join(".") || null });
      });
    }
    state.on((changed) => {
      if (changed.has("open")) unfold();
    });
  }

  function start(bar) {
    const actions = { "/": search, "?": () => help.showModal() };
    bar.append(element.button("tool", "Keys", actions["?"]));
    document.body.append(help);
    addEventListener("keydown", (event) => {
      const typing = event.target.closest?.("input, textarea, select, dialog, [contenteditable], #pictures");
      if (typing || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
      if (!Object.hasOwn(actions, event.key)) return;
      event.preventDefault();
      actions[event.key]();
    });
    keepFolds();
    // paper has no way to unfold
    addEventListener("beforeprint", () => {
      printing = true;
      opened = [...document.querySelectorAll("details:not([open])")];
      for (const details of opened) details.open = true;
    });
    addEventListener("afterprint", () => {
      for (const details of opened.splice(0)) details.open = false;
      setTimeout(() => (printing = false), 100); // after the last toggle is told
    });
  }
  return { start };
})();
