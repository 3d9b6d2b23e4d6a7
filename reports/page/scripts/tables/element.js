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
  return made;
})();
