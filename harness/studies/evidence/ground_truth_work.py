"""Mitsuba's own error against its time: how many samples per pixel the ground truth needs."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.records.study import Series, Table, check
from harness.studies.evidence.ceilings import noise_rows, scores_at_hand
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import EvidenceContext, Finding
from harness.training.metrics import psnr_from_mse
from scenes.catalog.entries import CLASSICS

RESOLUTION = 100
SPP = (1, 4, 16, 64, 256)
REFERENCE_SPP = 2048
REPEATS = 2
FITTED_FROM = 4
"""The fewest samples per pixel of the fit: with one, colours brighter than white are clipped one by one, and the error
is not noise alone.
"""
ROOMS_DB = (1.0, 3.0)
TEST_SPP = 64
"""The samples per pixel of the test views in the profile `reduced`."""
SLOPE = -0.5
SLOPE_BAR = 0.1
"""The amount by which the error of a scene may fall more slowly than Monte Carlo must."""


FLATTEST = -0.1
"""The slope of the mean square error above which no number of samples is extrapolated."""


@dataclass(frozen=True)
class Noise:
    """A scene's renders at growing numbers of samples per pixel."""

    scene: str
    spp: list[int]
    seconds: list[float]
    """Medians, without compilation."""
    rmse: list[float | None]
    """The error in linear light over white; None if the reference is no better than the render."""
    mse: list[float | None]
    """The mean square error of display colour over white."""

    def slope_of_samples(self) -> float | None:
        """Return the slope of log RMSE on log samples, from `FITTED_FROM` samples on; None with fewer than two
        points.
        """
        return _slope([(count, error) for count, _, error in self._fit()])

    def slope_of_seconds(self) -> float | None:
        """Return the slope of log RMSE on log seconds, over renders that take at least twice as long as the shortest:
        below that, time is overhead. None with fewer than two points.
        """
        least = 2.0 * min(self.seconds)
        return _slope([(seconds, error) for _, seconds, error in self._fit() if seconds >= least])

    def _fit(self) -> list[tuple[int, float, float]]:
        rows = zip(self.spp, self.seconds, self.rmse, strict=True)
        return [(count, seconds, one) for count, seconds, one in rows if one is not None and count >= FITTED_FROM]

    def spp_for(self, mse: float) -> float | None:
        """Return the samples per pixel at which noise has that mean square error of display colour, on the line that is
        fitted to log mse over log samples; None with fewer than two points, or if they hardly fall.
        """
        known = [(count, one) for count, one in zip(self.spp, self.mse, strict=True) if one is not None]
        line = _fitted([(count, one) for count, one in known if count >= FITTED_FROM])
        if line is None or line[0] > FLATTEST:
            return None
        return math.exp((math.log(mse) - line[1]) / line[0])


def _slope(points: Sequence[tuple[float, float]]) -> float | None:
    line = _fitted(points)
    return None if line is None else line[0]


