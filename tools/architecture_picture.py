"""Draw `docs/architecture.svg` from the imports: `python -m tools.architecture_picture` writes it.

Rooms and arrows are those of `tests/test_architecture.py`. Lines of code are rounded to hundreds. The picture is out of
date only when a room or an arrow is added or removed; its numbers may be older.
"""

from collections import Counter
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree

from tests.test_architecture import FLOORS, ROOT, floor_of, graph_of, is_in

PICTURE = ROOT / "docs" / "architecture.svg"
SOURCES = (".py", ".js", ".css", ".html")

WIDTH, MARGIN, TOP = 1000, 20, 84
BOX, LEFT = 156, 182
"""Width of a box, and where the column of the first room begins."""
INK, FAINT, WIRE, PAPER = "#1c2430", "#5b6675", "#bcc4cf", "#ffffff"
COLOURS = {"reports": "#2563a8", "harness": "#1f7a5c", "baselines": "#7b4ba0", "scenes": "#a85a12"}
TINTS = {"reports": "#e3eefa", "harness": "#def2ea", "baselines": "#f0e6f8", "scenes": "#fbeadb"}
SAYS = {
    "reports": "pages, from records alone",
    "harness": "who trains what on what, and what comes of it",
    "baselines": "the methods under comparison",
    "scenes": "what is seen, and its images on disk",
}
"""Package → what it is."""
LEGEND = (
    ("room", "a room: a folder of modules, with its lines of code"),
    ("count", "the left room imports the one below: 12 imports"),
    ("none", "lines that cross without a circle: no import"),
)


@dataclass(frozen=True)
class House:
    """Rooms from the top with their lines of code, and arrows (from, to) with their imports."""

    rooms: dict[str, int]
    arrows: dict[tuple[str, str], int]


def house_of(root: Path) -> House:
    """Return the rooms and arrows of a source tree; an arrow counts imports of a module by a module."""
    lines: Counter[str] = Counter()
    for file in sorted(file for package in COLOURS for file in (root / package).rglob("*") if file.suffix in SOURCES):
        place = floor_of(".".join(file.relative_to(root).with_suffix("").parts))
        if place >= 0:
            lines[FLOORS[place]] += len(file.read_text(encoding="utf-8").splitlines())
    arrows: Counter[tuple[str, str]] = Counter()
    graph = graph_of(root)
    for name, targets in graph.items():
        for target in targets:
            start, end = floor_of(name), floor_of(target)
            if start >= 0 and end >= 0 and start != end:
                arrows[FLOORS[start], FLOORS[end]] += 1
    present = [room for room in FLOORS if any(is_in(name, room) for name in graph)]
    return House({room: round(lines[room], -2) for room in present}, dict(sorted(arrows.items())))


def house_drawn(picture: str) -> House:
    elements = [element.attrib for element in ElementTree.fromstring(picture).iter()]
    return House(
        {row["data-room"]: int(row["data-lines"]) for row in elements if "data-room" in row},
        {(row["data-from"], row["data-to"]): int(row["data-imports"]) for row in elements if "data-from" in row},
    )


def picture_of(house: House) -> str:
    """Return an SVG: rooms as a staircase; an arrow runs along the row of one room and down the column of another."""
    rooms = list(house.rooms)
    cell = (WIDTH - LEFT - MARGIN) / len(rooms)
    height = round(TOP + cell * len(rooms) + MARGIN)
    middle = {room: (LEFT + cell * (place + 0.5), TOP + cell * (place + 0.5)) for place, room in enumerate(rooms)}
    parts = [
        *_frame(height),
        *_packages(rooms, cell),
        *_legend(TOP + cell * 16),
        *_wires(house, middle, cell),
        *_counts(house, middle, cell),
        *_boxes(house, middle, cell),
    ]
    return "\n".join([*parts, "</svg>", ""])


def _frame(height: int) -> list[str]:
    font = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
    how_to_read = "To the right of a room: what it imports. Above a room: what imports it."
    return [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        f'role="img" font-family="{font}" fill="{INK}">',
        "<title>The rooms of the program, and which room imports which</title>",
        f'<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{height - 1}" rx="10" fill="{PAPER}" stroke="{WIRE}"/>',
        _text(MARGIN, 34, "Imports run down the stairs, never up", size=18, weight=700),
        _text(MARGIN, 57, how_to_read, size=13, fill=FAINT),
    ]


def _legend(y: float) -> list[str]:
    shapes = []
    for place, (sign, words) in enumerate(LEGEND):
        at = y + 26 * place
        if sign == "room":
            shapes.append(_rect(MARGIN, at - 7, 30, 14, FAINT, rx=3))
        else:
            shapes += [
                _line(MARGIN, at, MARGIN + 30, at, WIRE),
                _line(MARGIN + 15, at - 10, MARGIN + 15, at + 10, WIRE),
            ]
        if sign == "count":
            shapes.append(f'<circle cx="{MARGIN + 15}" cy="{at:.1f}" r="8" fill="{PAPER}" stroke="{FAINT}"/>')
            shapes.append(_text(MARGIN + 15, at + 3.7, "12", size=10.5, anchor="middle"))
        shapes.append(_text(MARGIN + 42, at + 4, words, size=12, fill=FAINT))
    return shapes


