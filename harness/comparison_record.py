"""A difference of two methods as a record holds it, with what is known of it in two senses.

This module imports the standard library alone, as reports read it.
"""

from dataclasses import dataclass, fields
from typing import Any, Literal


@dataclass(frozen=True)
class Estimate:
    """What is known of a difference in one of two senses: `on_these_scenes`, or on scenes like these."""

    interval: tuple[float, float] | None
    """95 %, two-sided, of this comparison alone; None where too few values say nothing of their own spread."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict is taken from: of the `family`'s, all hold the truth together in 95 %."""
    family: int
    """As many comparisons are looked at together (`harness.comparisons.family_of`)."""
    verdict: Literal["better", "worse", "equivalent", "inconclusive"]
    smallest_detectable: float | None
    """The smallest true difference that is called better or worse in 80 % of runs with just this spread."""
    effect: float | None
    """Standardised: the difference in standard deviations of the paired differences within a scene, or of the scenes'
    means."""


@dataclass(frozen=True)
class Comparison:
    """A paired difference `method` − `against` with its interval.

    Over all scenes it is estimated in both senses. What stands beside the difference itself is that of scenes like
    these where several were tried, and of these scenes where it is a single one.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    metric: str
    budget: Literal["steps", "seconds"]
    difference: float | None
    interval: tuple[float, float] | None
    """As all that has the name of a part of `Estimate`: from the one of the two that speaks for the row."""
    verdict: Literal["better", "worse", "equivalent", "inconclusive"]
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    """Pairs that cannot be judged because one of the two diverged, collapsed, failed or is missing."""
    simultaneous: tuple[float, float] | None = None
    family: int = 1
    on_these_scenes: Estimate | None = None
    """Error from seeds alone; None without any pair."""
    scenes_like_these: Estimate | None = None
    """Scenes are drawn, too: Student's t over their means. None for a single scene."""


def comparison_of(row: dict[str, Any]) -> Comparison:
    known = {one.name for one in fields(Comparison)}
    if wrong := sorted(known ^ set(row)):
        raise ValueError(f"a comparison of another version of this program (unexpected or missing {', '.join(wrong)})")
    estimates = {name: estimate_of(row[name]) for name in ("on_these_scenes", "scenes_like_these")}
    return Comparison(**{**with_pairs(row), **estimates})


def estimate_of(row: dict[str, Any] | None) -> Estimate | None:
    """An estimate as JSON holds it; raises `TypeError` or `KeyError` where it is none."""
    return None if row is None else Estimate(**with_pairs(row))


def with_pairs(row: dict[str, Any]) -> dict[str, Any]:
    """Intervals as pairs, which JSON holds as lists."""
    return {**row, **{name: _pair(row[name]) for name in ("interval", "simultaneous")}}


def _pair(value: list[float] | None) -> tuple[float, float] | None:
    return None if value is None else (value[0], value[1])
