// Everything that the page does, once what it works on is there.
(() => {
  const bar = element("div", { class: "bar" });
  document.querySelector("nav")?.append(bar);
  tables.start();
  figures.start();
  if (typeof density !== "undefined") density.start();
  if (typeof turn !== "undefined") turn.start();
  filter.start(bar);
  reading.start(bar);
  runs.start();
})();
