"""Comparisons of a method with itself, drawn from the spreads of its real runs, without and with a planted effect."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from harness.comparisons import PRIMARY, family_of, judged
from harness.records import CellRecord

SEEDS = 3
"""Of the default run, whose comparisons are simulated."""
EFFECTS = (0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0)
"""dB."""

Differences = dict[str, np.ndarray]
"""Scene → differences [seeds]."""


@dataclass(frozen=True)
class Spreads:
    """What the runs of one method differ by from seed to seed."""

    scale: dict[str, float]
    """Scene → standard deviation in dB."""
    shape: np.ndarray
    """Residuals of all runs [runs] in units of their scene's: mean 0, variance 1."""


@dataclass(frozen=True)
class Rates:
    """Shares of simulated comparisons."""

    count: int
    false: float
    """Called better or worse without an effect."""
    found: float
    """Called better with the effect that each prints as the smallest detectable."""
    next_found: float
    """Called better with the effect that the comparison before it printed: what one run prints, found by another."""
    half: float
    """Called better with half of what it prints itself."""
    detectable: float
    """dB: the median of what they print."""
    family: float = 0.0
    """Of families in which at least one comparison was called without an effect."""


def measured_spreads(cells: list[CellRecord]) -> Spreads:
    """From the final PSNR of every run that has one. Raises `ValueError` where no scene shows any spread."""
    scale, shape = {}, []
    for scene in sorted({cell.scene for cell in cells}):
        scores = [cell.scores.get(PRIMARY) for cell in cells if cell.scene == scene and cell.status == "done"]
        values = np.array([one for one in scores if one is not None], dtype=np.float64)
        deviation = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        if deviation > 0:
            scale[scene] = deviation
            # the mean was taken from the same values, which lie closer to it than to the truth
            shape.append((values - values.mean()) * math.sqrt(len(values) / (len(values) - 1)) / deviation)
    if not shape:
        raise ValueError("no scene has two runs with different scores")
    pooled = np.concatenate(shape)
    return Spreads(scale, pooled / pooled.std())


def drawn(spreads: Spreads, generator: np.random.Generator, varying: float = 0.0) -> Differences:
    """Two runs of one method on every scene, in `SEEDS` seeds each.

    With `varying` (dB) one of them has an effect that is another on each scene, with mean 0.
    """
    return {
        scene: scale * np.subtract(*generator.choice(spreads.shape, (2, SEEDS))) + varying * generator.normal()
        for scene, scale in spreads.scale.items()
    }


def rates_over_scenes(spreads: Spreads, count: int, varying: float = 0.0) -> Rates:
    """All scenes together, alone in their family."""
    generator = np.random.default_rng(20260108)
    return _rates([drawn(spreads, generator, varying) for _ in range(count)], 1)


def rates_by_scene(spreads: Spreads, count: int) -> Rates:
    """Each scene a comparison of its own, in the family of all scenes; `count` families."""
    generator = np.random.default_rng(20260109)
    family = family_of(PRIMARY, "one of them", len(spreads.scale))
    tables = [drawn(spreads, generator) for _ in range(count)]
    called = [any(_called({scene: row}, family) for scene, row in table.items()) for table in tables]
    rates = _rates([{scene: row} for table in tables for scene, row in table.items()], family)
    return replace(rates, family=_share(called))


def _rates(tables: list[Differences], family: int) -> Rates:
    printed = [judged(table, PRIMARY, family).smallest_detectable or math.inf for table in tables]
    before = [printed[-1], *printed[:-1]]
    sizes = list(zip(tables, printed, before, strict=True))
    return Rates(
        count=len(tables),
        false=_share(_called(table, family) for table in tables),
        found=_share(_better(table, size, family) for table, size, _ in sizes),
        next_found=_share(_better(table, size, family) for table, _, size in sizes),
        half=_share(_better(table, size / 2, family) for table, size, _ in sizes),
        detectable=float(np.median(printed)),
    )


def power_curve(spreads: Spreads, count: int, varying: float = 0.0) -> list[float]:
    """Share of comparisons over all scenes that call an effect of each of `EFFECTS` better; of no effect, better or
    worse.
    """
    generator = np.random.default_rng(20260110)
    tables = [drawn(spreads, generator, varying) for _ in range(count)]
    return [
        _share(_better(table, effect, 1) if effect else _called(table, 1) for table in tables) for effect in EFFECTS
    ]


def _share(called: Iterable[bool]) -> float:
    return float(np.mean(list(called)))


def _called(table: Differences, family: int) -> bool:
    return judged(table, PRIMARY, family).verdict in ("better", "worse")


def _better(table: Differences, effect: float, family: int) -> bool:
    return judged({scene: row + effect for scene, row in table.items()}, PRIMARY, family).verdict == "better"
