"""Texts as grids of cells: CSV, Markdown and LaTeX. `layout` says which cells are scenes, methods and scores."""

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.verdicts.tables.numbers import BRACED, THOUSANDS, plain
from scenes.files.errors import InputError

ENVIRONMENT = r"(?!eqn)[a-zA-Z]*(?:[tT]abular|longtable|tblr|[aA]rray)[xyX]?\*?"
NESTED = re.compile(
    rf"\\begin\{{({ENVIRONMENT})\}}(?:\[[^\]]*\])?{BRACED}((?:[^&\\]|\\(?!(?:begin|end)\{{).)*)\\end\{{\1\}}", re.DOTALL
)
"""A table of one column, as within a cell of several lines."""
RULES = re.compile(
    r"\\(?:(?:top|mid|bottom|[hH])(?:rule|line)|hdashline|endhead|endfirsthead|endfoot|endlastfoot|centering|"
    r"(?:cmidrule|cline|specialrule|cdashline|Xhline|addlinespace)(?:\([^)]*\))?)(?:\[[^\]]*\]|\{[^{}]*\})*"
)


@dataclass(frozen=True)
class Grid:
    """A table as text: rows of cells of equal number, and the line of each."""

    rows: list[list[str]]
    lines: list[int]
    around: tuple[str, ...] = ()
    """The texts around that may name a metric, the nearest first: headings, sentences, captions."""
    titles: tuple[str, ...] = ()
    """The rows that are titles of groups, which are not in `rows`."""


def grids_of(path: Path, text: str) -> list[Grid]:
    """Return all tables of a text; raises `InputError` for a text without any."""
    name = path.suffix.lower()
    if name == ".tex" or re.search(rf"\\begin\{{{ENVIRONMENT}\}}", text):
        grids = list(_latex(text))
    elif name in (".md", ".markdown") or any(map(_divides, text.split("\n"))):
        grids = list(_markdown(text))
    elif text.lstrip().startswith(("<", "+--")):
        raise InputError(f"{path}: is a page or a drawn table; save the table as CSV, Markdown or LaTeX")
    else:
        return [_from_csv(path, text)]
    if not grids:
        raise InputError(f"{path}: holds no table; give one as CSV, Markdown or LaTeX")
    return grids


def _divides(line: str) -> bool:
    """Return whether a line divides the header of a Markdown table from its rows."""
    return "--" in line and "|" in line and not line.strip(" \t\r:|-")


def _from_csv(path: Path, text: str) -> Grid:
    first, _, rest = text.partition("\n")
    declared = re.fullmatch(r"\s*sep=(.)\s*", first)  # as Excel writes it
    skipped = 1 if declared else 0
    text = rest if declared else text
    mark = declared[1] if declared else _delimiter(text)
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=mark))
    except csv.Error as error:
        raise InputError(f"{path}: is not a CSV file ({error})") from error
    numbered = [(row, line) for line, row in enumerate(rows, skipped + 1)]
    while numbered and not any(map(str.strip, numbered[-1][0])):
        numbered.pop()
    titles = []
    while len(numbered) > 1 and sum(bool(cell.strip()) for cell in numbered[0][0]) <= 1 < len(numbered[-1][0]):
        titles.append("".join(numbered.pop(0)[0]).strip())
    if not numbered:
        raise InputError(f"{path}: is empty; give a table with a header and rows")
    (names, top), *body = numbered
    for row, line in body:
        if not row:
            raise InputError(f"{path}, line {line}: is empty; delete it")
        if len(row) < len(names) or any(map(str.strip, row[len(names) :])):
            raise InputError(f"{path}, line {line}: has {len(row)} fields, the header has {len(names)}")
    cells = [[plain(cell) for cell in row[: len(names)]] for row, _ in numbered]
    return Grid(_with_points(cells, mark), [top, *(line for _, line in body)], tuple(filter(None, reversed(titles))))


def _delimiter(text: str) -> str:
    """Return the sign that most lines have equally often; a comma last, as it may be a decimal mark."""
    lines = [line for line in text.split("\n", 30)[:30] if line.strip()]

    def agreeing(sign: str) -> int:
        counts = Counter(line.count(sign) for line in lines)
        return max((many for count, many in counts.items() if count), default=0)

    return max("\t;,", key=agreeing)


def _with_points(rows: list[list[str]], mark: str) -> list[list[str]]:
    """Return the cells with decimal points: a comma divides thousands where no number of the table has another use
    for it, as in `30,000`.
    """
    cells = [cell for row in rows[1:] for cell in row]
    commas = [cell for cell in cells if re.match(r"[+\-−]?\d+,\d", cell)]
    has_points = any(re.match(r"[+\-−]?\d+\.\d", cell) for cell in cells)
    if mark == ";" or not has_points or not all(THOUSANDS.fullmatch(cell) for cell in commas):
        return rows
    return [[cell.replace(",", "") if THOUSANDS.fullmatch(cell) else cell for cell in row] for row in rows]


