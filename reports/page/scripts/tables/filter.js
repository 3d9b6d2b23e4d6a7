// The filter of scenes and methods for all tables, figures and pictures; means and verdicts keep hidden values.
const filter = (() => {
  const known = element.data("runs-data", { scenes: [], methods: [] });
  const KINDS = [["scene", "scenes"], ["method", "methods"]];
  const button = element.button("tool", "Filter", () => toggle(), { "aria-expanded": "false" });
  const box = element("div", {
    class: "filter", role: "dialog", "aria-label": "Scenes and methods that are shown", hidden: true,
    keydown: (event) => {
      if (event.key !== "Escape") return;
      event.preventDefault();
      toggle(false);
    },
  });

  // The visible names of `scenes` or `methods`, or null for all.
  function chosen(kinds) {
    const wanted = (state.get(`filter.${kinds}`) ?? "").split("\n");
    const left = known[kinds].filter((name) => wanted.includes(name));
    return left.length > 0 && left.length < known[kinds].length ? left : null;
  }

  // Whether a scene and a method are shown; either may be null.
  function allows(scene, method) {
    const about = { scene, method };
    return KINDS.every(([kind, kinds]) => !about[kind] || (chosen(kinds)?.includes(about[kind]) ?? true));
  }

  function change(kinds) {
    const left = [...box.querySelectorAll(`input[name=${kinds}]:checked`)].map((input) => input.value);
    state.set({ [`filter.${kinds}`]: left.length === known[kinds].length ? null : left.join("\n") || null });
    if (left.length === 0) fill();
  }

  function fill() {
    const lists = KINDS.map(([, kinds]) => {
      const left = chosen(kinds) ?? known[kinds];
      const boxes = known[kinds].map((name) => element("label", {}, element("input", {
        type: "checkbox", name: kinds, value: name, autocomplete: "off", checked: left.includes(name),
        change: () => change(kinds),
      }), name));
      return element("fieldset", {}, element("legend", {}, kinds), boxes);
    });
    const all = () => {
      state.set({ "filter.scenes": null, "filter.methods": null });
      fill();
    };
    box.replaceChildren(...lists,
      element("p", { class: "note" }, "Hides rows, columns, figures and pictures of the others. Means and verdicts remain those of the complete run."),
      element.button("act", "show all", all), " ", element.button("act", "done", () => toggle(false)));
  }

  function apply() {
    const isOut = ({ scene, method }) => !allows(scene, method);
    for (const row of document.querySelectorAll("tr[data-scene], tr[data-method]")) row.classList.toggle("out", isOut(row.dataset));
    for (const head of document.querySelectorAll("th[data-method]")) {
      for (const row of head.closest("table").rows) row.cells[head.cellIndex]?.classList.toggle("column-out", isOut(head.dataset));
    }
    for (const figure of figures.all()) figure.classList.toggle("out", isOut(figures.about(figure)));
    const many = KINDS.filter(([, kinds]) => chosen(kinds)).map(([, kinds]) => `${chosen(kinds).length} of ${known[kinds].length} ${kinds}`);
    button.textContent = many.length > 0 ? `Filter: ${many.join(", ")}` : "Filter";
    button.classList.toggle("on", many.length > 0);
    tables.refresh();
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
    state.on((changed) => {
      if (!changed.has("filter.scenes") && !changed.has("filter.methods")) return;
      apply();
      if (!box.hidden && !box.contains(document.activeElement)) fill();
    });
    if (state.get("filter.scenes") ?? state.get("filter.methods")) apply();
  }
  return { start, toggle, allows };
})();
