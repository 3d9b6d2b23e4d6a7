"""What is going to be measured, and about how long it takes, from one rendered view."""

import time

from harness.serving.anytime import ORDERS
from harness.serving.attention_maps import KINDS
from harness.serving.attention_study import bins_of, run_bins
from harness.serving.attention_study import cells_of as attention_cells
from harness.serving.cache_study import cells_of as cache_cells
from harness.serving.situation import Situation, plain

PATH_VIEWS = 14
"""Renderings for each view of an orbit, on all paths together, with and without a cache."""
VARIANTS = 9
REFINED = 1.5
"""Refining takes as many times as long as rendering: its calls are smaller, and the coarse frame is on top."""
BESIDE = 1.3
"""Reading, writing, hashing and scoring, on top of rendering."""
LEAST_SECONDS = 1.0


def estimated_seconds(situation: Situation) -> float:
    """From one view of the first cell, rendered twice: the first call also allocates."""
    sizes, seconds = situation.sizes, LEAST_SECONDS
    cached, attended = cache_cells(situation), attention_cells(situation)
    if cached:
        cell = cached[0]
        camera = situation.camera(cell, situation.orbit(cell.scene, 1)[0])
        plain(cell.learner, camera, cell.chunk)
        began = time.perf_counter()
        plain(cell.learner, camera, cell.chunk)
        one = time.perf_counter() - began
        views = len(cached) * (sizes.rounds + REFINED * sizes.first_frames)
        views += PATH_VIEWS * sizes.orbit + VARIANTS * sizes.confused
        if attended:
            bins, own = bins_of(situation, attended[0]), run_bins(attended[0])
            refined = REFINED * sizes.repeats * (len(KINDS) + len(ORDERS) - 1)
            shared = (len(KINDS) + 1) * sum(bins) / own + sizes.reference_bins / own
            views += len(attended) * sizes.views * (1 + refined + shared)
        seconds += BESIDE * one * views
    return seconds


def plan_lines(situation: Situation, seconds: float) -> list[str]:
    """In words, for the terminal."""
    quick = ", quick" if situation.quick else ""
    return [
        f"serving {situation.run.out}, {situation.width} px wide, seed {situation.seed}{quick}: about {seconds:.0f} s",
        f"  scenes   {' '.join(scene.name for scene in situation.scenes)}",
        f"  methods  {' '.join(situation.methods)}",
    ]
