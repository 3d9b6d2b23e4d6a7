// Tables: sorted by a click on a header, filtered by words, saved as CSV, Markdown and LaTeX; a cell opens its runs.
// What a cell is sorted by and saved as stands in its data-value, data-said, data-parts and data-runs.
const tables = (() => {
  const MANY_ROWS = 8;
  const SHORT = 52; // characters of a caption that leave room beside it
  const EMPTY = { text: "", small: "", value: null, parts: {} };
  const compare = new Intl.Collator("en", { numeric: true }).compare;
  const all = [];

  function texts(cell) {
    const small = [...cell.querySelectorAll("small")].filter((one) => one.textContent.trim());
    const copy = cell.cloneNode(true);
    for (const one of copy.querySelectorAll("small, .drawn, input, svg")) one.remove();
    const text = copy.textContent.replace(/[^\S\u00a0\u202f]+/g, " ").trim();
    return {
      text: text || cell.dataset.said || "",
      small: small.map((one) => one.textContent.trim().replace(/\s*\n\s*/g, "; ")).join("; "),
    };
  }

  // Cells as a grid: a wide cell is followed by empty ones.
  function cells(row) {
    return [...row.cells].flatMap((cell) => [cell, ...Array(Math.max(cell.colSpan, 1) - 1).fill(null)]);
  }

  function read(row) {
    return cells(row).map((cell) => {
      if (cell === null) return EMPTY;
      const value = cell.dataset.value === undefined ? null : Number(cell.dataset.value);
      const parts = cell.dataset.parts ? JSON.parse(cell.dataset.parts) : {};
      return { ...texts(cell), value, parts };
    });
  }

  // What is in sight: rows and columns that were taken out are left out of files too, as are those of marks alone.
  // What stands above a group of rows becomes their first column, what qualifies a row in one below it their last.
  function model(table) {
    const head = table.tHead?.rows[table.tHead.rows.length - 1];
    const heads = head ? cells(head) : [];
    const kept = (_, place) => !heads[place]?.matches(".column-out, .drawn");
    const noted = table.querySelector("tr.why") !== null;
    const rowsOf = (rows) => [...rows].filter((row) => !isOut(row) && !groupOf(row) && !isNote(row))
      .map((row) => [...read(row).filter(kept), ...(noted ? [noteOf(row)] : [])]);
    const groups = [...table.tBodies].map((body) => groupOf(body.rows[0]));
    const rows = [...table.tBodies].flatMap((body, place) => {
      const own = groups[place] ? [{ ...EMPTY, ...texts(groups[place]) }] : [];
      return rowsOf(body.rows).map((row) => [...own, ...row]);
    });
    const totals = table.tFoot && !table.tFoot.hasAttribute("aria-hidden") ? rowsOf(table.tFoot.rows) : [];
    const first = groups.some(Boolean) ? [null] : [];
    const columns = [...first, ...heads.filter(kept)].map((cell, place) => {
      const { text, small } = cell ? texts(cell) : { text: first.length > place ? groups.find(Boolean).dataset.label : "", small: "" };
      const numeric = [...rows, ...totals].some((row) => typeof row[place]?.value === "number");
      return { label: small ? `${text} (${small})`.trim() : text, numeric: numeric || isRight(cell) };
    });
    if (noted) columns.push({ label: "note", numeric: false });
    return { caption: captionOf(table), columns, rows, totals };
  }

  function isNote(row) {
    return row?.classList.contains("why") ?? false;
  }

  function noteOf(row) {
    const next = row.nextElementSibling;
    return isNote(next) ? { ...EMPTY, ...texts(next.cells[0]) } : EMPTY;
  }

  function groupOf(row) {
    return row?.querySelector("th[scope=rowgroup]") ?? null;
  }

  function isRight(cell) {
    return cell && !cell.classList.contains("words") && getComputedStyle(cell).textAlign === "right";
  }

  function isOut(row) {
    return row.classList.contains("out") || row.classList.contains("unmatched");
  }

  function captionOf(table) {
    const caption = table.caption?.cloneNode(true);
    caption?.querySelector(".save")?.remove();
    const text = caption?.textContent.replace(/\s+/g, " ").trim();
    const study = table.closest(".study")?.querySelector(".eyebrow")?.textContent;
    return [study, text].filter(Boolean).join(" – ") || table.closest("[aria-label]")?.getAttribute("aria-label") || "table";
  }

  // Numbers in full, with a column of its own for every further number and for what stands small below.
  function csv(table) {
    const { columns, rows, totals } = model(table);
    const every = [...rows, ...totals];
    const plan = columns.map((column, place) => {
      const own = every.map((row) => row[place]).filter(Boolean);
      const names = [...new Set(own.flatMap((cell) => Object.keys(cell.parts)))];
      return { column, names, noted: own.some((cell) => cell.small) };
    });
    const head = plan.flatMap(({ column, names, noted }) => [
      column.label, ...names.map((name) => `${column.label} ${name}`), ...(noted ? [`${column.label} note`] : []),
    ]);
    const line = (row) => plan.flatMap(({ names, noted }, place) => {
      const cell = row[place] ?? EMPTY;
      // of a range the ends alone, which stand beside
      const missing = cell.text === numbers.NOTHING || Object.values(cell.parts).some(Number.isFinite);
      const first = cell.value ?? (missing ? "" : cell.text);
      return [first, ...names.map((name) => cell.parts[name] ?? ""), ...(noted ? [cell.small] : [])];
    });
    return download.csv([head, ...every.map(line)]);
  }

  function savings(table) {
    const title = captionOf(table);
    return [
      ...(drawnTables.is(table) ? [["SVG", () => download.save(title, "svg", drawnTables.svg(table, title), "image/svg+xml")]] : []),
      ["CSV", () => download.save(title, "csv", csv(table), "text/csv")],
      ["Markdown", () => download.save(title, "md", download.markdown(model(table)), "text/markdown")],
      ["LaTeX", () => download.save(title, "tex", download.latex(model(table)), "application/x-tex")],
    ];
  }

  function isSortable(table) {
    const rows = table.tBodies.length === 1 ? [...table.tBodies[0].rows] : [];
    const plain = rows.every((row) => [...row.cells].every((cell) => cell.colSpan === 1 && cell.rowSpan === 1));
    return rows.length > 1 && plain && table.tHead?.rows.length === 1 && !table.matches(".facts, .pictures, .forest");
  }

  // A number; a text; null where nothing is there, which stays last whichever way it is sorted.
  function key(row, place) {
    const cell = row.cells[place];
    if (!cell) return null;
    if (cell.dataset.value !== undefined) return Number(cell.dataset.value);
    const { text } = texts(cell);
    return text === "" || text === numbers.NOTHING ? null : text;
  }

  function before(a, b, falling) {
    if (a === null || b === null) return (a === null) - (b === null);
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    const order = typeof a === "number" ? a - b : compare(a, b);
    return falling ? -order : order;
  }

  function sort(one, text) {
    const found = /^(\d+)([ad])$/.exec(text ?? "");
    const place = found ? Number(found[1]) : -1;
    const known = place >= 0 && place < one.heads.length;
    const falling = known && found[2] === "d";
    const rows = known
      ? one.rows.map((row) => [key(row, place), row]).sort((a, b) => before(a[0], b[0], falling)).map(([, row]) => row)
      : one.rows;
    one.table.tBodies[0].append(...rows);
    one.heads.forEach((head, at) => {
      if (at === place) head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
    one.sorted = known;
    regroup(one);
  }

  // Where rows no longer stand below the one that names their scene, each names its own.
  function regroup(one) {
    const torn = one.sorted || one.rows.some(isOut);
    one.table.classList.toggle("regrouped", torn);
  }

  function makeSortable(one) {
    const cells = [...one.table.tHead.rows[0].cells];
    one.heads = cells;
    cells.forEach((cell, place) => {
      if (!cell.textContent.trim()) return;
      const numeric = one.rows.some((row) => row.cells[place]?.dataset.value !== undefined);
      const next = { "": numeric ? "d" : "a", d: numeric ? "a" : "", a: numeric ? "" : "d" };
      const button = element("button", { type: "button", class: "sort", title: "sort", click: () => {
        const now = state.get(one.key);
        const way = next[now?.slice(0, -1) === String(place) ? now.slice(-1) : ""];
        state.set({ [one.key]: way ? `${place}${way}` : null });
      } });
      button.append(...cell.childNodes);
      cell.append(button);
    });
    sort(one, state.get(one.key));
  }

  function makeFilter(one) {
    one.words = `table.${one.name}.words`;
    one.count = element("span", { class: "count", role: "status" });
    one.field = element("input", {
      type: "search", class: "rows", placeholder: "filter rows", "aria-label": `Filter rows: ${captionOf(one.table)}`,
      autocomplete: "off", spellcheck: "false",
      input: (event) => state.set({ [one.words]: event.target.value.trim() || null }),
    });
    match(one);
    return [one.field, one.count];
  }

  function match(one) {
    const text = one.field ? state.get(one.words) ?? "" : "";
    const words = text.toLowerCase().split(/\s+/).filter(Boolean);
    if (one.field && document.activeElement !== one.field) one.field.value = text;
    for (const row of one.rows) {
      const said = `${row.textContent} ${[...row.cells].map((cell) => cell.dataset.said ?? "").join(" ")}`.toLowerCase();
      row.classList.toggle("unmatched", !words.every((word) => said.includes(word)));
    }
    recount(one);
  }

  function recount(one) {
    const left = one.rows.filter((row) => !isOut(row)).length;
    if (one.count) one.count.textContent = left < one.rows.length ? `${left} of ${one.rows.length}` : "";
    regroup(one);
  }

  // One stop for the tab key in a table, arrow keys from cell to cell.
  function makeCells(one) {
    const found = [...one.table.querySelectorAll("[data-runs]")];
    for (const cell of found) {
      const button = element("button", { type: "button", class: "behind", title: "the runs behind this", tabindex: "-1" });
      const nodes = [...cell.childNodes];
      const small = nodes.findIndex((node) => node.nodeName === "SMALL");
      button.append(...nodes.slice(0, small < 0 ? nodes.length : small));
      cell.prepend(button);
      cell.addEventListener("click", (event) => {
        if (!event.target.closest("a") && !getSelection().toString()) runs.open(JSON.parse(cell.dataset.runs), button);
      });
    }
    if (found.length > 0) found[0].firstChild.tabIndex = 0;
    one.table.addEventListener("keydown", (event) => move(event, one.table));
  }

  function move(event, table) {
    const cell = event.target.closest("[data-runs]");
    const step = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[event.key];
    if (!cell || !step || !event.target.matches(".behind")) return;
    event.preventDefault();
    const rows = [...table.rows].filter((row) => !isOut(row) && row.querySelector("[data-runs]"));
    let row = rows.indexOf(cell.parentElement) + step[0];
    let place = cell.cellIndex + step[1];
    while (rows[row] && place >= 0 && place < rows[row].cells.length) {
      const next = rows[row].cells[place];
      if (next.dataset.runs && next.offsetParent !== null) {
        event.target.tabIndex = -1;
        next.firstChild.tabIndex = 0;
        return next.firstChild.focus();
      }
      row += step[0];
      place += step[1];
    }
  }

  function enhance(table, name) {
    const one = { table, name, key: `table.${name}.sort`, rows: [...table.tBodies].flatMap((body) => [...body.rows]) };
    all.push(one);
    const tools = element("div", { class: "tools" });
    if (isSortable(table)) {
      makeSortable(one);
      if (one.rows.length >= MANY_ROWS) tools.append(...makeFilter(one));
    }
    tools.append(menu.button(`Save the ${drawnTables.is(table) ? "figure" : "table"}: ${captionOf(table)}`, () => savings(table)));
    const caption = table.caption?.classList.contains("hidden") ? "" : table.caption?.textContent ?? "";
    const short = caption !== "" && caption.length < SHORT;
    tools.classList.toggle("beside", short);
    const place = table.closest(".scroll") ?? table;
    if (short || !table.closest("header")) place.before(tools);
    else place.after(tools);
    makeCells(one);
  }

  function start() {
    const counts = new Map();
    for (const table of document.querySelectorAll("table:not(.pictures):not(.panel table)")) {
      if (table.closest(".pictures, #pictures, .panel")) continue;
      const where = table.closest("section[id]")?.id ?? "top";
      const place = counts.get(where) ?? 0;
      counts.set(where, place + 1);
      enhance(table, `${where}-${place}`);
    }
    state.on((changed) => {
      for (const one of all) {
        if (one.heads && changed.has(one.key)) sort(one, state.get(one.key));
        if (one.field && changed.has(one.words)) match(one);
      }
    });
  }

  // After rows were taken out or put back by somebody else.
  function refresh() {
    for (const one of all) recount(one);
  }
  return { start, refresh, isOut };
})();
