// Elements from names, attributes and children. Text is never parsed as mark-up.
const element = (() => {
  const SVG = "http://www.w3.org/2000/svg";

  function fill(node, attributes, children) {
    for (const [name, value] of Object.entries(attributes)) {
      if (value === null || value === undefined || value === false) continue;
      if (typeof value === "function") node.addEventListener(name, value);
      else node.setAttribute(name, value === true ? "" : String(value));
    }
    node.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== ""));
    return node;
  }

  function made(name, attributes = {}, ...children) {
    return fill(document.createElement(name), attributes, children);
  }

  made.svg = (name, attributes = {}, ...children) =>
    fill(document.createElementNS(SVG, name), attributes, children);

  // The JSON of a data element of the page, or `fallback` if there is none.
  made.data = (id, fallback) => {
    const node = document.getElementById(id);
    return node ? JSON.parse(node.textContent) : fallback;
  };

  made.button = (look, text, click, attributes = {}) => made("button", { type: "button", class: look, click, ...attributes }, text);

  // A square in the colour of a CSS variable.
  made.swatch = (variable) => {
    const mark = made("i", { class: "swatch", "aria-hidden": "true" });
    mark.style.background = `var(${variable ?? "--ink"})`;
    return mark;
  };

  // A list of [term, text].
  made.terms = (pairs, attributes = {}) =>
    made("dl", attributes, pairs.map(([term, text]) => made("div", {}, made("dt", {}, term), made("dd", {}, text))));

  // A container for wide content that can be scrolled by keys as well.
  made.scroll = (label, ...children) => made("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": label }, ...children);

  // A choice; `set` takes its options [value, text] and the chosen value.
  made.select = (label, chosen) => {
    const input = made("select", { "aria-label": label, autocomplete: "off", change: () => chosen(input.value) });
    const set = (entries, value) => {
      const options = entries.map(([name, text]) => made("option", { value: name }, text));
      if (input.innerHTML !== made("select", {}, options).innerHTML) input.replaceChildren(...options);
      input.value = value;
    };
    return { root: made("label", {}, label, input), set };
  };

  // A dialog that lists [keys, what they do].
  made.keys = (list, note = "") => {
    const dialog = made("dialog", { class: "keys", "aria-label": "Keys" }, made("h2", {}, "Keys"), made.terms(list),
      made("p", { class: "note" }, note),
      made.button("act", "close", () => dialog.close(), { autofocus: true }));
    return dialog;
  };
  return made;
})();
