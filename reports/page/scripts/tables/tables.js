// Tables: sorted by a click on a header, filtered by words, saved as CSV, Markdown and LaTeX; a cell opens its runs.
// What a cell is sorted by and saved as stands in its data-value, data-said, data-parts and data-runs.
const tables = (() => {
  const MANY_ROWS = 8;
  const SHORT = 52; // characters of a caption that leave room beside it
  const EMPTY = { text: "", small: "", value: null, parts: {} };
  const STEPS = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] };
  const { compare } = new Intl.Collator("en", { numeric: true });
  const all = [];

  // What a cell holds: {text, small, value, parts}.
  function read(cell) {
    if (!cell) return EMPTY;
    const copy = cell.cloneNode(true);
    const small = [...copy.querySelectorAll("small")].map((one) => one.textContent.trim().replace(/\s*\n\s*/g, "; "));
    for (const one of copy.querySelectorAll("small, input, svg")) one.remove();
    const text = copy.textContent.replace(/[^\S\u00a0\u202f]+/g, " ").trim();
    const { value, said, parts } = cell.dataset;
    return {
      text: text || said || "",
      small: small.filter(Boolean).join("; "),
      value: value === undefined ? null : Number(value),
      parts: parts ? JSON.parse(parts) : {},
    };
  }

  // Cells as a grid: a wide cell is followed by empty ones.
  const cellsOf = (row) => [...(row?.cells ?? [])].flatMap((cell) => [cell, ...Array(cell.colSpan - 1).fill(null)]);
  const isOut = (row) => row.matches(".out, .unmatched");
  const isNote = (row) => row?.matches(".why") ?? false;
  const isRight = (cell) => Boolean(cell) && !cell.matches(".words") && getComputedStyle(cell).textAlign === "right";

  // What is in sight: rows and columns that were taken out are left out of files too. What qualifies a row in one below
  // it becomes the last column.
  function model(table) {
    const heads = cellsOf(table.tHead?.rows[table.tHead.rows.length - 1]);
    const isKept = (_, place) => !heads[place]?.matches(".column-out");
    const noted = table.querySelector("tr.why") !== null;
    const rowsOf = (part) => [...(part?.rows ?? [])].filter((row) => !isOut(row) && !isNote(row)).map((row) => {
      const note = isNote(row.nextElementSibling) ? read(row.nextElementSibling.cells[0]) : EMPTY;
      return [...cellsOf(row).filter(isKept).map(read), ...(noted ? [note] : [])];
    });
    const [rows, totals] = [[...table.tBodies].flatMap(rowsOf), rowsOf(table.tFoot)];
    const isNumeric = (place) => [...rows, ...totals].some((row) => typeof row[place]?.value === "number");
    const columns = heads.filter(isKept).map((head, place) => ({ label: wordsOf(head), numeric: isRight(head) || isNumeric(place) }));
    return { caption: captionOf(table), columns: [...columns, ...(noted ? [{ label: "note", numeric: false }] : [])], rows, totals };
  }

  function wordsOf(head) {
    const { text, small } = read(head);
    return small ? `${text} (${small})`.trim() : text;
  }

  function captionOf(table) {
    const text = table.caption?.textContent.replace(/\s+/g, " ").trim();
    const study = table.closest(".study")?.querySelector(".eyebrow")?.textContent;
    return [study, text].filter(Boolean).join(" – ") || table.closest("[aria-label]")?.getAttribute("aria-label") || "table";
  }

  // Numbers in full, with a column of its own for every further number and for what stands small below.
  function csv(table) {
    const { columns, rows, totals } = model(table);
    const every = [...rows, ...totals];
    const written = columns.flatMap(({ label }, place) => {
      const cells = every.map((row) => row[place] ?? EMPTY);
      const names = [...new Set(cells.flatMap(({ parts }) => Object.keys(parts)))];
      // of a range the ends alone, which stand beside
      const missing = ({ text, parts }) => text === numbers.NOTHING || Object.values(parts).some(Number.isFinite);
      return [
        [label, ...cells.map((cell) => cell.value ?? (missing(cell) ? "" : cell.text))],
        ...names.map((name) => [`${label} ${name}`, ...cells.map(({ parts }) => parts[name])]),
        ...(cells.some(({ small }) => small) ? [[`${label} note`, ...cells.map(({ small }) => small)]] : []),
      ];
    });
    return download.csv([null, ...every].map((_, line) => written.map((column) => column[line])));
  }

  function forms(table) {
    const title = captionOf(table);
    return [
      ["CSV", () => download.save(title, "csv", csv(table), "text/csv")],
      ["Markdown", () => download.save(title, "md", download.markdown(model(table)), "text/markdown")],
      ["LaTeX", () => download.save(title, "tex", download.latex(model(table)), "application/x-tex")],
    ];
  }

  function isSortable(table) {
    const rows = table.tBodies.length === 1 ? [...table.tBodies[0].rows] : [];
    const plain = rows.every((row) => [...row.cells].every((cell) => cell.colSpan === 1 && cell.rowSpan === 1));
    return rows.length > 1 && plain && table.tHead?.rows.length === 1 && !table.matches(".facts, .pictures");
  }

  // A number; a text; null where nothing is there, which stays last whichever way it is sorted.
  function keyOf(row, place) {
    const { value, text } = read(row.cells[place]);
    return value ?? (text === "" || text === numbers.NOTHING ? null : text);
  }

  function order(a, b, falling) {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return (typeof a === "number" ? a - b : compare(a, b)) * (falling ? -1 : 1);
  }

  // As the address says: a column's number and `a`scending or `d`escending.
  function sort(one) {
    const [, digits, way] = /^(\d+)([ad])$/.exec(state.get(one.key) ?? "") ?? [];
    const place = digits < one.heads.length ? Number(digits) : -1;
    const keyed = one.rows.map((row) => [place < 0 ? null : keyOf(row, place), row]);
    if (place >= 0) keyed.sort(([a], [b]) => order(a, b, way === "d"));
    one.table.tBodies[0].append(...keyed.map(([, row]) => row));
    one.heads.forEach((head, at) => {
      head.ariaSort = at === place ? { a: "ascending", d: "descending" }[way] : null;
    });
    recount(one);
  }

  function makeSortable(one) {
    one.key = `table.${one.name}.sort`;
    one.heads = [...one.table.tHead.rows[0].cells];
    one.heads.forEach((head, place) => {
      if (!head.textContent.trim() || head.querySelector(".hidden")) return;
      // numbers fall first, words rise; the third click puts the rows back
      const numeric = one.rows.some((row) => row.cells[place]?.dataset.value !== undefined);
      const ways = (numeric ? ["d", "a"] : ["a", "d"]).map((way) => `${place}${way}`);
      const click = () => state.set({ [one.key]: ways[ways.indexOf(state.get(one.key)) + 1] });
      head.append(element.button("sort", [...head.childNodes], click, { title: "sort" }));
    });
    sort(one);
  }

  function makeFilter(one) {
    one.words = `table.${one.name}.words`;
    one.count = element("span", { class: "count", role: "status" });
    one.field = element("input", {
      type: "search", class: "rows", placeholder: "filter rows", "aria-label": `Filter rows: ${captionOf(one.table)}`,
      autocomplete: "off", spellcheck: "false",
      input: () => state.set({ [one.words]: one.field.value.trim() || null }),
    });
    match(one);
    return [one.field, one.count];
  }

  function match(one) {
    const text = state.get(one.words) ?? "";
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    if (document.activeElement !== one.field) one.field.value = text;
    for (const row of one.rows) {
      const said = [row.textContent, ...[...row.cells].map((cell) => cell.dataset.said ?? "")].join(" ").toLowerCase();
      row.classList.toggle("unmatched", !words.every((word) => said.includes(word)));
    }
    recount(one);
  }

  // How many rows are left; where rows no longer stand below the one that names their scene, each names its own.
  function recount(one) {
    const left = one.rows.filter((row) => !isOut(row)).length;
    const torn = left < one.rows.length || one.heads?.some((head) => head.hasAttribute("aria-sort"));
    if (one.count) one.count.textContent = left < one.rows.length ? `${left} of ${one.rows.length}` : "";
    one.table.classList.toggle("regrouped", Boolean(torn));
  }

  // One stop for the tab key in a table, arrow keys from cell to cell.
  function makeCells(table) {
    const cells = [...table.querySelectorAll("[data-runs]")];
    for (const cell of cells) {
      const nodes = [...cell.childNodes];
      const small = nodes.findIndex(({ nodeName }) => nodeName === "SMALL");
      const label = { title: "the runs behind this", tabindex: cell === cells[0] ? "0" : "-1" };
      const button = element.button("behind", small < 0 ? nodes : nodes.slice(0, small), null, label);
      cell.prepend(button);
      cell.addEventListener("click", (event) => {
        if (!event.target.closest("a") && !getSelection().toString()) runs.open(JSON.parse(cell.dataset.runs), button);
      });
    }
    table.addEventListener("keydown", move);
  }

  function move(event) {
    const [step, table] = [STEPS[event.key], event.currentTarget];
    if (!step || !event.target.matches(".behind")) return;
    event.preventDefault();
    const cell = event.target.closest("[data-runs]");
    const rows = [...table.rows].filter((row) => !isOut(row) && row.querySelector("[data-runs]"));
    let [row, place] = [rows.indexOf(cell.parentElement) + step[0], cell.cellIndex + step[1]];
    for (; rows[row]?.cells[place]; row += step[0], place += step[1]) {
      const next = rows[row].cells[place];
      if (!next.dataset.runs || next.offsetParent === null) continue;
      event.target.tabIndex = -1;
      next.firstChild.tabIndex = 0;
      next.firstChild.focus();
      return;
    }
  }

  function enhance(table, name) {
    const one = { table, name, rows: [...table.tBodies].flatMap((body) => [...body.rows]) };
    all.push(one);
    const tools = element("div", { class: "tools" });
    if (isSortable(table)) {
      makeSortable(one);
      if (one.rows.length >= MANY_ROWS) tools.append(...makeFilter(one));
    }
    tools.append(menu.button(`Save the table: ${captionOf(table)}`, () => forms(table)));
    const caption = table.caption?.matches(".hidden") ? "" : table.caption?.textContent ?? "";
    const short = caption !== "" && caption.length < SHORT;
    tools.classList.toggle("beside", short);
    const place = table.closest(".scroll") ?? table;
    if (short || !table.closest("header")) place.before(tools);
    else place.after(tools);
    makeCells(table);
  }

  function start() {
    const counts = {};
    for (const table of document.querySelectorAll("table")) {
      if (table.closest(".pictures, #pictures, .panel")) continue;
      const where = table.closest("section[id]")?.id ?? "top";
      counts[where] = (counts[where] ?? -1) + 1;
      enhance(table, `${where}-${counts[where]}`);
    }
    state.on((changed) => {
      for (const one of all) {
        if (changed.has(one.key)) sort(one);
        if (changed.has(one.words)) match(one);
      }
    });
  }

  // After rows were taken out or put back by somebody else.
  const refresh = () => all.forEach(recount);
  return { start, refresh, isOut };
})();
