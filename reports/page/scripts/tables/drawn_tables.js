// Tables that are drawings as well, forests of intervals and stacked bars, as a file of their own: the words of each row,
// and its marks in the places that the page gives them, in per cent of their column.
const drawnTables = (() => {
  const WIDE = 300; // of the drawing's units, 72 an inch
  const GAP = 14;
  const [SIZE, SMALL] = [9, 7.5];
  const LINE = 11;
  const DRAWN = ".track, .stack";
  // Class → colour, opacity, height; null is as high as the row.
  const BARS = {
    interest: ["--rule", 1, null], together: ["--link", 0.3, 8], alone: ["--link", 1, 2.6],
    "level-0": ["--memory-0", 1, 10], "level-1": ["--memory-1", 1, 10], "level-2": ["--disk", 1, 10], render: ["--rendered", 1, 10],
  };
  const context = document.createElement("canvas").getContext("2d");

  const is = (table) => Boolean(table.tBodies[0]?.querySelector(DRAWN));

  function width(text, size) {
    context.font = `${size}px ${figureSvg.FONT}`;
    return context.measureText(text).width;
  }

  // What stands in a cell: words, smaller words below them, marks.
  function cellOf(cell) {
    const copy = cell.cloneNode(true);
    const small = [...copy.querySelectorAll("small")].map((one) => one.textContent.trim()).filter(Boolean).join("; ");
    for (const one of copy.querySelectorAll(`small, .save, ${DRAWN}`)) one.remove();
    const text = cell.matches("thead .drawn") ? "" : copy.textContent.replace(/\s+/g, " ").trim();
    return { text, small, marks: cell.querySelector(DRAWN), right: getComputedStyle(cell).textAlign === "right" };
  }

  // Rows in sight, in order: {head} of a group, or {cells}.
  function rowsOf(table) {
    const cells = (row) => ({ cells: [...row.cells].map(cellOf) });
    const body = [...table.tBodies].flatMap((one) => [...one.rows]).filter((row) => !tables.isOut(row));
    return [
      { ...cells(table.tHead.rows[0]), top: true },
      ...body.map((row) => (row.cells.length === 1 ? { head: cellOf(row.cells[0]).text } : cells(row))),
    ];
  }

  function bar(name, left, long, middle, high) {
    const [colour, opacity, own] = BARS[name];
    const tall = own ?? high;
    return element.svg("rect", { x: left, y: middle - tall / 2, width: Math.max(long, 0.5), height: tall, fill: `var(${colour})`, "fill-opacity": opacity });
  }

  // Of an interval that goes on beyond the axis.
  function arrow(name, at, way, middle) {
    const [colour, opacity] = BARS[name];
    return element.svg("path", { d: `M${at} ${middle - 4}L${at + 4 * way} ${middle}L${at} ${middle + 4}z`, fill: `var(${colour})`, "fill-opacity": opacity });
  }

  function markOf(mark, start, place, middle, high) {
    const has = (name) => mark.classList.contains(name);
    const [left, long] = ["left", "width"].map((side) => (WIDE * (parseFloat(mark.style[side]) || 0)) / 100);
    const x = start + (mark.style.left ? left : place);
    if (has("zero")) return [element.svg("path", { d: `M${x} ${middle - high / 2}V${middle + high / 2}`, stroke: "var(--ink)", "stroke-width": 0.8 })];
    if (has("dot")) {
      const settled = has("better") || has("worse");
      return [element.svg("circle", { cx: x, cy: middle, r: 3.4, fill: `var(${settled ? "--link" : "--paper"})`, stroke: "var(--link)", "stroke-width": 1.4 })];
    }
    const name = Object.keys(BARS).find(has);
    if (!name) return [];
    return [
      bar(name, x, long, middle, high),
      has("cut-start") ? arrow(name, x, -1, middle) : "",
      has("cut-end") ? arrow(name, x + long, 1, middle) : "",
    ];
  }

  function marksOf(box, start, middle, high) {
    let place = 0;
    return [...box.querySelectorAll("i")].flatMap((mark) => {
      const nodes = markOf(mark, start, place, middle, high);
      place += (WIDE * (parseFloat(mark.style.width) || 0)) / 100;
      return nodes;
    });
  }

  const words = (text, x, y, more = {}) => element.svg("text", { x, y, "font-size": SIZE, fill: "var(--ink)", ...more }, text);

  function columnsOf(rows, drawn) {
    const widths = [];
    widths[drawn] = WIDE;
    for (const { cells } of rows)
      (cells ?? []).forEach(({ text, small }, place) => {
        widths[place] = Math.max(widths[place] ?? 0, width(text, SIZE), width(small, SMALL));
      });
    let next = GAP;
    return widths.map((wide) => {
      const column = { left: next, right: next + wide };
      next += wide + GAP;
      return column;
    });
  }

  function rowNodes({ head, cells, top }, columns, y, high) {
    if (head !== undefined) return [words(head, columns[0].left, y + high - 4, { "font-weight": 600, fill: "var(--muted)" })];
    return cells.flatMap(({ text, small, marks, right }, place) => {
      const { left, right: end } = columns[place];
      const side = right ? { x: end, "text-anchor": "end" } : {};
      const middle = y + high / 2 - (marks && small ? LINE / 2 : 0);
      const base = small ? y + high / 2 - 1 : y + high / 2 + 3;
      return [
        ...(marks ? marksOf(marks, left, middle, high) : []),
        text ? words(text, left, base, { ...side, ...(top ? { "font-weight": 600, "font-size": SMALL } : {}) }) : "",
        small ? words(small, left, base + (text || marks ? 9.5 : 0), { ...side, "font-size": SMALL, fill: "var(--muted)" }) : "",
      ];
    });
  }

  function axisOf(table, left, y) {
    const ticks = [...table.querySelectorAll("tfoot .axis span")];
    if (ticks.length === 0) return [];
    const line = element.svg("path", { d: `M${left} ${y}H${left + WIDE}`, stroke: "var(--muted)", "stroke-width": 0.8 });
    return [line, ...ticks.map((tick) => words(tick.textContent, left + (WIDE * parseFloat(tick.style.left)) / 100, y + 11,
      { "text-anchor": "middle", "font-size": SMALL, fill: "var(--muted)" }))];
  }

  // A sample of each kind of mark with what it means, as the table's data-keys say; as many lines as they need.
  function keysOf(table, room, y) {
    let [x, line] = [GAP, y];
    return JSON.parse(table.dataset.keys ?? "[]").flatMap(([name, said]) => {
      const needed = 18 + width(said, SMALL) + GAP;
      if (x > GAP && x + needed > room) [x, line] = [GAP, line + LINE];
      const sample = BARS[name] ? bar(name, x, 14, line - 3, 8) : element.svg("circle", { cx: x + 7, cy: line - 3, r: 3, fill: "var(--paper)", stroke: "var(--link)", "stroke-width": 1.4 });
      const nodes = [sample, words(said, x + 18, line, { "font-size": SMALL })];
      x += needed;
      return nodes;
    });
  }

  function svg(table, title) {
    const rows = rowsOf(table);
    const drawn = table.tBodies[0].querySelector(DRAWN).closest("td").cellIndex;
    const columns = columnsOf(rows, drawn);
    const room = Math.max(columns[columns.length - 1].right + GAP, width(title, SIZE + 1.5) + 2 * GAP);
    const nodes = [words(title, GAP, 18, { "font-size": SIZE + 1.5, "font-weight": 600 })];
    let y = 26;
    for (const row of rows) {
      const high = row.cells?.some(({ small }) => small) ? 2 * LINE + 2 : LINE + 6;
      nodes.push(...rowNodes(row, columns, y, high));
      y += high;
    }
    const axis = axisOf(table, columns[drawn].left, y + 2);
    if (axis.length > 0) y += 18;
    const keys = keysOf(table, room, y + 12);
    const last = keys.length > 0 ? Number(keys[keys.length - 1].getAttribute("y")) : y;
    const made = element.svg("svg", {}, ...nodes, ...axis, ...keys);
    const said = rows.slice(1).map(({ head, cells }) => head ?? cells.map(({ text, small }) => [text, small].filter(Boolean).join(" ")).filter(Boolean).join(", "));
    return figureSvg.file(made, [0, 0, room, last + 8], title, said.join("; "));
  }
  return { is, svg };
})();
