// A panel as a PNG file.
const compareExport = (() => {
  const plain = (text) => String(text).replace(/[^\w.-]+/g, "_").slice(0, 60);

  function save(panel, choice) {
    const bitmaps = panel.layers.map((layer) => layer?.bitmap);
    if (!bitmaps.some(Boolean) || !panel.size) return;
    const names = panel.column.parts.map((part) => part.name);
    const about = [choice.scene.name, choice.shown.name, ...names, `seed${choice.seed}`, `step${choice.step}`, panel.name];
    comparePanel.copy(panel.size, bitmaps, choice, choice.wipe).toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${about.map(plain).join("-")}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    });
  }

  return { save };
})();
