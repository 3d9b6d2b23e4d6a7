// Files that the page gives: CSV, Markdown and LaTeX from rows of cells, any text under a sound name.
// Names in them come from data and may be hostile: each format escapes what it would take for its own.
const download = (() => {
  // Under a name of letters, digits and dashes.
  function save(title, extension, text, type) {
    saveBlob(title, extension, new Blob([text], { type: `${type};charset=utf-8` }));
  }

  function saveBlob(title, extension, blob) {
    const url = URL.createObjectURL(blob);
    saveFrom(title, extension, url);
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  }

  // What lies at an address of the page's own.
  function saveFrom(title, extension, address) {
    const link = element("a", { href: address, download: `${fileName(title)}.${extension}` });
    document.body.append(link);
    link.click();
    link.remove();
  }

  function fileName(title) {
    const plain = title.normalize("NFKD").replace(/[^A-Za-z0-9]+/g, "-").replace(/^-+|-+$/g, "");
    return plain.slice(0, 80).toLowerCase() || "figure";
  }

  // RFC 4180. A text that a spreadsheet would run as a formula gets an apostrophe; numbers stay numbers.
  function csv(rows) {
    return rows.map((row) => row.map(csvField).join(",")).join("\r\n") + "\r\n";
  }

  function csvField(value) {
    if (value === null || value === undefined) return "";
    if (typeof value === "number") return String(value);
    const isNumber = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(value);
    const text = !isNumber && /^[\s]*[=+\-@]|^[\t\r]/.test(value) ? `'${value}` : value;
    return /[",\r\n]/.test(text) || text !== text.trim() ? `"${text.replace(/"/g, '""')}"` : text;
  }

  // The words of a cell {text, small} in one line.
  const wordsOf = ({ text, small }) => (small ? `${text} (${small})`.trim() : text);

  // `table`: {caption, columns: [{label, numeric}], rows: [[{text, small}]], totals: likewise}.
  function markdown({ caption, columns, rows, totals }) {
    const line = (cells) => `| ${cells.join(" | ")} |`;
    const cell = (one) => markdownText(wordsOf(one));
    const bold = (one) => cell(one) && `**${cell(one)}**`;
    return [
      `**${markdownText(caption)}**`, "",
      line(columns.map(({ label }) => markdownText(label))),
      line(columns.map(({ numeric }) => (numeric ? "---:" : ":---"))),
      ...rows.map((row) => line(row.map(cell))),
      ...totals.map((row) => line(row.map(bold))), "",
    ].join("\n");
  }

  function markdownText(text) {
    return text
      .replace(/[\\`*_[\]|#~]/g, "\\$&")
      .replace(/&/g, "&amp;")
      .replace(/</g, "&lt;")
      .replace(/>/g, "&gt;")
      .replace(/\s*[\r\n]+\s*/g, " ");
  }

  // With booktabs.
  function latex({ caption, columns, rows, totals }) {
    // the line before would take a star or a bracket for its own
    const line = (cells) => `${/^\s*[[*]/.test(cells[0]) ? "{}" : ""}${cells.join(" & ")} \\\\`;
    const lines = (some) => some.map((row) => line(row.map((cell) => latexText(wordsOf(cell)))));
    return [
      "% needs \\usepackage{booktabs} and \\usepackage{amssymb}",
      "\\begin{table}",
      "\\centering",
      `\\caption{${latexText(caption)}}`,
      `\\begin{tabular}{${columns.map(({ numeric }) => (numeric ? "r" : "l")).join("")}}`,
      "\\toprule",
      line(columns.map(({ label }) => latexText(label))),
      "\\midrule",
      ...lines(rows),
      ...(totals.length > 0 ? ["\\midrule", ...lines(totals)] : []),
      "\\bottomrule",
      "\\end{tabular}",
      "\\end{table}", "",
    ].join("\n");
  }

  const GREEK = {
    α: "alpha", β: "beta", γ: "gamma", δ: "delta", ε: "varepsilon", η: "eta", θ: "theta", κ: "kappa", λ: "lambda",
    μ: "mu", µ: "mu", ν: "nu", π: "pi", ρ: "rho", σ: "sigma", τ: "tau", φ: "varphi", ϕ: "phi", χ: "chi", ψ: "psi",
    ω: "omega", Γ: "Gamma", Δ: "Delta", Λ: "Lambda", Π: "Pi", Σ: "Sigma", Φ: "Phi", Ψ: "Psi", Ω: "Omega",
  };
  const SIGNS = {
    "\\": "\\textbackslash{}", "{": "\\{", "}": "\\}", $: "\\$", "&": "\\&", "#": "\\#", "%": "\\%", _: "\\_",
    "^": "\\textasciicircum{}", "~": "\\textasciitilde{}", "<": "$<$", ">": "$>$", "|": "$|$", '"': "''",
    "−": "$-$", "±": "$\\pm$", "×": "$\\times$", "·": "$\\cdot$", "≤": "$\\le$", "≥": "$\\ge$", "≈": "$\\approx$",
    "→": "$\\to$", "↑": "$\\uparrow$", "↓": "$\\downarrow$", "∞": "$\\infty$", "√": "$\\surd$", "∈": "$\\in$",
    "✓": "$\\checkmark$", "✕": "$\\times$", "▲": "$\\blacktriangle$", "▼": "$\\blacktriangledown$", "°": "$^\\circ$",
    "–": "--", "—": "---", "’": "'", "‘": "`", "“": "``", "”": "''", "…": "\\ldots{}",
    "\u202f": "\\,", "\u2009": "\\,", "\u00a0": "~",
  };
  const RAISED = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹";
  const LOWERED = "₋₀₁₂₃₄₅₆₇₈₉";

  function latexText(text) {
    const levels = (some, mark) => (found) =>
      `$${mark}{${[...found].map((one) => "-0123456789"[some.indexOf(one)]).join("")}}$`;
    return [...text.replace(/\s*[\r\n]+\s*/g, " ")]
      .map((one) => SIGNS[one] ?? (GREEK[one] ? `$\\${GREEK[one]}$` : one))
      .join("")
      .replace(new RegExp(`[${RAISED}]+`, "g"), levels(RAISED, "^"))
      .replace(new RegExp(`[${LOWERED}]+`, "g"), levels(LOWERED, "_"));
  }
  return { save, saveBlob, saveFrom, csv, markdown, latex };
})();
