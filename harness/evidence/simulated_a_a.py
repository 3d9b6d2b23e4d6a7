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
    outside: float
    """Whose interval, nominally of 95 %, does not hold the 0 that is true."""
    found: float
    """Called better with an effect of the size that the true spread prints, the same for all that are drawn alike."""
    half: float
    """Called better with half of it."""
    own_found: float
    """Called better with the effect that each prints itself as the smallest detectable: too easy a test where it prints
    a large one as its spread came out large."""
    next_found: float
    """Called better with the effect that the comparison before it of those drawn alike printed: what one run prints,
    found by another."""
    planted: float
    """dB: the size of what is found in `found`; root mean square where those drawn differently have several."""
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
    return _rates([[drawn(spreads, generator, varying) for _ in range(count)]], 1)


def rates_by_scene(spreads: Spreads, count: int) -> Rates:
    """Each scene a comparison of its own, in the family of all scenes; `count` families."""
    generator = np.random.default_rng(20260109)
    family = family_of(PRIMARY, "one of them", len(spreads.scale))
    tables = [drawn(spreads, generator) for _ in range(count)]
    called = [any(_called({scene: row}, family) for scene, row in table.items()) for table in tables]
    rates = _rates([[{scene: table[scene]} for table in tables] for scene in spreads.scale], family)
    return replace(rates, family=_share(called))


@dataclass(frozen=True)
class _Trial:
    """One simulated comparison."""

    table: Differences
    printed: float
    before: float
    """What the one before it printed."""
    true: float
    """What the true spread prints."""


def _rates(alike: list[list[Differences]], family: int) -> Rates:
    """Of comparisons in groups that are drawn alike, from the same true spread."""
    trials = [trial for tables in alike for trial in _trials(tables, family)]
    return Rates(
        count=len(trials),
        false=_share(_called(one.table, family) for one in trials),
        outside=_share(_outside(one.table) for one in trials),
        found=_share(_better(one.table, one.true, family) for one in trials),
        half=_share(_better(one.table, one.true / 2, family) for one in trials),
        own_found=_share(_better(one.table, one.printed, family) for one in trials),
        next_found=_share(_better(one.table, one.before, family) for one in trials),
        planted=_root_mean_square([one.true for one in trials]),
        detectable=float(np.median([one.printed for one in trials])),
    )


def _trials(tables: list[Differences], family: int) -> list[_Trial]:
    """What the true spread prints is the root mean square of what they print: the mean of squared errors is true."""
    printed = [_printed(table, family) for table in tables]
    before, true = [printed[-1], *printed[:-1]], _root_mean_square(printed)
    return [_Trial(table, own, other, true) for table, own, other in zip(tables, printed, before, strict=True)]


def _printed(table: Differences, family: int) -> float:
    size = judged(table, PRIMARY, family).smallest_detectable
    return math.inf if size is None else size


def _root_mean_square(sizes: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(sizes))))


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


def _outside(table: Differences) -> bool:
    interval = judged(table, PRIMARY, 1).interval
    return interval is not None and not interval[0] <= 0.0 <= interval[1]


def _called(table: Differences, family: int) -> bool:
    return judged(table, PRIMARY, family).verdict in ("better", "worse")


def _better(table: Differences, effect: float, family: int) -> bool:
    return judged({scene: row + effect for scene, row in table.items()}, PRIMARY, family).verdict == "better"
