// Starts all parts of the page.
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
  newer.start();
})();
