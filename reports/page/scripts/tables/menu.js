// One small menu for the whole page, opened below the button that it belongs to.
const menu = (() => {
  let owner = null;
  const list = element("div", { class: "menu", role: "menu", hidden: true });
  document.body.append(list);

  // `items`: [[label, what to do], …].
  function open(button, items) {
    if (owner === button) return close();
    close();
    owner = button;
    const entries = items.map(([label, act]) =>
      element("button", { type: "button", role: "menuitem", tabindex: "-1", click: () => { close(true); act(); } }, label));
    list.replaceChildren(...entries);
    list.hidden = false;
    button.setAttribute("aria-expanded", "true");
    const at = button.getBoundingClientRect();
    const left = Math.min(at.right - list.offsetWidth, document.documentElement.clientWidth - list.offsetWidth - 8);
    list.style.left = `${Math.max(8, left) + scrollX}px`;
    list.style.top = `${at.bottom + 4 + scrollY}px`;
    entries[0]?.focus({ preventScroll: true });
  }

  function close(returning = false) {
    if (owner === null) return;
    list.hidden = true;
    owner.setAttribute("aria-expanded", "false");
    if (returning) owner.focus({ preventScroll: true });
    owner = null;
  }

  list.addEventListener("keydown", (event) => {
    const entries = [...list.children];
    const place = entries.indexOf(document.activeElement);
    const to = { ArrowDown: place + 1, ArrowUp: place - 1, Home: 0, End: entries.length - 1 }[event.key];
    if (to !== undefined) {
      event.preventDefault();
      entries[(to + entries.length) % entries.length].focus();
    } else if (event.key === "Escape" || event.key === "Tab") {
      if (event.key === "Escape") event.preventDefault();
      event.stopPropagation();
      close(true);
    }
  });
  document.addEventListener("pointerdown", (event) => {
    if (owner && !list.contains(event.target) && !owner.contains(event.target)) close();
  });

  // A quiet button that opens a menu; `items` is asked when it is pressed.
  function button(label, items) {
    return element("button", {
      type: "button", class: "save", "aria-haspopup": "menu", "aria-expanded": "false", "aria-label": label,
      title: label, click: (event) => open(event.currentTarget, items()),
    }, "save");
  }
  return { button };
})();