def _packages(rooms: list[str], cell: float) -> list[str]:
    """Draw a tinted square for the rooms of each package, and its name in the empty half of the picture."""
    shapes, place = [], 0
    for package, group in groupby(rooms, lambda room: room.partition(".")[0]):
        count = len(list(group))
        x, y, side = LEFT + cell * place, TOP + cell * place, cell * count
        shapes.append(_rect(x, y, side, side, TINTS[package], rx=4))
        if place:
            shapes.append(_line(MARGIN, y, x, y, WIRE, dash="2 4"))
        middle = y + side - cell / 2
        description = (MARGIN + 104, middle + 5) if count == 1 else (MARGIN, middle + 9)
        below = middle + 5 if count == 1 else middle - 9
        shapes.append(_text(MARGIN, below, package, size=17, weight=700, fill=COLOURS[package]))
        shapes.append(_text(*description, SAYS[package], size=12, fill=FAINT))
        place += count
    return shapes


def _wires(house: House, middle: dict[str, tuple[float, float]], cell: float) -> list[str]:
    """Draw a line to the right of each room, and a line with an arrowhead down to each room."""
    shapes = []
    for room, (x, y) in middle.items():
        if targets := [middle[end][0] for start, end in house.arrows if start == room]:
            shapes.append(_line(x + cell / 2, y, max(targets), y, WIRE))
        if starts := [middle[start][1] for start, end in house.arrows if end == room]:
            top = y - cell / 2 + 2
            shapes.append(_line(x, min(starts), x, top - 4, WIRE))
            shapes.append(f'<path d="M{x - 3:.1f} {top - 5:.1f}h6l-3 5z" fill="{FAINT}"/>')
    return shapes


def _counts(house: House, middle: dict[str, tuple[float, float]], cell: float) -> list[str]:
    """Draw the corner of each arrow with its number of imports; more imports give a larger circle."""
    largest = max(house.arrows.values(), default=1)
    shapes = []
    for (start, end), count in house.arrows.items():
        x, y = middle[end][0], middle[start][1]
        radius = 7 + (cell / 2 - 8) * (count / largest) ** 0.5
        colour = COLOURS[start.partition(".")[0]]
        shapes.append(
            f'<g data-from="{start}" data-to="{end}" data-imports="{count}">'
            f"<title>{escape(f'{start} imports {end}: {count}')}</title>"
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{PAPER}" stroke="{colour}"/>'
            f"{_text(x, y + 3.7, str(count), size=10.5, anchor='middle')}</g>"
        )
    return shapes


def _boxes(house: House, middle: dict[str, tuple[float, float]], cell: float) -> list[str]:
    """Draw the rooms, each with a bar for its lines relative to the largest room."""
    largest = max(100, *house.rooms.values())
    shapes = []
    for room, lines in house.rooms.items():
        package, name = room.partition(".")[0], room.rpartition(".")[2]
        right, y, tall = middle[room][0] + cell / 2, middle[room][1], cell - 5
        left, top = right - BOX, y - tall / 2
        amount = f"{lines:,} lines".replace(",", " ") if lines else "a few lines"
        shapes.append(
            f'<g data-room="{room}" data-lines="{lines}"><title>{room}</title>'
            f"{_rect(left, top, BOX, tall, COLOURS[package], rx=4)}"
            f"{_rect(left + 7, top + tall - 5, (BOX - 14) * lines / largest, 2.5, PAPER, opacity=0.6)}"
            f"{_text(left + 7, y + 2.5, name, size=12.5, weight=600, fill=PAPER)}"
            f"{_text(right - 7, y + 2.5, amount, size=10.5, fill=PAPER, anchor='end')}"
            "</g>"
        )
    return shapes


def _text(
    x: float, y: float, words: str, *, size: float, weight: int = 400, fill: str = INK, anchor: str = "start"
) -> str:
    style = f'font-size="{size}" font-weight="{weight}" fill="{fill}" text-anchor="{anchor}"'
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(words)}</text>'


def _rect(x: float, y: float, width: float, height: float, fill: str, *, rx: float = 0, opacity: float = 1) -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" rx="{rx}"'
    return f'<rect {place} fill="{fill}" fill-opacity="{opacity}"/>'


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, dash: str = "none") -> str:
    place = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {place} stroke="{colour}" stroke-dasharray="{dash}"/>'


if __name__ == "__main__":
    PICTURE.write_text(picture_of(house_of(ROOT)), encoding="utf-8")
