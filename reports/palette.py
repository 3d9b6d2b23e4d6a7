"""One colour per method, everywhere: Okabe and Ito's set, a little darker so that text can bear it.

A colour is written as its light hex value in plain trace data and in PNGs. On the page every such value is
replaced by a CSS variable, so the same figure serves light and dark mode.
"""

from dataclasses import dataclass


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
    Colour("--memory-0", "#004f7c", "#8cc8f0"),
    Colour("--memory-1", "#4f97c9", "#3a7fb0"),
    Colour("--disk", "#d9a441", "#b07d1e"),
    Colour("--rendered", "#c4c4c9", "#55555c"),
    Colour("--finding", "#7a3d8c", "#d3a5e0"),
    Colour("--finding-ground", "#f6eef8", "#2c2131"),
    Colour("--bad-ground", "#fdeae3", "#3a1f16"),
)
"""Colours of the page itself, in no drawing."""

EVERY = (*KNOWN.values(), *OTHERS, INK, MUTED, RULE, PAPER)


def colours_of(methods: list[str]) -> dict[str, Colour]:
    """Method → colour: fixed for the known names, from the fixed palette in order for all others."""
    others = [method for method in methods if method not in KNOWN]
    chosen = {method: OTHERS[place % len(OTHERS)] for place, method in enumerate(others)}
    return {method: KNOWN.get(method) or chosen[method] for method in methods}
