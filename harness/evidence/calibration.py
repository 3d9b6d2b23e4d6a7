"""NeRF against NeRF: how often the functions that judge Q-NeRF see a difference where there is none, and miss one."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from harness.chart_record import Series, Table
from harness.comparisons import METRICS
from harness.evidence import real_a_a, simulated_a_a
from harness.evidence.real_a_a import independent_families, overall, share_called, share_of_families
from harness.evidence.simulated_a_a import Rates, Spreads
from harness.evidence.situation import Finding, Situation
from harness.evidence_record import Check
from harness.records import CellRecord, Comparison
from harness.targets_record import TargetComparison

MOST_FALSE = 0.05
LEAST_FOUND = 0.80
BY_CHANCE = 0.01
"""How often a sound comparer may fail the check on real families of single scenes."""
SIMULATED = 2000
FAMILIES = 500
"""Simulated, of single scenes."""
ALONG_THE_CURVE = 500
"""Comparisons at each point of a power curve."""
VARYING = 0.5
"""dB: standard deviation over scenes of an effect that is not the same everywhere. The gains that the paper prints
vary by 0.2.
"""
ALIKE, UNLIKE = "the same on all scenes", f"varying by {VARYING:g} dB from scene to scene"


@dataclass(frozen=True)
class _Measured:
    real: list[Comparison]
    times: list[TargetComparison]
    spreads: Spreads
    alike: Rates
    unlike: Rates
    scenes: Rates
    families: int
    """Independent families of single scenes that the real ones are worth."""


def calibration(situation: Situation) -> Iterator[Finding]:
    """Real and simulated comparisons of NeRF with itself, without and with a planted effect."""
    few = situation.quick
    found = _measured(situation.trained("a_a").cells, *((60, 20) if few else (SIMULATED, FAMILIES)))
    yield from _sentences(found)
    yield from _checks(found)
    for name, varying in ((ALIKE, 0.0), (UNLIKE, VARYING)):
        yield _curve(name, found.spreads, varying, 20 if few else ALONG_THE_CURVE)
    yield _real_table(found)
    yield _simulated_table(found)
    yield _spread_table(found.spreads)


def _measured(cells: list[CellRecord], count: int, families: int) -> _Measured:
    spreads = simulated_a_a.measured_spreads(cells)
    places, seeds = ({one.scene for one in cells}, {one.seed for one in cells})
    return _Measured(
        real_a_a.comparisons(cells),
        real_a_a.times(cells),
        spreads,
        simulated_a_a.rates_over_scenes(spreads, count),
        simulated_a_a.rates_over_scenes(spreads, count, VARYING),
        simulated_a_a.rates_by_scene(spreads, families),
        independent_families(len(places), len(seeds)),
    )


def _sentences(found: _Measured) -> Iterator[str]:
    real, alike, unlike, scenes = overall(found.real), found.alike, found.unlike, found.scenes
    yield (
        f"NeRF against NeRF is called better or worse in {_percent(alike.false)} of {alike.count} simulated "
        f"comparisons over all scenes, and in {_percent(share_called(real))} of {len(real)} real ones. An effect of "
        f"the size that the true spread prints as the smallest detectable, {alike.planted:.2f} dB, is found in "
        f"{_percent(alike.found)}, half of it in {_percent(alike.half)}."
    )
    yield (
        f"The interval over all scenes, nominally of 95 %, holds the truth in {100 - 100 * alike.outside:.2f} % where "
        f"runs differ by their seeds alone, as its error counts what differs in one cell up to three times, and in "
        f"{_percent(1 - unlike.outside)} where an effect varies by {VARYING:g} dB from scene to scene. Of the latter "
        f"comparisons {_percent(unlike.false)} are called although the mean effect is 0, and {_percent(unlike.found)} "
        f"find the size that the true spread prints, {unlike.planted:.2f} dB."
    )
    yield (
        f"On single scenes, {_percent(scenes.family)} of the families of {len(found.spreads.scale)} hold a false call, "
        f"and {_percent(scenes.found)} of the comparisons find the size that the scene's true spread prints, "
        f"{scenes.planted:.2f} dB in the root mean square."
    )
    yield (
        "What a run prints varies by chance about that size. Of the comparisons over all scenes "
        f"{_percent(alike.own_found)} find the size that they print themselves, and {_percent(alike.next_found)} the "
        f"size that another printed; where the effect varies {_percent(unlike.own_found)} and "
        f"{_percent(unlike.next_found)}; on single scenes {_percent(scenes.own_found)} and "
        f"{_percent(scenes.next_found)}, as three seeds know their own spread badly."
    )
    yield (
        "Real comparisons put the seeds into two groups in every way and pairing. They share runs, so that they say "
        "less than their number; and the groups share neither rays nor first weights nor the load of the machine while "
        "their clocks ran, so that they differ by more than the methods of one run, at equal time above all."
    )


def _checks(found: _Measured) -> Iterator[Check]:
    real, alike, unlike, scenes = found.real, found.alike, found.unlike, found.scenes
    ways = f"{len(overall(real))} ways to split and pair the seeds"
    by_construction = "by construction; the limit leaves two standard errors of that share"
    yield Check(
        "share of simulated comparisons of NeRF with itself over all scenes that are called better or worse",
        alike.false,
        high=MOST_FALSE,
        why=f"{alike.count} drawn from the measured spreads",
    )
    yield Check(
        "share of real ones that are called better or worse at equal steps",
        share_called(overall(real)),
        high=MOST_FALSE,
        why=ways,
    )
    yield Check(
        "share of real ones that are called better or worse at equal time",
        share_called(overall(real, "seconds")),
        high=MOST_FALSE,
        why=ways,
    )
    if found.times:
        yield Check(
            "share of real ones that are called sooner or later at the target PSNR",
            share_called(found.times),
            high=MOST_FALSE,
            why=f"{ways}, by steps",
        )
    yield Check(
        "share of simulated families of single scenes that hold a false call",
        scenes.family,
        high=_with_chance(MOST_FALSE, scenes.count // len(found.spreads.scale), +1),
        why=f"5 % {by_construction}",
    )
    yield Check(
        "share of real families of single scenes that hold a false call",
        share_of_families(real),
        high=float(binom.ppf(1 - BY_CHANCE, found.families, MOST_FALSE)) / found.families,
        why=f"5 % by construction, in {ways}, which share runs and vary by chance as much as {found.families} "
        f"independent ones; a sound comparer is beyond the limit, a quantile of the binomial, in "
        f"about {100 * BY_CHANCE:g} %",
    )
    yield Check(
        f"share of simulated comparisons that are called although an effect {UNLIKE} has mean 0",
        unlike.false,
        high=_with_chance(MOST_FALSE, unlike.count, +1),
        why=f"5 % {by_construction}",
    )
    for name, rates in ((ALIKE, alike), (UNLIKE, unlike), ("on one scene", scenes)):
        yield Check(
            f"share of planted effects of the size that the true spread prints, {name}, that are found",
            rates.found,
            low=_with_chance(LEAST_FOUND, rates.count, -1),
            why=f"80 % {by_construction}; {rates.count} simulated, one size for all that are drawn alike",
        )
    lost = sum(one.unpaired for one in overall(real))
    yield Check(
        "pairs of real runs without a score", float(lost), high=0.0, why="one alone keeps a verdict from being made"
    )


def _curve(name: str, spreads: Spreads, varying: float, count: int) -> Series:
    shares = simulated_a_a.power_curve(spreads, count, varying)
    error = [2 * math.sqrt(share * (1 - share) / count) for share in shares]
    return Series(
        panel="how often a planted effect is called (at 0: false alarms)",
        item=0,
        name=name,
        x_label="planted effect (dB)",
        y_label="share of simulated comparisons",
        x=list(simulated_a_a.EFFECTS),
        y=list(shares),
        low=[max(0.0, share - one) for share, one in zip(shares, error, strict=True)],
        high=[min(1.0, share + one) for share, one in zip(shares, error, strict=True)],
        log_x=False,
        log_y=False,
    )


def _real_table(found: _Measured) -> Table:
    rows: list[list[str | float | None]] = []
    for metric in METRICS:
        for budget in ("steps", "seconds"):
            of_both = [one for one in found.real if (one.metric, one.budget) == (metric, budget)]
            for where in ("all scenes", "one scene"):
                chosen = [one for one in of_both if (one.scene == "all") == (where == "all scenes")]
                if scored := [one for one in chosen if one.difference is not None]:
                    rows.append([metric, budget, where, float(len(scored)), *_called_and_equivalent(scored)])
    if found.times:
        many = float(len(found.times))
        rows.append(["time to the target", "steps", "all scenes", many, *_called_and_equivalent(found.times)])
    columns = ["metric", "by", "where", "comparisons", "better or worse (%)", "equivalent (%)"]
    return Table("real_a_a", 0, "Real runs of NeRF against each other", columns, rows)


def _called_and_equivalent(rows: list[Comparison] | list[TargetComparison]) -> tuple[float, float]:
    return 100 * share_called(rows), 100 * float(np.mean([one.verdict == "equivalent" for one in rows]))


def _simulated_table(found: _Measured) -> Table:
    rows: list[list[str | float | None]] = []
    for name, one in (
        (f"all scenes, effect {ALIKE}", found.alike),
        (f"all scenes, effect {UNLIKE}", found.unlike),
        ("one scene, in the family of all", found.scenes),
    ):
        shares = (one.false, one.outside, one.found, one.half, one.own_found, one.next_found)
        rows.append([name, float(one.count), *(100 * share for share in shares), one.planted, one.detectable])
    columns = ["simulated", "comparisons", "false (%)", "beyond the 95 % interval (%)"]
    columns += ["size of the true spread found (%)", "half of it found (%)", "own printed size found (%)"]
    columns += ["another's printed size found (%)", "size of the true spread (dB)", "printed size (dB, median)"]
    return Table("simulated_a_a", 0, "Simulated comparisons of NeRF with itself", columns, rows)


def _spread_table(spreads: Spreads) -> Table:
    rows: list[list[str | float | None]] = [[scene, scale] for scene, scale in spreads.scale.items()]
    return Table("a_a_spread", 0, "Spread of NeRF's runs over seeds", ["scene", "standard deviation (dB)"], rows)


def _with_chance(share: float, count: int, sign: int) -> float:
    """`share`, and two standard errors of it among `count` to the one or the other side."""
    return share + sign * 2 * math.sqrt(share * (1 - share) / count)


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
