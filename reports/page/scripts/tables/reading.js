// Reading the page with keys, and printing it.
const reading = (() => {
  const KEYS = [
    ["/", "filter: the rows of the visible table, or scenes and methods"],
    ["arrows", "move between cells of a table, or between points of a focused figure"],
    ["+ − 0", "enlarge a focused figure, or show all of it; so does a dragged rectangle"],
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

  // The address keeps the unfolded sections.
  function keepFolds() {
    const folds = [...document.querySelectorAll("section > details.fold")];
    const name = (fold) => fold.parentElement.id;
    let told = false;
    const unfold = () => {
      const open = new Set((state.get("open") ?? "").split("."));
      for (const fold of folds) fold.open = open.has(name(fold)) || name(fold) === state.get("at");
    };
    if (state.get("open")) unfold();
    for (const fold of folds) {
      fold.addEventListener("toggle", () => {
        if (printing) return;
        told = true; // what the reader folds by hand stays folded, a section that was linked to as well
        state.set({ open: folds.filter(({ open }) => open).map(name).join(".") || null });
        told = false;
      });
    }
    state.on((changed) => {
      if (changed.has("open") && !told) unfold();
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
    // printed pages show everything unfolded
    addEventListener("beforeprint", () => {
      printing = true;
      opened = [...document.querySelectorAll("details:not([open])")];
      for (const details of opened) details.open = true;
    });
    addEventListener("afterprint", () => {
      for (const details of opened.splice(0)) details.open = false;
      setTimeout(() => (printing = false), 100); // after the last toggle event
    });
  }
  return { start };
})();