def _fitted(points: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Return the slope and height of log y over log x."""
    if len(points) < 2:
        return None
    x, y = np.log(np.array(points)).T
    slope, height = np.polyfit(x, y, 1)
    return float(slope), float(height)


def noise_of(scene: str, rows: Sequence[dict[str, Any]]) -> Noise:
    """Read what `python -m scenes noise --scenes` printed. Raises `ValueError` if an error is not finite."""
    for row in rows:
        if not all(math.isfinite(one) for errors in row["mse"].values() for one in errors):
            raise ValueError(f"{scene} with {row['spp']} samples a pixel: an error is not finite: {row['mse']}")
    linear = [statistics.fmean(row["mse"]["linear"]) for row in rows]
    display = [statistics.fmean(row["mse"]["display"]) for row in rows]
    return Noise(
        scene,
        [row["spp"] for row in rows],
        [statistics.median(row["seconds"]) for row in rows],
        [math.sqrt(one) if one > 0.0 else None for one in linear],
        [one if one > 0.0 else None for one in display],
    )


def ground_truth_work(situation: EvidenceContext) -> Iterator[Finding]:
    """Yield sentences, a check of the slopes, lines of every scene and two tables."""
    scenes = list(CLASSICS)[: 2 if situation.quick else None]
    spp, reference = ((4, 16, 32), 256) if situation.quick else (SPP, REFERENCE_SPP)
    resolution = 16 if situation.quick else RESOLUTION
    options = ["--resolution", resolution, "--reference-spp", reference, "--repeats", REPEATS, "--spp", *spp]
    rows = noise_rows("scenes", scenes, list(map(str, options)), situation.show.line)
    found = [noise_of(name, rows[name]) for name in scenes]
    sample = rows[scenes[0]][0]
    how = f"one test view of {resolution} px, {REPEATS + 1} renders each, by {sample['variant']}"
    yield from sentences(found, how)
    floor = {name: math.sqrt(rows[name][0]["reference_mse"]["linear"]) for name in scenes}
    worst = max(floor, key=lambda name: floor[name])
    yield (
        f"The reference has {sample['reference_spp']} samples; its own RMSE, {floor[worst]:.1e} on {worst} at most, is "
        "taken off in squares."
    )
    yield from room(found, scores_at_hand(situation.out, RESOLUTION))
    yield from charts(found, floor)
    yield tabled(found, floor)


def sentences(found: Sequence[Noise], how: str) -> Iterator[Finding]:
    """Yield how fast noise falls with samples, and with time."""
    by_spp = {one.scene: slope for one in found if (slope := one.slope_of_samples()) is not None}
    by_time = {one.scene: slope for one in found if (slope := one.slope_of_seconds()) is not None}
    if not by_spp:
        yield f"No slope: the error does not stand clear of the reference's ({how})."
        yield check("slowest fall of the error with samples a pixel", None, high=SLOPE + SLOPE_BAR, why="no slope")
        return
    slow = max(by_spp, key=lambda name: by_spp[name])
    fast = min(by_spp, key=lambda name: by_spp[name])
    flat = [one.scene for one in found if one.scene not in by_spp]
    none = f"; no slope of {listed(flat)}" if flat else ""
    steeper = sum(slope < SLOPE - SLOPE_BAR for slope in by_spp.values())
    yield (
        f"The error falls as samples to the {_minus(by_spp[fast])} ({fast}) to {_minus(by_spp[slow])} ({slow}); "
        f"independent samples would give −0.5, and the strata of the sampler make {steeper} of {len(by_spp)} scenes "
        f"clearly steeper ({how}){none}."
    )
    if by_time:
        slow_time, fast_time = (pick(by_time, key=lambda name: by_time[name]) for pick in (max, min))
        yield (
            f"With time it falls to the {_minus(by_time[fast_time])} ({fast_time}) to {_minus(by_time[slow_time])} "
            f"({slow_time}), once a render takes twice as long as the shortest; below that, time is overhead and more "
            "samples cost next to nothing."
        )
    yield check(
        "slowest fall of the error with samples a pixel",
        by_spp[slow],
        high=SLOPE + SLOPE_BAR,
        why=f"fitted slope of log RMSE, {FITTED_FROM} samples and more, {slow}{none}",
    )


def room(found: Sequence[Noise], scores: dict[str, float]) -> Iterator[Finding]:
    """Yield the samples per pixel at which the ceiling stands so far above the available scores."""
    known = [one for one in found if one.scene in scores]
    if not known:
        yield "No trained cell is at hand in this folder: how many samples scores need is not said."
        return
    rows: list[list[str | float | None]] = []
    for one in known:
        score = scores[one.scene]
        needed = [one.spp_for(10.0 ** (-(score + decibel) / 10.0)) for decibel in ROOMS_DB]
        rows.append([one.scene, score, *needed])
    yield from _needed(rows)
    columns = ["scene", "best score here, dB", *(f"samples for a ceiling {one:g} dB above" for one in ROOMS_DB)]
    yield Table("samples_needed", 0, "Samples a pixel that scores need (from the fitted line)", columns, rows)


def _needed(rows: list[list[str | float | None]]) -> Iterator[str]:
    """Yield scene, score and samples for each of `ROOMS_DB`: the most, among scenes that have a figure for all of
    them.
    """
    known = {str(scene): list(needed) for scene, _, *needed in rows if None not in needed}
    lost = [str(row[0]) for row in rows if row[0] not in known]
    if known:
        near, far = (max(float(one[place] or 0.0) for one in known.values()) for place in range(len(ROOMS_DB)))
        where = f"on {len(known)} of {len(rows)} scenes " if lost else ""
        yield (
            f"For a ceiling {ROOMS_DB[0]:g} dB above the best score at hand at most {near:.2g} samples a pixel are "
            f"needed {where}and for {ROOMS_DB[1]:g} dB {far:.2g}; test views have {TEST_SPP}, so such scores are "
            "limited by the method."
            if far < TEST_SPP
            else f"For a ceiling {ROOMS_DB[1]:g} dB above the best score at hand up to {far:.2g} samples a pixel are "
            f"needed {where}where test views have {TEST_SPP}."
        )
    if lost:
        yield (
            f"How many samples the scores of {listed(lost)} need is not known: their error hardly falls with samples, "
            "or stands clear of the reference's at fewer than two numbers of them."
        )


def charts(found: Sequence[Noise], floor: dict[str, float]) -> Iterator[Series]:
    """Yield RMSE against seconds and against samples, and PSNR against samples."""
    for one in found:
        clear = [error if error is not None else math.nan for error in one.rmse]
        psnr = [math.nan if mse is None else psnr_from_mse(mse) for mse in one.mse]
        spp = [float(count) for count in one.spp]
        yield Series("Noise against time", 0, one.scene, "seconds a view", "RMSE, linear light", one.seconds, clear)
        yield Series("Noise against samples", 0, one.scene, "samples a pixel", "RMSE, linear light", spp, clear)
        yield Series(
            "Ceiling against samples", 0, one.scene, "samples a pixel", "PSNR ceiling, dB", spp, psnr, log_y=False
        )
    worst = max(floor.values())
    ends = [float(min(found[0].spp)), float(max(found[0].spp))]
    times = [min(min(one.seconds) for one in found), max(max(one.seconds) for one in found)]
    for panel, label, x in (
        ("Noise against time", "seconds a view", times),
        ("Noise against samples", "samples a pixel", ends),
    ):
        yield Series(panel, 0, "largest noise of a reference", label, "RMSE, linear light", x, [worst, worst])


def tabled(found: Sequence[Noise], floor: dict[str, float]) -> Table:
    """Return slopes, times and errors of every scene."""
    rows: list[list[str | float | None]] = []
    for one in found:
        psnr = [None if mse is None else psnr_from_mse(mse) for mse in one.mse]
        rows.append([one.scene, one.slope_of_samples(), one.slope_of_seconds(), floor[one.scene], *one.seconds, *psnr])
    counts = found[0].spp
    columns = ["scene", "slope, samples", "slope, seconds", "reference RMSE"]
    columns += [f"{unit}, {count} samples" for unit in ("s", "dB") for count in counts]
    return Table("ground_truth_work", 0, "Error and time of the ground truth", columns, rows)


def _minus(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")
