"""The table of a judgement in the forms that are pasted into papers and pages: Markdown, LaTeX and CSV."""

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

from harness.records.judgements import JudgementRecord
from harness.verdicts.judging.judgement import table
from scenes.files.atomic import write_atomically

ESCAPED = {"\\": "\\textbackslash{}", **{sign: f"\\{sign}" for sign in "&%$#_{}"}, "−": "$-$", "–": "--"}


def write_tables(folder: Path, record: JudgementRecord) -> None:
    """Write `judgement.md`, `.tex` and `.csv` into a folder, and those of further metrics with the metric's name."""
    names = ["judgement"]
    for other in record.other_metrics:
        name = "judgement." + re.sub(r"\W", "_", other.metric)
        # metrics such as "f@1" and "f%1" differ in signs that a file's name cannot have
        names.append(f"{name}.{len(names)}" if name in names else name)
    for name, judged in zip(names, [record, *record.other_metrics], strict=True):
        rows = table(judged)
        for suffix, text in (("md", as_markdown(rows)), ("tex", as_latex(rows)), ("csv", as_csv(rows))):
            write_atomically(folder / f"{name}.{suffix}", text.encode("utf-8"))


def as_markdown(rows: Sequence[Sequence[str]]) -> str:
    head, *body = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    lines = [head, ["---"] * len(head), *body]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def as_latex(rows: Sequence[Sequence[str]]) -> str:
    """Return a `tabular` with the rules of booktabs."""

    def line(row: Sequence[str]) -> str:
        return " & ".join("".join(ESCAPED.get(letter, letter) for letter in cell) for cell in row) + " \\\\\n"

    head, *body = rows
    columns = "l" + "r" * (len(head) - 2) + "l"
    inner = f"\\toprule\n{line(head)}\\midrule\n{''.join(map(line, body))}\\bottomrule\n"
    return f"\\begin{{tabular}}{{{columns}}}\n{inner}\\end{{tabular}}\n"


def as_csv(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
