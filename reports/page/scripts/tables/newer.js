// The page of an unfinished run asks a small script next to it for the version of the newest page, and offers to reload.
// A page that was opened from the disk may load a script from its folder, but may not read itself again.
const newer = (() => {
  const EVERY = 5000; // ms

  function start() {
    const own = element.data("version-data", null);
    if (own === null) return;
    const bar = element("div", { class: "newer", role: "status" });
    document.body.append(bar);
    const timer = setInterval(() => {
      if (document.hidden) return;
      const done = (event) => event.target.remove();
      document.head.append(element("script", { src: `${own.file}?${Date.now()}`, load: done, error: done }));
    }, EVERY);
    globalThis.reportVersion = (version) => {
      if (version === own.version || bar.firstChild) return;
      clearInterval(timer);
      bar.append("More runs have finished: there is a newer report. ", element.button("act", "Reload", () => location.reload()));
    };
  }
  return { start };
})();
