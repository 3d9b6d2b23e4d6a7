// One small menu for the whole page, opened below the button that it belongs to. The browser closes it by Escape and
// by a click elsewhere, and gives the focus back.
const menu = (() => {
  const WIDTH = 120;
  const list = element("div", { class: "menu", role: "menu", popover: "auto", style: `width: ${WIDTH}px` });
  let owner = null;
  document.body.append(list);

  // Makes the menu that of a button just before the browser opens it for the click; `items`: [[label, what to do], …].
  function give(button, items) {
    if (owner) owner.popoverTargetElement = null;
    owner = button;
    owner.popoverTargetElement = list;
    list.replaceChildren(...items.map(([label, act], place) => element("button", {
      type: "button", role: "menuitem", autofocus: place === 0, click: () => { list.hidePopover(); act(); },
    }, label)));
    const at = button.getBoundingClientRect();
    list.style.left = `${Math.max(8, at.right - WIDTH) + scrollX}px`;
    list.style.top = `${at.bottom + 4 + scrollY}px`;
  }

  list.addEventListener("keydown", (event) => {
    if (event.key === "Escape") event.stopPropagation(); // closes the menu alone
    if (event.key === "Tab") list.hidePopover();
    const entries = [...list.children];
    const place = entries.indexOf(document.activeElement);
    const to = { ArrowDown: place + 1, ArrowUp: place - 1, Home: 0, End: -1 }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    entries.at(to % entries.length).focus();
  });

  // A quiet button that opens a menu; `items` is asked when it is pressed.
  function button(label, items) {
    const click = (event) => give(event.currentTarget, items());
    return element("button", { type: "button", class: "save", "aria-haspopup": "menu", "aria-label": label, title: label, click }, "save");
  }
  return { button };
})();
