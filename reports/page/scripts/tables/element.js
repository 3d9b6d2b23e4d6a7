// Elements made of names, attributes and children. Text is always text: nothing here reads mark-up.
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

  // The JSON of a data element of the page, or `otherwise` where there is none.
  made.data = (id, otherwise) => {
    const node = document.getElementById(id);
    return node ? JSON.parse(node.textContent) : otherwise;
  };

  made.button = (look, text, click, attributes = {}) => made("button", { type: "button", class: look, click, ...attributes }, text);

  // A square of the colour that a variable of the page holds.
  made.swatch = (variable) => {
    const mark = made("i", { class: "swatch", "aria-hidden": "true" });
    mark.style.background = `var(${variable ?? "--ink"})`;
    return mark;
  };

  // A list of [term, text].
  made.terms = (pairs, attributes = {}) =>
    made("dl", attributes, pairs.map(([term, text]) => made("div", {}, made("dt", {}, term), made("dd", {}, text))));

  // What may be wider than its place, to be scrolled by keys as well.
  made.scroll = (label, ...children) => made("div", { class: "scroll", tabindex: "0", role: "group", "aria-label": label }, ...children);

  // A choice whose options [value, text] are set together with the chosen one.
  made.select = (label, chosen) => {
    const input = made("select", { "aria-label": label, autocomplete: "off", change: () => chosen(input.value) });
    const set = (entries, value) => {
      const options = entries.map(([name, text]) => made("option", { value: name }, text));
      if (input.innerHTML !== made("select", {}, options).innerHTML) input.replaceChildren(...options);
      input.value = value;
    };
    return { whole: made("label", {}, label, input), set };
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
