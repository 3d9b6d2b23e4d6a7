"""What tells the lines of a chart apart: colour, marker and dash together, in the chart and in the key beside it."""

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup

from reports import palette

COLOURS = (*(palette.KNOWN[name] for name in ("nerf", "qnerf")), *palette.OTHERS)
"""Far apart for every kind of colour vision where there are few; methods keep their own colours."""
MARKERS = (("o", False), ("D", True), ("s", False), ("^", True), ("o", True), ("D", False), ("s", True))
"""Matplotlib's letter, and whether it is hollow. One fewer than colours, so that the pairs repeat late."""
DASHES: tuple[tuple[float, ...], ...] = ((), (), (5, 2), (1.2, 1.2), (6, 1.5, 1.2, 1.5))


@dataclass(frozen=True)
class Pen:
    colour: palette.Colour
    marker: str
    hollow: bool
    dash: tuple[float, ...]
    """Lengths of strokes and gaps in widths of the line; empty for an unbroken one."""


def pens_of(*charts: Iterable[str]) -> dict[str, Pen]:
    """Name → pen, the same in every chart; two lines of one chart never share a colour where colours suffice."""
    named = [list(dict.fromkeys(names)) for names in charts]
    every = list(dict.fromkeys(name for names in named for name in names))
    kept = [name for name in every if name in palette.KNOWN]
    free = [colour for colour in COLOURS if colour not in [palette.KNOWN[name] for name in kept]]
    places: dict[str, int] = {}
    for name in every:
        if name not in kept:
            beside = {places.get(other) for names in named if name in names for other in names}
            taken = list(places.values())
            places[name] = min(
                (place for place in range(len(free)) if place not in beside),
                key=lambda place: (taken.count(place), place),
                default=len(places),
            )
    pens = {name: _pen(palette.KNOWN[name], place) for place, name in enumerate(kept)}
    pens |= {name: _pen(free[place % len(free)], place + len(kept)) for name, place in places.items()}
    return {name: pens[name] for name in every}


def _pen(colour: palette.Colour, place: int) -> Pen:
    marker, hollow = MARKERS[place % len(MARKERS)]
    return Pen(colour, marker, hollow, DASHES[place % len(DASHES)])


SHAPES = {
    "o": "M10 5a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0z",
    "D": "M13.4 1l4 4l-4 4l-4-4z",
    "s": "M10.2 1.8h6.4v6.4h-6.4z",
    "^": "M13.4 1.2l4 7.2h-8z",
}


def key(pen: Pen) -> Markup:
    """A piece of the line, as it is in the chart."""
    dash = f' stroke-dasharray="{" ".join(f"{2 * length:g}" for length in pen.dash)}"' if pen.dash else ""
    colour = f"var({pen.colour.variable})"
    fill = "var(--paper)" if pen.hollow else colour
    return Markup(
        f'<svg class="pen" viewBox="0 0 27 10" aria-hidden="true">'
        f'<path d="M0 5H27" fill="none" stroke="{colour}" stroke-width="2"{dash}/>'
        f'<path d="{SHAPES[pen.marker]}" fill="{fill}" stroke="{colour}" stroke-width="1.4"/></svg>'
    )