def _markdown(text: str) -> Iterator[Grid]:
    """Yield the tables with pipes; a line of dashes divides header and rows."""
    around, rows, numbers = list[str](), list[list[str]](), list[int]()
    for line_number, line in enumerate([*text.splitlines(), ""], 1):
        if "|" in line:
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().removeprefix("|").removesuffix("|"))]
            if not all(re.fullmatch(r":?-+:?", cell) for cell in cells):
                rows.append(list(map(plain, cells)))
                numbers.append(line_number)
            continue
        if len(rows) > 1:
            yield _even(rows, numbers, around)
        if rows:
            around, rows, numbers = [], [], []
        if line.strip():
            around.insert(0, plain(line.strip("# ")))


def _latex(text: str) -> Iterator[Grid]:
    """Yield the bodies of tables; a cell of several columns is repeated."""
    text = re.sub(r"(?<!\\)((?:\\\\)*)%.*", r"\1", text)
    text = NESTED.sub(r"\\makecell{\2}", text)
    tables = list(re.finditer(rf"\\begin\{{({ENVIRONMENT})\}}(.*?)\\end\{{\1\}}", text, re.DOTALL))
    for place, match in enumerate(tables):
        # the specification of the columns, which may hold nested braces, ends before the first line that has a cell
        body = re.sub(rf"^(?:\s*\[[^\]]*\])?(?:\s*{BRACED})+(?:\[[^\]]*\])?", "", match[2])
        line = text[: match.end(2) - len(body)].count("\n") + 1
        rows, numbers = [], []
        for part in _split(re.sub(r"\\tabularnewline(?![a-zA-Z])", r"\\\\", body), "\\\\"):
            row = RULES.sub("", re.sub(r"^\s*\*?\s*(?:\[[^\]]*\])?", "", part))
            if "&" in row:
                rows.append([spanned for cell in _split(row, "&") for spanned in _spanned(cell)])
                numbers.append(line + part[: len(part) - len(part.lstrip())].count("\n"))
            elif row.strip():
                rows.append([spanned for spanned in _spanned(row)])
                numbers.append(line)
            line += part.count("\n")
        if len(rows) > 1:
            before = text[tables[place - 1].end() if place else 0 : match.start()]
            after = text[match.end() : tables[place + 1].start() if place + 1 < len(tables) else None]
            yield _even(rows, numbers, _captions(before, after))


def _split(text: str, mark: str) -> list[str]:
    """Split at `mark` outside braces."""
    parts, depth, begin, place = [], 0, 0, 0
    while place < len(text):
        if text.startswith(mark, place) and depth == 0:
            parts.append(text[begin:place])
            begin = place = place + len(mark)
            continue
        if text[place] == "\\":
            place += 2
            continue
        depth = max(0, depth + {"{": 1, "}": -1}.get(text[place], 0))
        place += 1
    return [*parts, text[begin:]]


def _captions(before: str, after: str) -> list[str]:
    """Return the captions of a table: that of its own environment first, then the nearest text before it."""
    caption = r"\\caption(?:of\{[^{}]*\})?\*?(?:\[[^\]]*\])?\{([^{}]*(?:\{[^{}]*\}[^{}]*)*)\}"
    opened = [match.end() for match in re.finditer(r"\\begin\{(?:sub|wrap)?table\*?\}", before)]
    closed = re.search(r"\\end\{(?:sub|wrap)?table\*?\}", after)
    own = before[opened[-1] :] if opened else ""
    within = [*reversed(re.findall(caption, own)), *re.findall(caption, after[: closed.start()] if closed else "")]
    outside = re.findall(
        caption, re.sub(r"\\begin\{figure\*?\}.*?\\end\{figure\*?\}", "", before[-600:], flags=re.DOTALL)
    )
    near = [] if within else [*reversed(outside), *re.findall(caption, after[:600])]
    return list(map(plain, [*within, *near]))


def _spanned(cell: str) -> list[str]:
    match = re.match(r"\s*\\multicolumn\s*\{(\d+)\}\s*\{(?:[^{}]|\{[^{}]*\})*\}\s*\{(.*)\}\s*$", cell, re.DOTALL)
    return [plain(match[2])] * min(int(match[1]), 1000) if match else [plain(cell)]


def _even(rows: list[list[str]], numbers: list[int], around: list[str]) -> Grid:
    """Return a grid with all rows padded to the longest."""
    longest = max(map(len, rows))
    return Grid(_with_points([row + [""] * (longest - len(row)) for row in rows], "|"), numbers, tuple(around))
