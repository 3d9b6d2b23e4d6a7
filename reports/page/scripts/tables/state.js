// The reader's choices, kept in the address: #at=psnr&scene=lego&view=1. A plain #psnr goes to that section.
// All parts share the selection `scene`, `method`, `seed`, `step` and `view`; other keys begin with the name of their
// part, such as `compare.mode`.
const state = (() => {
  const SETTLED = 250;
  const listeners = [];
  let chosen = fromAddress();
  let writing = 0;

  // A typed address may hold anything.
  function decoded(text) {
    try {
      return decodeURIComponent(text);
    } catch {
      return text;
    }
  }

  function fromAddress() {
    const text = location.hash.slice(1);
    return text.includes("=") ? new Map(new URLSearchParams(text)) : new Map(text ? [["at", decoded(text)]] : []);
  }

  // `entry`: whether the browser's back button returns to the previous choice.
  function write(entry) {
    clearTimeout(writing);
    const text = new URLSearchParams([...chosen]).toString();
    const address = text ? `#${text}` : location.pathname + location.search;
    history[entry ? "pushState" : "replaceState"](null, "", address);
  }

  // Replaces the choices and returns the Set of the changed keys.
  function replace(next) {
    const before = chosen;
    chosen = next;
    return new Set([...before.keys(), ...next.keys()].filter((key) => before.get(key) !== next.get(key)));
  }

  function notify(changed) {
    for (const listener of listeners) listener(changed);
  }

  // The value of a key, or null.
  function get(key) {
    return chosen.get(key) ?? null;
  }

  // Changes several keys; null removes a key. `soon`: many changes follow one another, as in a drag, and the address is
  // written after the last.
  function set(changes, { entry = false, soon = false } = {}) {
    const next = new Map(chosen);
    for (const [key, value] of Object.entries(changes)) {
      if (value === null || value === undefined) next.delete(key);
      else next.set(key, String(value));
    }
    const changed = replace(next);
    if (changed.size === 0) return;
    clearTimeout(writing);
    if (soon) writing = setTimeout(write, SETTLED, false);
    else write(entry);
    notify(changed);
  }

  // `listener` gets the Set of the changed keys.
  function on(listener) {
    listeners.push(listener);
  }

  // On arrival at once: a smooth movement would end where the target was before the page was laid out.
  function goTo(name, focused = false, behavior = "auto") {
    const target = name && document.getElementById(name);
    if (!target) return;
    target.querySelector(":scope > details.fold")?.setAttribute("open", "");
    for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
    const land = () => target.scrollIntoView({ behavior });
    land();
    requestAnimationFrame(() => requestAnimationFrame(land)); // after folds above have opened or closed
    if (!focused) return;
    if (target.tabIndex < 0) target.tabIndex = -1;
    target.focus({ preventScroll: true });
  }

  // Goes to an element of the page and keeps the choices.
  function go(name, changes = {}) {
    set({ ...changes, at: name }, { entry: true });
    goTo(name, true);
  }

  addEventListener("hashchange", () => {
    clearTimeout(writing);
    const changed = replace(fromAddress());
    if (changed.size > 0) notify(changed);
    if (changed.has("at")) goTo(get("at"));
  });
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.('a[href^="#"]');
    if (!link || event.button !== 0 || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
    event.preventDefault();
    go(decoded(link.getAttribute("href").slice(1)));
  });
  for (const arrived of ["DOMContentLoaded", "load"]) addEventListener(arrived, () => goTo(get("at"), false, "instant"));
  return { get, set, on, go };
})();
