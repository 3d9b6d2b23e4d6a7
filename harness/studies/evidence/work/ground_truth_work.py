"""Mitsuba's own error against its time: how many samples per pixel the ground truth needs."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from harness.records.study import Series, Table, check
from harness.studies.evidence.ceilings import noise_rows
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found, Rows
from harness.studies.power_laws import fitted_power
from harness.training.scoring.metrics import psnr_from_mse
from scenes.catalog.entries import CLASSICS

RESOLUTION = 100
SPP = (1, 4, 16, 64, 256)
REFERENCE_SPP = 2048
REPEATS = 2
FITTED_FROM = 4
"""The minimum number of samples per pixel in the fit: with a single sample, colours brighter than white are clipped
sample by sample, and the error is not only noise.
"""
SLOPE = -0.5
SLOPE_BAR = 0.1
"""How much more slowly than independent samples the error of a scene may fall."""


@dataclass(frozen=True)
class Noise:
    """A scene's renders at growing numbers of samples per pixel."""

    scene: str
    spp: list[int]
    seconds: list[float]
    """Medians, without compilation."""
    rmse: list[float | None]
    """The error in linear light over white; None if the reference is not better than the render."""
    psnr: list[float | None]
    """The ceiling in dB that this noise sets for display colour over white."""

    @property
    def by_samples(self) -> float | None:
        """Return the slope of log RMSE on log samples, from `FITTED_FROM` samples on."""
        return self._slope(self.spp)

    @property
    def by_seconds(self) -> float | None:
        """Return the slope of log RMSE on log seconds, over renders that take at least twice as long as the shortest;
        below that, most of the time is overhead.
        """
        return self._slope(self.seconds, 2.0 * min(self.seconds))

    def _slope(self, x: Sequence[float], least: float = 0.0) -> float | None:
        """Return the slope over x where the error is known, samples suffice, and x is at least `least`."""
        points = [
            (a, error)
            for count, a, error in zip(self.spp, x, self.rmse, strict=True)
            if error is not None and count >= FITTED_FROM and a >= least
        ]
        return fitted_power(*zip(*points, strict=True))[0] if len(points) > 1 else None


def noise_of(scene: str, rows: Sequence[dict[str, Any]]) -> Noise:
    """Read what `python -m scenes noise --scenes` printed. Raises `ValueError` if an error is not finite."""
    for row in rows:
        if not all(math.isfinite(error) for errors in row["mse"].values() for error in errors):
            raise ValueError(f"{scene} with {row['spp']} samples per pixel: an error is not finite: {row['mse']}")
    linear, display = ([statistics.fmean(row["mse"][light]) for row in rows] for light in ("linear", "display"))
    return Noise(
        scene,
        [row["spp"] for row in rows],
        [statistics.median(row["seconds"]) for row in rows],
        [math.sqrt(error) if error > 0.0 else None for error in linear],
        [psnr_from_mse(error) if error > 0.0 else None for error in display],
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
        f"The reference has {sample['reference_spp']} samples; its own mean square error, RMSE {floor[worst]:.1e} at "
        f"most ({worst}), is subtracted."
    )
    yield from charts(noises, floor)
    yield table_of(noises, floor)


def sentences(noises: Sequence[Noise], how: str) -> Iterator[Found]:
    by_samples = {noise.scene: noise.by_samples for noise in noises}
    by_spp = {scene: slope for scene, slope in by_samples.items() if slope is not None}
    by_time = {noise.scene: slope for noise in noises if (slope := noise.by_seconds) is not None}
    what, high = "slowest fall of the error with samples per pixel", SLOPE + SLOPE_BAR
    if not by_spp:
        yield f"No slope: the error is not clearly above the reference's ({how})."
        yield check(what, None, high=high, why="no slope")
        return
    flat = [scene for scene in by_samples if scene not in by_spp]
    none = f"; no slope for {listed(flat)}" if flat else ""
    steeper = sum(slope < SLOPE - SLOPE_BAR for slope in by_spp.values())
    yield (
        f"The error falls as samples to the power {_span(by_spp)}; independent samples would give −0.5, and the "
        f"sampler's strata make {steeper} of {len(by_spp)} scenes clearly steeper ({how}){none}."
    )
    if by_time:
        yield (
            f"It falls as time to the power {_span(by_time)}, once a render takes twice as long as the shortest; below "
            "that, most of the time is overhead, and more samples cost almost nothing."
        )
    slow = max(by_spp, key=lambda name: by_spp[name])
    why = f"fitted slope of log RMSE, {FITTED_FROM} samples and more, {slow}{none}"
    yield check(what, by_spp[slow], high=high, why=why)


def _span(slopes: dict[str, float]) -> str:
    steep, flat = (pick(slopes, key=lambda name: slopes[name]) for pick in (min, max))
    return " to ".join(f"{slopes[scene]:.2f} ({scene})".replace("-", "−", 1) for scene in (steep, flat))


def charts(noises: Sequence[Noise], floor: dict[str, float]) -> Iterator[Series]:
    spp = [float(count) for count in noises[0].spp]
    time, samples, error = "seconds per view", "samples per pixel", "RMSE, linear light"
    for noise in noises:
        yield Series("Noise against time", 0, noise.scene, time, error, noise.seconds, noise.rmse)
        yield Series("Noise against samples", 0, noise.scene, samples, error, spp, noise.rmse)
        panel, label = "Ceiling against samples", "PSNR ceiling, dB"
        yield Series(panel, 0, noise.scene, samples, label, spp, noise.psnr, log_y=False)
    seconds = [taken for noise in noises for taken in noise.seconds]
    for panel, label, x in (("Noise against time", time, seconds), ("Noise against samples", samples, spp)):
        worst = [max(floor.values())] * 2
        yield Series(panel, 0, "largest noise of a reference", label, error, [min(x), max(x)], worst)


def table_of(noises: Sequence[Noise], floor: dict[str, float]) -> Table:
    rows: Rows = [
        [noise.scene, noise.by_samples, noise.by_seconds, floor[noise.scene], *noise.seconds, *noise.psnr]
        for noise in noises
    ]
    columns = ["scene", "slope, samples", "slope, seconds", "reference RMSE"]
    columns += [f"{unit}, {count} samples" for unit in ("s", "dB") for count in noises[0].spp]
    return Table("ground_truth_work", 0, "Error and time of the ground truth", columns, rows)
