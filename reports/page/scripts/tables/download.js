// Files saved from the page: CSV, Markdown and LaTeX from rows of cells, or any text.
// Names come from data and may be hostile: each format escapes its own special characters.
const download = (() => {
  // The file name consists of letters, digits and dashes.
  function save(title, extension, text, type) {
    saveBlob(title, extension, new Blob([text], { type: `${type};charset=utf-8` }));
  }

  function saveBlob(title, extension, blob) {
    const url = URL.createObjectURL(blob);
    saveFrom(title, extension, url);
    setTimeout(() => URL.revokeObjectURL(url), 10000);
  }

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

  // RFC 4180. A text that a spreadsheet would run as a formula gets an apostrophe; numbers are unchanged.
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

  // The text of a cell {text, small} in one line.
  const wordsOf = ({ text, small }) => (small ? `${text} (${small})`.trim() : text);

  // `table`: {caption, columns: [{label, numeric}], rows: [[{text, small}]], totals: likewise}.
  function markdown({ caption, columns, rows, totals }) {
    const line = (cells) => `| ${cells.join(" | ")} |`;
    const plain = (cell) => markdownText(wordsOf(cell));
    const bold = (cell) => plain(cell) && `**${plain(cell)}**`;
    return [
      `**${markdownText(caption)}**`, "",
      line(columns.map(({ label }) => markdownText(label))),
      line(columns.map(({ numeric }) => (numeric ? "---:" : ":---"))),
      ...rows.map((row) => line(row.map(plain))),
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
    // the previous line would read a star or a bracket as its argument
    const line = (cells) => `${/^\s*[[*]/.test(cells[0]) ? "{}" : ""}${cells.join(" & ")} \\\\`;
    const lines = (part) => part.map((row) => line(row.map((cell) => latexText(wordsOf(cell)))));
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
    const levels = (digits, mark) => (match) =>
      `$${mark}{${[...match].map((sign) => "-0123456789"[digits.indexOf(sign)]).join("")}}$`;
    return [...text.replace(/\s*[\r\n]+\s*/g, " ")]
      .map((sign) => SIGNS[sign] ?? (GREEK[sign] ? `$\\${GREEK[sign]}$` : sign))
      .join("")
      .replace(new RegExp(`[${RAISED}]+`, "g"), levels(RAISED, "^"))
      .replace(new RegExp(`[${LOWERED}]+`, "g"), levels(LOWERED, "_"));
  }
  return { save, saveBlob, saveFrom, csv, wordsOf, markdown, latex };
})();
