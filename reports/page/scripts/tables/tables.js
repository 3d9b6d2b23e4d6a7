// Tables: sorted by a click on a header, filtered by words, saved as CSV, Markdown and LaTeX; a cell opens its runs.
// The attributes data-value, data-said, data-parts and data-runs of a cell hold its values for sorting and saving.
const tables = (() => {
  const MANY_ROWS = 8;
  const SHORT = 52; // characters of a caption that leaves room for the tools
  const EMPTY = { text: "", small: "", value: null, parts: {} };
  const STEPS = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] };
  const { compare } = new Intl.Collator("en", { numeric: true });
  const all = [];

  // The content of a cell: {text, small, value, parts}.
  function read(cell) {
    if (!cell) return EMPTY;
    const copy = cell.cloneNode(true);
    const small = [...copy.querySelectorAll("small")].map(({ textContent }) => textContent.trim().replace(/\s*\n\s*/g, "; "));
    for (const node of copy.querySelectorAll("small, input, svg")) node.remove();
    const text = copy.textContent.replace(/[^\S\u00a0\u202f]+/g, " ").trim();
    const { value, said, parts } = cell.dataset;
    return {
      text: text || said || "",
      small: small.filter(Boolean).join("; "),
      value: value === undefined ? null : Number(value),
      parts: parts ? JSON.parse(parts) : {},
    };
  }

  // The cells of a row; null fills the columns of a wide cell.
  const cellsOf = (row) => [...(row?.cells ?? [])].flatMap((cell) => [cell, ...Array(cell.colSpan - 1).fill(null)]);
  const isOut = (row) => row.matches(".out, .unmatched");
  const isNote = (row) => row?.matches(".why") ?? false;
  const isRight = (cell) => Boolean(cell) && !cell.matches(".words") && getComputedStyle(cell).textAlign === "right";

  // The visible rows and columns, for saving. The note in the row below a row becomes its last column.
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
    const columns = heads.filter(isKept).map((head, place) => ({ label: download.wordsOf(read(head)), numeric: isRight(head) || isNumeric(place) }));
    return { caption: captionOf(table), columns: [...columns, ...(noted ? [{ label: "note", numeric: false }] : [])], rows, totals };
  }

  function captionOf(table) {
    const text = table.caption?.textContent.replace(/\s+/g, " ").trim();
    const study = table.closest(".study")?.querySelector(".eyebrow")?.textContent;
    return [study, text].filter(Boolean).join(" – ") || table.closest("[aria-label]")?.getAttribute("aria-label") || "table";
  }

  // Unrounded numbers, with separate columns for additional numbers and for the small text.
  function csv(table) {
    const { columns, rows, totals } = model(table);
    const every = [...rows, ...totals];
    const written = columns.flatMap(({ label }, place) => {
      const cells = every.map((row) => row[place] ?? EMPTY);
      const names = [...new Set(cells.flatMap(({ parts }) => Object.keys(parts)))];
      // a range has no value, only its ends in separate columns
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

  // A number, a text, or null for an empty cell, which stays last in both orders.
  function keyOf(row, place) {
    const { value, text } = read(row.cells[place]);
    return value ?? (text === "" || text === numbers.NOTHING ? null : text);
  }

  function order(a, b, falling) {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return (typeof a === "number" ? a - b : compare(a, b)) * (falling ? -1 : 1);
  }

  // Sorts as in the address: the number of a column and `a`scending or `d`escending.
  function sort(entry) {
    const [, digits, way] = /^(\d+)([ad])$/.exec(state.get(entry.key) ?? "") ?? [];
    const place = digits < entry.heads.length ? Number(digits) : -1;
    const keyed = entry.rows.map((row) => [place < 0 ? null : keyOf(row, place), row]);
    if (place >= 0) keyed.sort(([a], [b]) => order(a, b, way === "d"));
    entry.table.tBodies[0].append(...keyed.map(([, row]) => row));
    entry.heads.forEach((head, at) => {
      head.ariaSort = at === place ? { a: "ascending", d: "descending" }[way] : null;
    });
    recount(entry);
  }

  function makeSortable(entry) {
    entry.key = `table.${entry.name}.sort`;
    entry.heads = [...entry.table.tHead.rows[0].cells];
    entry.heads.forEach((head, place) => {
      if (!head.textContent.trim() || head.querySelector(".hidden")) return;
      // the first click sorts numbers descending and texts ascending; the third restores the original order
      const numeric = entry.rows.some((row) => row.cells[place]?.dataset.value !== undefined);
      const ways = (numeric ? ["d", "a"] : ["a", "d"]).map((way) => `${place}${way}`);
      const click = () => state.set({ [entry.key]: ways[ways.indexOf(state.get(entry.key)) + 1] });
      head.append(element.button("sort", [...head.childNodes], click, { title: "sort" }));
    });
    sort(entry);
  }

  function makeFilter(entry) {
    entry.words = `table.${entry.name}.words`;
    entry.count = element("span", { class: "count", role: "status" });
    entry.field = element("input", {
      type: "search", class: "rows", placeholder: "filter rows", "aria-label": `Filter rows: ${captionOf(entry.table)}`,
      autocomplete: "off", spellcheck: "false",
      input: () => state.set({ [entry.words]: entry.field.value.trim() || null }),
    });
    match(entry);
    return [entry.field, entry.count];
  }

  function match(entry) {
    const text = state.get(entry.words) ?? "";
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    if (document.activeElement !== entry.field) entry.field.value = text;
    for (const row of entry.rows) {
      const said = [row.textContent, ...[...row.cells].map((cell) => cell.dataset.said ?? "")].join(" ").toLowerCase();
      row.classList.toggle("unmatched", !words.every((word) => said.includes(word)));
    }
    recount(entry);
  }

  // Counts the visible rows; rows that are no longer below the row with their scene name the scene themselves.
  function recount(entry) {
    const left = entry.rows.filter((row) => !isOut(row)).length;
    const torn = left < entry.rows.length || entry.heads?.some((head) => head.hasAttribute("aria-sort"));
    if (entry.count) entry.count.textContent = left < entry.rows.length ? `${left} of ${entry.rows.length}` : "";
    entry.table.classList.toggle("regrouped", Boolean(torn));
  }

  // The tab key stops once per table; arrow keys move between cells.
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
    const entry = { table, name, rows: [...table.tBodies].flatMap((body) => [...body.rows]) };
    all.push(entry);
    const tools = element("div", { class: "tools" });
    if (isSortable(table)) {
      makeSortable(entry);
      if (entry.rows.length >= MANY_ROWS) tools.append(...makeFilter(entry));
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
      for (const entry of all) {
        if (changed.has(entry.key)) sort(entry);
        if (changed.has(entry.words)) match(entry);
      }
    });
  }

  // Called after other parts have hidden or restored rows.
  const refresh = () => all.forEach(recount);
  return { start, refresh };
})();
