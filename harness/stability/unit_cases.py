"""S8: does anything depend on the unit of length in which poses, box, near and far are written?"""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from harness.batches import Batches
from harness.chart_record import Series, Table
from harness.evaluate import cameras_of, quick_scores, render_split
from harness.lockstep import box_of
from harness.stability.situation import Finding, Situation
from harness.stability.small_training import CPU, new_trainer, not_made_of_parts, setup, train
from harness.stability_record import Outcome, Whose, judged
from scenes.view_set import Split, ViewSet

UNITS = (0.1, 10.0, 25.0)
"""How many new units of length an old one is; they are no powers of two, so coordinates are rounded anew."""
EXACT = 8.0
"""A power of two changes no digit: what does not depend on the unit keeps every bit."""
LARGEST_CHANGE_DB = 0.5
"""Rounding grows with every step of training: processors differ by 0.30 dB RMS after 1000 steps."""
METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_printed", "qnerf_theorem", "qnerf_repaired")


def rescaled(views: ViewSet, k: float) -> ViewSet:
    """The same images, with everything that is a length written in a unit that is 1 / k as long."""

    def moved(split: Split) -> Split:
        poses = np.array(split.camera_to_world, copy=True)
        poses[:, :3, 3] *= k
        return replace(split, camera_to_world=poses, depth=None)

    return replace(
        views,
        near=k * views.near,
        far=k * views.far,
        bounds=k * views.bounds,
        train=moved(views.train),
        val=moved(views.val),
        test=moved(views.test),
    )


def psnr_in_unit(situation: Situation, method: str, k: float) -> float:
    """Test PSNR after the usual small training, on views that are rescaled after every other normalisation; NaN where a
    view has none.
    """
    here = setup(situation)
    views = rescaled(here.views, k)
    trainer = new_trainer(situation, method, box=box_of(views, CPU))
    train(situation, trainer, batches=Batches(cameras_of(views, views.train, CPU), views.train.rgba))
    psnr = quick_scores(render_split(trainer, cameras_of(views, views.test, CPU), 4096), views.test)["psnr"]
    return math.nan if psnr is None else psnr


def units_of_length(situation: Situation) -> Iterator[Finding]:
    """S8: every method, trained on the same images in five units of length."""
    rows: list[list[str | float | None]] = []
    for method in METHODS:
        if reason := not_made_of_parts(method):
            yield Outcome("S8", method, "ours", "not_applicable", why=reason)
            continue
        scores = {k: psnr_in_unit(situation, method, k) for k in (1.0, EXACT, *UNITS)}
        rows.append([method, *scores.values()])
        whose: Whose = "paper" if method == "qnerf_printed" else "ours"
        change = max(abs(scores[k] - scores[1.0]) for k in UNITS)
        units = ", ".join(f"{k:g}" for k in UNITS)
        yield judged(
            "S8", method, whose, change, LARGEST_CHANGE_DB, unit="dB",
            what=f"largest change of test PSNR where the unit of length is 1/k as long, k = {units}",
        )  # fmt: skip
        yield judged(
            "S8", method, whose, abs(scores[EXACT] - scores[1.0]), 0.0, unit="dB",
            what=f"change of test PSNR for k = {EXACT:g}, which rounds nothing",
        )  # fmt: skip
        ordered = sorted(scores)
        yield Series(
            "Test PSNR against the unit of length of the poses", 10, method, "k", "dB",
            ordered, [scores[k] for k in ordered], log_y=False,
        )  # fmt: skip
    columns = ["method", *(f"k = {k:g}" for k in (1.0, EXACT, *UNITS))]
    yield Table("s8-units", 10, "Test PSNR, dB, with every length multiplied by k", columns, rows)
