"""Mitsuba's own error against its time: how many samples per pixel the ground truth needs."""

import math
import statistics
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.plan.profiles import PROFILES
from harness.records.cells import read_cells
from harness.records.json_record import DamagedRecord
from harness.records.study import Series, Table, check
from harness.studies.evidence.ceilings import noise_rows
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import TRAININGS, EvidenceContext
from harness.studies.framework import Found
from harness.studies.trained_context import folder_of
from harness.training.scoring.metrics import psnr_from_mse
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
TEST_DB = PROFILES["reduced"].views.ceiling_test_db or 0.0
"""The ceiling of the test views in the profile `reduced`."""
SLOPE = -0.5
SLOPE_BAR = 0.1
"""The amount by which the error of a scene may fall more slowly than Monte Carlo must."""
FLATTEST = -0.1
"""The slope of the mean square error above which no number of samples is extrapolated."""
Line = tuple[float | None, float]
"""Slope and height of a line that is fitted to logarithms; the slope is None with fewer than two points."""


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

    @property
    def by_samples(self) -> float | None:
        """Return the slope of log RMSE on log samples, from `FITTED_FROM` samples on."""
        return self._fitted(self.spp, self.rmse)[0]

    @property
    def by_seconds(self) -> float | None:
        """Return the slope of log RMSE on log seconds, over renders that take at least twice as long as the shortest:
        below that, time is overhead.
        """
        return self._fitted(self.seconds, self.rmse, 2.0 * min(self.seconds))[0]

    def spp_for(self, mse: float) -> float | None:
        """Return the samples per pixel at which noise has that mean square error of display colour, on the line that is
        fitted to log mse over log samples; None if there is none, or if it hardly falls.
        """
        slope, height = self._fitted(self.spp, self.mse)
        return None if slope is None or slope > FLATTEST else math.exp((math.log(mse) - height) / slope)

    @property
    def psnr(self) -> list[float | None]:
        return [None if mse is None else psnr_from_mse(mse) for mse in self.mse]

    def _fitted(self, x: Sequence[float], y: Sequence[float | None], least: float = 0.0) -> Line:
        """Fit log y over log x where y is known, samples suffice, and x is at least `least`."""
        points = [
            (a, b)
            for count, a, b in zip(self.spp, x, y, strict=True)
            if b is not None and count >= FITTED_FROM and a >= least
        ]
        if len(points) < 2:
            return None, 0.0
        log_x, log_y = np.log(np.array(points)).T
        slope, height = np.polyfit(log_x, log_y, 1)
        return float(slope), float(height)


def noise_of(scene: str, rows: Sequence[dict[str, Any]]) -> Noise:
    """Read what `python -m scenes noise --scenes` printed. Raises `ValueError` if an error is not finite."""
    for row in rows:
        if not all(math.isfinite(error) for errors in row["mse"].values() for error in errors):
            raise ValueError(f"{scene} with {row['spp']} samples a pixel: an error is not finite: {row['mse']}")
    linear, display = ([statistics.fmean(row["mse"][light]) for row in rows] for light in ("linear", "display"))
    return Noise(
        scene,
        [row["spp"] for row in rows],
        [statistics.median(row["seconds"]) for row in rows],
        [math.sqrt(error) if error > 0.0 else None for error in linear],
        [error if error > 0.0 else None for error in display],
    )


def ground_truth_work(context: EvidenceContext) -> Iterator[Found]:
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
    by_samples = {noise.scene: noise.by_samples for noise in noises}
    by_spp = {scene: slope for scene, slope in by_samples.items() if slope is not None}
    by_time = {noise.scene: slope for noise in noises if (slope := noise.by_seconds) is not None}
    what, high = "slowest fall of the error with samples a pixel", SLOPE + SLOPE_BAR
    if not by_spp:
        yield f"No slope: the error does not stand clear of the reference's ({how})."
        yield check(what, None, high=high, why="no slope")
        return
    flat = [scene for scene in by_samples if scene not in by_spp]
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
    steep, flat = (pick(slopes, key=lambda name: slopes[name]) for pick in (min, max))
    return " to ".join(f"{slopes[scene]:.2f} ({scene})".replace("-", "−", 1) for scene in (steep, flat))


