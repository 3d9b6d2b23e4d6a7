"""Mitsuba's own error against its time: how many samples per pixel the ground truth needs."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.plan.profiles import PROFILES
from harness.records.study import Series, Table, check
from harness.studies.evidence.ceilings import noise_rows, scores_at_hand
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found
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
TEST_SPP = PROFILES["reduced"].views.spp_test
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
        return _fitted(self.spp, self._clear(self.rmse))[0]

    def slope_of_seconds(self) -> float | None:
        """Return the slope of log RMSE on log seconds, over renders that take at least twice as long as the shortest:
        below that, time is overhead. None with fewer than two points.
        """
        pairs = zip(self.seconds, self._clear(self.rmse), strict=True)
        return _fitted(self.seconds, [one if taken >= 2.0 * min(self.seconds) else None for taken, one in pairs])[0]

    def spp_for(self, mse: float) -> float | None:
        """Return the samples per pixel at which noise has that mean square error of display colour, on the line that is
        fitted to log mse over log samples; None with fewer than two points, or if they hardly fall.
        """
        slope, height = _fitted(self.spp, self._clear(self.mse))
        return None if slope is None or slope > FLATTEST else math.exp((math.log(mse) - height) / slope)

    @property
    def psnr(self) -> list[float | None]:
        """Return the ceiling at each number of samples, dB."""
        return [None if mse is None else psnr_from_mse(mse) for mse in self.mse]

    def _clear(self, errors: list[float | None]) -> list[float | None]:
        """Return the errors, None where there are too few samples for the fit."""
        return [error if count >= FITTED_FROM else None for count, error in zip(self.spp, errors, strict=True)]


def _fitted(x: Sequence[float], y: Sequence[float | None]) -> tuple[float | None, float]:
    """Return the slope and height of log y over log x where y is known; None and 0 with fewer than two points."""
    points = [(a, b) for a, b in zip(x, y, strict=True) if b is not None]
    if len(points) < 2:
        return None, 0.0
    log_x, log_y = np.log(np.array(points)).T
    slope, height = np.polyfit(log_x, log_y, 1)
    return float(slope), float(height)


def noise_of(scene: str, rows: Sequence[dict[str, Any]]) -> Noise:
    """Read what `python -m scenes noise --scenes` printed. Raises `ValueError` if an error is not finite."""
    for row in rows:
        if not all(math.isfinite(one) for errors in row["mse"].values() for one in errors):
            raise ValueError(f"{scene} with {row['spp']} samples a pixel: an error is not finite: {row['mse']}")
    linear, display = ([statistics.fmean(row["mse"][light]) for row in rows] for light in ("linear", "display"))
    return Noise(
        scene,
        [row["spp"] for row in rows],
        [statistics.median(row["seconds"]) for row in rows],
        [math.sqrt(one) if one > 0.0 else None for one in linear],
        [one if one > 0.0 else None for one in display],
    )


def ground_truth_work(context: EvidenceContext) -> Iterator[Found]:
    """Yield sentences, a check of the slopes, lines of every scene and two tables."""
    scenes = list(CLASSICS)[: 2 if context.quick else None]
    spp, reference, resolution = ((4, 16, 32), 256, 16) if context.quick else (SPP, REFERENCE_SPP, RESOLUTION)
    options = ["--resolution", resolution, "--reference-spp", reference, "--repeats", REPEATS, "--spp", *spp]
    rows = noise_rows("scenes", scenes, list(map(str, options)), context.show.line)
    noises = [noise_of(name, rows[name]) for name in scenes]
    sample = rows[scenes[0]][0]
    yield from sentences(
        noises, f"one test view of {resolution} px, {REPEATS + 1} renders each, by {sample['variant']}"
    )
    floor = {name: math.sqrt(rows[name][0]["reference_mse"]["linear"]) for name in scenes}
    worst = max(floor, key=lambda name: floor[name])
    yield (
        f"The reference has {sample['reference_spp']} samples; its own RMSE, {floor[worst]:.1e} on {worst} at most, is "
        "taken off in squares."
    )
    yield from room(noises, scores_at_hand(context, RESOLUTION))
    yield from charts(noises, floor)
    yield tabled(noises, floor)


def sentences(noises: Sequence[Noise], how: str) -> Iterator[Found]:
    """Yield how fast noise falls with samples, and with time."""
    by_spp = {one.scene: slope for one in noises if (slope := one.slope_of_samples()) is not None}
    by_time = {one.scene: slope for one in noises if (slope := one.slope_of_seconds()) is not None}
    what, high = "slowest fall of the error with samples a pixel", SLOPE + SLOPE_BAR
    if not by_spp:
        yield f"No slope: the error does not stand clear of the reference's ({how})."
        yield check(what, None, high=high, why="no slope")
        return
    flat = [one.scene for one in noises if one.scene not in by_spp]
    none = f"; no slope of {listed(flat)}" if flat else ""
    steeper = sum(slope < SLOPE - SLOPE_BAR for slope in by_spp.values())
    yield (
        f"The error falls as samples to the {_span(by_spp)}; independent samples would give −0.5, and the strata of "
        f"the sampler make {steeper} of {len(by_spp)} scenes clearly steeper ({how}){none}."
    )
    if by_time:
        yield (
            f"With time it falls to the {_span(by_time)}, once a render takes twice as long as the shortest; below "
            "that, time is overhead and more samples cost next to nothing."
        )
    slow = max(by_spp, key=lambda name: by_spp[name])
    why = f"fitted slope of log RMSE, {FITTED_FROM} samples and more, {slow}{none}"
    yield check(what, by_spp[slow], high=high, why=why)


def _span(slopes: dict[str, float]) -> str:
    """Return the steepest and the flattest slope, each with its scene."""
    steep, flat = (pick(slopes, key=lambda name: slopes[name]) for pick in (min, max))
    return " to ".join(f"{slopes[scene]:.2f} ({scene})".replace("-", "−", 1) for scene in (steep, flat))


def room(noises: Sequence[Noise], scores: dict[str, float]) -> Iterator[Found]:
    """Yield the samples per pixel at which the ceiling stands so far above the available scores: the most among scenes
    that have a figure, and all of them as a table.
    """
    rows: list[list[str | float | None]] = []
    known: list[list[float]] = []
    lost: list[str] = []
    for one in noises:
        if one.scene in scores:
            score = scores[one.scene]
            needed = [one.spp_for(10.0 ** (-(score + decibel) / 10.0)) for decibel in ROOMS_DB]
            rows.append([one.scene, score, *needed])
            if None in needed:
                lost.append(one.scene)
            else:
                known.append([count or 0.0 for count in needed])
    if not rows:
        yield "No trained cell is at hand in this folder: how many samples scores need is not said."
        return
    if known:
        near, far = (max(column) for column in zip(*known, strict=True))
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
    columns = ["scene", "best score here, dB", *(f"samples for a ceiling {one:g} dB above" for one in ROOMS_DB)]
    yield Table("samples_needed", 0, "Samples a pixel that scores need (from the fitted line)", columns, rows)


def charts(noises: Sequence[Noise], floor: dict[str, float]) -> Iterator[Series]:
    """Yield RMSE against seconds and against samples, and PSNR against samples."""
    time, samples = ("Noise against time", "seconds a view"), ("Noise against samples", "samples a pixel")
    for one in noises:
        spp = [float(count) for count in one.spp]
        for (panel, label), x in ((time, one.seconds), (samples, spp)):
            yield Series(panel, 0, one.scene, label, "RMSE, linear light", x, one.rmse)
        yield Series(
            "Ceiling against samples", 0, one.scene, samples[1], "PSNR ceiling, dB", spp, one.psnr, log_y=False
        )
    for (panel, label), x in (
        (time, [taken for one in noises for taken in one.seconds]),
        (samples, [float(count) for count in noises[0].spp]),
    ):
        worst = [max(floor.values())] * 2
        yield Series(panel, 0, "largest noise of a reference", label, "RMSE, linear light", [min(x), max(x)], worst)


def tabled(noises: Sequence[Noise], floor: dict[str, float]) -> Table:
    """Return slopes, times and errors of every scene."""
    rows: list[list[str | float | None]] = [
        [one.scene, one.slope_of_samples(), one.slope_of_seconds(), floor[one.scene], *one.seconds, *one.psnr]
        for one in noises
    ]
    columns = ["scene", "slope, samples", "slope, seconds", "reference RMSE"]
    columns += [f"{unit}, {count} samples" for unit in ("s", "dB") for count in noises[0].spp]
    return Table("ground_truth_work", 0, "Error and time of the ground truth", columns, rows)
