"""One colour per method, everywhere: Okabe and Ito's set, a little darker so that it also works for text.

A colour is written as its light hex value in plain trace data and in PNGs. On the page every such value is
replaced by a CSS variable, so the same figure serves light and dark mode.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup


@dataclass(frozen=True)
class Colour:
    variable: str
    light: str
    dark: str


KNOWN = {
    "nerf": Colour("--nerf", "#0072b2", "#56a8e0"),
    "nerf_matched": Colour("--matched", "#4f7373", "#9bb8b6"),
    "qnerf": Colour("--qnerf", "#c45000", "#f58b3c"),
    "qnerf_theorem": Colour("--theorem", "#a8488c", "#dc94c6"),
    "qnerf_repaired": Colour("--repaired", "#8f6a00", "#d9b23f"),
}

OTHERS = (
    Colour("--other-1", "#007f5f", "#35b892"),
    Colour("--other-2", "#6a51a3", "#a692dd"),
    Colour("--other-3", "#7a4a2b", "#c79472"),
    Colour("--other-4", "#b2182b", "#ee7b86"),
    Colour("--other-5", "#3f7f1f", "#8cc96a"),
    Colour("--other-6", "#4d5a8a", "#9aa7dd"),
)

INK = Colour("--ink", "#1d1d1f", "#ececee")
MUTED = Colour("--muted", "#6b6b70", "#a3a3aa")
RULE = Colour("--rule", "#e3e3e6", "#38383d")
PAPER = Colour("--paper", "#fefefe", "#151517")

SURFACES = (
    Colour("--raised", "#f6f6f7", "#1e1e21"),
    Colour("--alert", "#fff4e5", "#36250f"),
    Colour("--alert-ink", "#7a3d00", "#ffc98a"),
    Colour("--link", "#0b57a4", "#84bdf2"),
    Colour("--good", "#00654c", "#4cc9a0"),
    Colour("--bad", "#a8330a", "#ff9a70"),
    Colour("--finding", "#7a3d8c", "#d3a5e0"),
    Colour("--finding-ground", "#f6eef8", "#2c2131"),
    Colour("--bad-ground", "#fdeae3", "#3a1f16"),
)

EVERY = (*KNOWN.values(), *OTHERS, INK, MUTED, RULE, PAPER)


def colours_of(methods: list[str]) -> dict[str, Colour]:
    """Map method → colour: fixed for the known names, from the fixed palette in order for all others."""
    others = [method for method in methods if method not in KNOWN]
    chosen = {method: OTHERS[place % len(OTHERS)] for place, method in enumerate(others)}
    return {method: KNOWN.get(method) or chosen[method] for method in methods}


COLOURS = (*(KNOWN[name] for name in ("nerf", "qnerf")), *OTHERS)
"""The colours of lines; the first are far apart for every kind of colour vision. Methods keep their own colours."""
MARKERS = (("o", False), ("D", True), ("s", False), ("^", True), ("o", True), ("D", False), ("s", True))
"""Matplotlib's letter, and whether it is hollow. One marker fewer than colours, so that pairs repeat late."""
DASHES: tuple[tuple[float, ...], ...] = ((), (), (5, 2), (1.2, 1.2), (6, 1.5, 1.2, 1.5))


@dataclass(frozen=True)
class Pen:
    colour: Colour
    marker: str
    hollow: bool
    dash: tuple[float, ...]
    """The lengths of strokes and gaps in line widths; empty for a solid line."""


def pens_of(*charts: Iterable[str]) -> dict[str, Pen]:
    """Map name → pen, the same in every chart; lines of one chart differ in colour while there are enough colours."""
    named = [list(dict.fromkeys(names)) for names in charts]
    every = list(dict.fromkeys(name for names in named for name in names))
    kept = [name for name in every if name in KNOWN]
    free = [colour for colour in COLOURS if colour not in [KNOWN[name] for name in kept]]
    places: dict[str, int] = {}
    for name in every:
        if name not in kept:
            neighbours = {places.get(other) for names in named if name in names for other in names}
            taken = list(places.values())
            places[name] = min(
                (place for place in range(len(free)) if place not in neighbours),
                key=lambda place: (taken.count(place), place),
                default=len(places),
            )
    pens = {name: _pen(KNOWN[name], place) for place, name in enumerate(kept)}
    pens |= {name: _pen(free[place % len(free)], place + len(kept)) for name, place in places.items()}
    return {name: pens[name] for name in every}


def _pen(colour: Colour, place: int) -> Pen:
    marker, hollow = MARKERS[place % len(MARKERS)]
    return Pen(colour, marker, hollow, DASHES[place % len(DASHES)])


SHAPES = {
    "o": "M10 5a3.4 3.4 0 1 0 6.8 0a3.4 3.4 0 1 0-6.8 0z",
    "D": "M13.4 1l4 4l-4 4l-4-4z",
    "s": "M10.2 1.8h6.4v6.4h-6.4z",
    "^": "M13.4 1.2l4 7.2h-8z",
}


def key(pen: Pen) -> Markup:
    """Return a piece of the line with its marker, as the chart shows it."""
    dash = f' stroke-dasharray="{" ".join(f"{2 * length:g}" for length in pen.dash)}"' if pen.dash else ""
    colour = f"var({pen.colour.variable})"
    fill = "var(--paper)" if pen.hollow else colour
    return Markup(
        '<svg class="pen" viewBox="0 0 27 10" aria-hidden="true">'
        f'<path d="M0 5H27" fill="none" stroke="{colour}" stroke-width="2"{dash}/>'
        f'<path d="{SHAPES[pen.marker]}" fill="{fill}" stroke="{colour}" stroke-width="1.4"/></svg>'
    )