def scores_at_hand(context: EvidenceContext, width: int) -> dict[str, float]:
    """Map scene → PSNR of its best method, the median over seeds, of images `width` pixels wide.

    They come from the run in the output folder, else from the first training of the studies that has the scene. Nothing
    is trained for it.
    """
    best: dict[str, float] = {}
    for folder in (context.out, *(folder_of(context.out, name) for name in TRAININGS)):
        values: dict[tuple[str, str], list[float]] = defaultdict(list)
        with suppress(DamagedRecord):
            for cell in read_cells(folder):
                psnr = cell.scores.get("psnr")
                if psnr is not None and cell.settings.get("view_set", {}).get("width") == width:
                    values[cell.scene, cell.method].append(psnr)
            medians = sorted((statistics.median(scores), scene) for (scene, _), scores in values.items())
            best = {scene: score for score, scene in medians} | best
    return best


def room(noises: Sequence[Noise], scores: dict[str, float]) -> Iterator[Found]:
    """Yield the samples per pixel at which the ceiling stands so far above the available scores: the most among scenes
    that have a figure, and all of them as a table.
    """
    needed = {
        noise.scene: [noise.spp_for(10.0 ** (-(scores[noise.scene] + decibel) / 10.0)) for decibel in ROOMS_DB]
        for noise in noises
        if noise.scene in scores
    }
    if not needed:
        yield "No trained cell is at hand in this folder: how many samples scores need is not said."
        return
    lost = [scene for scene, counts in needed.items() if None in counts]
    if len(lost) < len(needed):
        near, far = (max(counts[place] or 0.0 for counts in needed.values() if None not in counts) for place in (0, 1))
        where = f" on {len(needed) - len(lost)} of {len(needed)} scenes" if lost else ""
        best = max(score for scene, score in scores.items() if scene in needed and scene not in lost)
        limited = ", so such scores are limited by the method" if best + ROOMS_DB[1] < TEST_DB else ""
        yield (
            f"For a ceiling {ROOMS_DB[0]:g} dB above the best score at hand at most {near:.2g} samples a pixel are "
            f"needed{where} and for {ROOMS_DB[1]:g} dB {far:.2g}; test views get as many as {TEST_DB:g} dB take"
            f"{limited}."
        )
    if lost:
        yield (
            f"How many samples the scores of {listed(lost)} need is not known: their error hardly falls with samples, "
            "or stands clear of the reference's at fewer than two numbers of them."
        )
    columns = ["scene", "best score here, dB", *(f"samples for a ceiling {level:g} dB above" for level in ROOMS_DB)]
    rows: list[list[str | float | None]] = [[scene, scores[scene], *counts] for scene, counts in needed.items()]
    yield Table("samples_needed", 0, "Samples a pixel that scores need (from the fitted line)", columns, rows)


def charts(noises: Sequence[Noise], floor: dict[str, float]) -> Iterator[Series]:
    spp = [float(count) for count in noises[0].spp]
    time, samples, error = "seconds a view", "samples a pixel", "RMSE, linear light"
    for noise in noises:
        yield Series("Noise against time", 0, noise.scene, time, error, noise.seconds, noise.rmse)
        yield Series("Noise against samples", 0, noise.scene, samples, error, spp, noise.rmse)
        panel, label = "Ceiling against samples", "PSNR ceiling, dB"
        yield Series(panel, 0, noise.scene, samples, label, spp, noise.psnr, log_y=False)
    seconds = [taken for noise in noises for taken in noise.seconds]
    for panel, label, x in (("Noise against time", time, seconds), ("Noise against samples", samples, spp)):
        worst = [max(floor.values())] * 2
        yield Series(panel, 0, "largest noise of a reference", label, error, [min(x), max(x)], worst)


def tabled(noises: Sequence[Noise], floor: dict[str, float]) -> Table:
    rows: list[list[str | float | None]] = [
        [noise.scene, noise.by_samples, noise.by_seconds, floor[noise.scene], *noise.seconds, *noise.psnr]
        for noise in noises
    ]
    columns = ["scene", "slope, samples", "slope, seconds", "reference RMSE"]
    columns += [f"{unit}, {count} samples" for unit in ("s", "dB") for count in noises[0].spp]
    return Table("ground_truth_work", 0, "Error and time of the ground truth", columns, rows)
