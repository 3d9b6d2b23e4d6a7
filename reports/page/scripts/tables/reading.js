// How the page is read: by keys alone, in light or in dark, and on paper.
const reading = (() => {
  const THEMES = ["auto", "light", "dark"];
  const KEYS = [
    ["/", "filter: the rows of the table in sight, else scenes and methods"],
    ["n, p", "next, previous section"],
    ["arrows", "from cell to cell of a table, from point to point of a figure that has the focus"],
    ["Enter", "the runs behind a cell or a point"],
    ["Esc", "close"],
    ["t", "light, dark, as the system has it"],
    ["?", "these keys"],
  ];
  const theme = element("button", { type: "button", class: "tool", click: () => turn() });
  const help = element("dialog", { class: "keys", "aria-label": "Keys" },
    element("h2", {}, "Keys"),
    element("dl", {}, KEYS.map(([key, words]) => element("div", {}, element("dt", {}, key), element("dd", {}, words)))),
    element("button", { type: "button", class: "act", click: () => help.close() }, "close"));
  let opened = [];

  function turn() {
    const now = THEMES.indexOf(state.get("theme") ?? "auto");
    const next = THEMES[(now + 1) % THEMES.length];
    state.set({ theme: next === "auto" ? null : next });
  }

  function dress() {
    const now = THEMES.includes(state.get("theme")) ? state.get("theme") : "auto";
    if (now === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = now;
    theme.textContent = `Theme: ${now}`;
  }

  function section(step) {
    const all = [...document.querySelectorAll("main > section[id]")];
    const line = innerHeight / 3;
    const now = all.filter((one) => one.getBoundingClientRect().top < line).length - 1;
    const next = all[Math.min(Math.max(now + step, 0), all.length - 1)];
    if (next) state.go(next.id);
  }

  function search() {
    const inSight = [...document.querySelectorAll("input.rows")].find((one) => {
      const { top, bottom, height } = one.getBoundingClientRect();
      return height > 0 && bottom > 0 && top < innerHeight && one.checkVisibility();
    });
    if (inSight) inSight.focus();
    else filter.toggle(true);
  }

  const ACTIONS = { "/": search, n: () => section(1), p: () => section(-1), t: turn, "?": () => help.showModal() };

  function start(bar) {
    bar.append(theme, element("button", { type: "button", class: "tool", click: () => help.showModal() }, "Keys"));
    document.body.append(help);
    dress();
    state.on((changed) => changed.has("theme") && dress());
    addEventListener("keydown", (event) => {
      const typing = event.target.closest?.("input, textarea, select, dialog, [contenteditable], #pictures");
      if (typing || event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey) return;
      const act = ACTIONS[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    });
    // paper has no way to unfold
    addEventListener("beforeprint", () => {
      opened = [...document.querySelectorAll("details:not([open])")];
      for (const one of opened) one.open = true;
    });
    addEventListener("afterprint", () => {
      for (const one of opened) one.open = false;
      opened = [];
    });
  }
  return { start };
})();
