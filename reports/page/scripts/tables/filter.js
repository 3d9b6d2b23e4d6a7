// Which scenes and methods are shown, in tables, figures and pictures alike; what is taken out stays in means and verdicts.
const filter = (() => {
  const known = element.data("runs-data", { scenes: [], methods: [] });
  const parts = [["scene", "scenes", known.scenes], ["method", "methods", known.methods]];
  const button = element("button", { type: "button", class: "tool", "aria-expanded": "false", click: () => toggle() }, "Filter");
  const box = element("div", { class: "filter", role: "dialog", "aria-label": "Scenes and methods that are shown", hidden: true });

  // The names that are left, or null for all of them.
  function chosen(name, every) {
    const text = state.get(`filter.${name}`);
    if (text === null) return null;
    const wanted = new Set(text.split(",").map(decoded));
    const there = every.filter((one) => wanted.has(one));
    return there.length > 0 && there.length < every.length ? new Set(there) : null;
  }

  function decoded(text) {
    try {
      return decodeURIComponent(text);
    } catch {
      return text;
    }
  }

  // Whether a scene and a method are shown; either may be left open.
  function allows(scene, method) {
    const about = { scene, method };
    return parts.every(([one, name, every]) => !about[one] || (chosen(name, every)?.has(about[one]) ?? true));
  }

  function change(name, every) {
    const left = [...box.querySelectorAll(`input[name=${name}]`)].filter((one) => one.checked).map((one) => one.value);
    const all = left.length === every.length || left.length === 0;
    state.set({ [`filter.${name}`]: all ? null : left.map(encodeURIComponent).join(",") });
    if (left.length === 0) fill();
  }

  function fill() {
    const lists = parts.map(([, name, every]) => {
      const left = chosen(name, every);
      return element("fieldset", {}, element("legend", {}, name), every.map((one) => {
        const input = element("input", { type: "checkbox", name, value: one, autocomplete: "off", change: () => change(name, every) });
        input.checked = left === null || left.has(one);
        return element("label", {}, input, one);
      }));
    });
    box.replaceChildren(...lists,
      element("p", { class: "note" }, "Takes rows, columns, figures and pictures of the others out of sight. Means and verdicts stay those of the whole run."),
      element("button", { type: "button", class: "act", click: () => { state.set({ "filter.scenes": null, "filter.methods": null }); fill(); } }, "show all"),
      " ", element("button", { type: "button", class: "act", click: () => toggle(false) }, "done"));
  }

  function apply() {
    const isOut = ({ scene, method }) => !allows(scene, method);
    for (const row of document.querySelectorAll("tr[data-scene], tr[data-method]")) row.classList.toggle("out", isOut(row.dataset));
    for (const table of document.querySelectorAll("table:has(th[data-method])")) columns(table, isOut);
    for (const figure of figures.all()) figure.classList.toggle("out", isOut(figures.about(figure)));
    const left = parts.map(([, name, every]) => [chosen(name, every), name, every]);
    const many = left.filter(([some]) => some).map(([some, name, every]) => `${some.size} of ${every.length} ${name}`);
    button.textContent = many.length > 0 ? `Filter: ${many.join(", ")}` : "Filter";
    button.classList.toggle("on", many.length > 0);
    tables.refresh();
  }

  function columns(table, isOut) {
    [...table.tHead.rows[0].cells].forEach((head, place) => {
      if (!head.dataset.method) return;
      const out = isOut({ method: head.dataset.method });
      for (const row of table.rows) row.cells[place]?.classList.toggle("column-out", out);
    });
  }

  function toggle(open = box.hidden) {
    if (open) fill();
    box.hidden = !open;
    button.setAttribute("aria-expanded", String(open));
    (open ? box.querySelector("input") : button)?.focus({ preventScroll: true });
  }

  function start(bar) {
    if (known.scenes.length < 2 && known.methods.length < 2) return;
    bar.append(button);
    document.body.append(box);
    box.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.preventDefault();
      toggle(false);
    });
    state.on((changed) => {
      if (!changed.has("filter.scenes") && !changed.has("filter.methods")) return;
      apply();
      if (!box.hidden && !box.contains(document.activeElement)) fill();
    });
    if (state.get("filter.scenes") !== null || state.get("filter.methods") !== null) apply();
  }
  return { start, toggle, allows };
})();
