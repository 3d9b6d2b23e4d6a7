// What the reader has chosen, kept in the address: #at=psnr&scene=lego&view=1. A plain #psnr goes to that section.
// `scene`, `method`, `seed`, `step` and `view` are the selection that all parts share; other keys begin with the
// name of the part that they belong to, such as `compare.mode`.
const state = (() => {
  const listeners = [];
  let chosen = new Map();

  // The address as it is typed may be anything.
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

  // `entry`: whether going back returns to what was before.
  function toAddress(entry) {
    const text = new URLSearchParams([...chosen]).toString();
    const address = text ? `#${text}` : location.pathname + location.search;
    if (entry) history.pushState(null, "", address);
    else history.replaceState(null, "", address);
  }

  function tell(changed) {
    for (const listener of listeners) listener(changed);
  }

  // The value of a key, or null.
  function get(key) {
    return chosen.get(key) ?? null;
  }

  // Changes some keys together; null takes one away. Listeners are told which have changed, if any has.
  // With `entry` the reader's way back leads to what was before.
  function set(changes, entry = false) {
    const changed = new Set();
    for (const [key, value] of Object.entries(changes)) {
      const text = value === null || value === undefined ? null : String(value);
      if (text === get(key)) continue;
      changed.add(key);
      if (text === null) chosen.delete(key);
      else chosen.set(key, text);
    }
    if (changed.size === 0) return;
    toAddress(entry);
    tell(changed);
  }

  // `listener` gets the Set of the keys that have changed.
  function on(listener) {
    listeners.push(listener);
  }

  function goTo(name, focused = false) {
    const target = name && document.getElementById(name);
    if (!target) return;
    for (let node = target; node; node = node.parentElement) if (node.tagName === "DETAILS") node.open = true;
    target.scrollIntoView();
    if (!focused) return;
    if (target.tabIndex < 0) target.tabIndex = -1;
    target.focus({ preventScroll: true });
  }

  // To a place in the page, keeping what is chosen.
  function go(name, changes = {}) {
    set({ ...changes, at: name }, true);
    goTo(name, true);
  }

  addEventListener("hashchange", () => {
    const before = chosen;
    chosen = fromAddress();
    const keys = [...before.keys(), ...chosen.keys()];
    const changed = new Set(keys.filter((key) => before.get(key) !== chosen.get(key)));
    if (changed.size > 0) tell(changed);
    if (changed.has("at")) goTo(get("at"));
  });
  document.addEventListener("click", (event) => {
    const link = event.target.closest?.('a[href^="#"]');
    if (!link || event.button !== 0 || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
    event.preventDefault();
    go(decoded(link.getAttribute("href").slice(1)));
  });
  chosen = fromAddress();
  addEventListener("DOMContentLoaded", () => goTo(get("at")));
  return { get, set, on, go };
})();
