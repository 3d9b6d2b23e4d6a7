// One small menu for the page, opened below its button. The browser closes it on Escape and on a click elsewhere, and
// returns the focus.
const menu = (() => {
  const WIDTH = 120;
  const list = element("div", {
    class: "menu", role: "menu", popover: "auto", style: `width: ${WIDTH}px`,
    keydown: (event) => {
      if (event.key === "Escape") event.stopPropagation(); // closes only the menu
      if (event.key === "Tab") list.hidePopover();
      const entries = [...list.children];
      const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      entries.at((entries.indexOf(document.activeElement) + step) % entries.length).focus();
    },
  });
  let owner = null;
  document.body.append(list);

  // Attaches the menu to a button just before the browser opens it for the click; `items`: [[label, action], …].
  function attach(button, items) {
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

  // A button that opens a menu; `items()` is called when it is pressed.
  function button(label, items) {
    const click = ({ currentTarget }) => attach(currentTarget, items());
    return element.button("save", "save", click, { "aria-haspopup": "menu", "aria-label": label, title: label });
  }
  return { button };
})();
