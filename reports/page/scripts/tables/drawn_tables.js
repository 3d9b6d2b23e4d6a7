// Tables that are drawings as well, of stacked bars, as a file of their own: their words and marks where they are seen on
// the page.
const drawnTables = (() => {
  const [TITLE, KEY] = [28, 18];

  const is = (table) => Boolean(table.tBodies[0]?.querySelector(".stack"));

  const drawn = (mark, { left, top, width, height }) => element.svg("rect", {
    x: left, y: top, width: Math.max(width, 0.5), height, fill: getComputedStyle(mark).backgroundColor,
  });

  // The lines of a text as it is broken on the page, each from where it begins or, to the right, ends.
  function linesOf(node, place) {
    const range = document.createRange();
    const lines = [];
    for (const { 0: word, index } of node.data.matchAll(/\S+/g)) {
      range.setStart(node, index);
      range.setEnd(node, index + word.length);
      const box = place(range.getBoundingClientRect());
      const last = lines.at(-1);
      if (last && Math.abs(last.top - box.top) < 2) Object.assign(last, { words: `${last.words} ${word}`, right: box.left + box.width });
      else if (box.width > 0) lines.push({ ...box, words: word, right: box.left + box.width });
    }
    const { fontSize, fontWeight, color, textAlign } = getComputedStyle(node.parentElement);
    return lines.map(({ words, left, right, top, height }) => element.svg("text", {
      x: textAlign === "right" ? right : left, y: top + 0.78 * height, "text-anchor": textAlign === "right" ? "end" : "start",
      "font-size": fontSize, "font-weight": fontWeight, fill: color,
    }, words));
  }

  function textsIn(table) {
    const walker = document.createTreeWalker(table, NodeFilter.SHOW_TEXT);
    const texts = [];
    while (walker.nextNode()) if (!walker.currentNode.parentElement.closest("caption, .hidden")) texts.push(walker.currentNode);
    return texts;
  }

  // A sample of each kind of mark with what it means, as the table's data-keys say.
  function keysOf(table, top) {
    const keys = JSON.parse(table.dataset.keys ?? "[]").map(([name, words]) => [table.querySelector(`tbody i.${CSS.escape(name)}`), words]);
    return keys.filter(([mark]) => mark).map(([mark, words], place) => [
      drawn(mark, { left: 2, top: top + place * KEY, width: 14, height: 8 }),
      element.svg("text", { x: 24, y: top + place * KEY + 9, "font-size": 12, fill: "var(--ink)" }, words),
    ]);
  }

  function svg(table, title) {
    const frame = table.getBoundingClientRect();
    const place = ({ left, top, width, height }) => ({ left: left - frame.left, top: top - frame.top, width, height });
    const marks = [...table.querySelectorAll("tbody i")].filter((mark) => mark.checkVisibility());
    const keys = keysOf(table, frame.height + 8);
    const nodes = [
      marks.map((mark) => drawn(mark, place(mark.getBoundingClientRect()))),
      textsIn(table).flatMap((node) => linesOf(node, place)), keys.flat(2),
      element.svg("text", { y: 8 - TITLE / 2, "font-size": 14, "font-weight": 600, fill: "var(--ink)" }, title),
    ];
    const box = [-8, -TITLE, frame.width + 16, frame.height + TITLE + keys.length * KEY + 16];
    return figureSvg.file(element.svg("svg", {}, ...nodes), box, title, table.tBodies[0].innerText, 96);
  }
  return { is, svg };
})();
