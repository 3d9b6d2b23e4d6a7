"""What is going to be measured, and about how long it takes, from one rendered view."""

from harness.serving.allocations import evens
from harness.serving.anytime import ORDERS
from harness.serving.attention_maps import KINDS
from harness.serving.attention_study import cells_of as attention_cells
from harness.serving.attention_study import run_bins
from harness.serving.cache_latency import POSES
from harness.serving.cache_study import cells_of as cache_cells
from harness.serving.situation import Situation, plain
from harness.serving.timing import CLOCK, Clock, timed

PATH_VIEWS = 17
"""Renderings for each view of an orbit, on all paths together, with and without a cache."""
VARIANTS = 12
"""Of what a key is asked for, and what it has seen."""
REFINED = 1.5
"""Refining takes as many times as long as rendering: its calls are smaller, and the coarse frame is on top."""
SHARED = 6.0
"""As many samples and as many evaluations by attention, one picture each, take together as many times as long."""
BESIDE = 1.3
"""Reading, writing, hashing and scoring, on top of rendering."""
LEAST_SECONDS = 1.0


def estimated_seconds(situation: Situation, clock: Clock = CLOCK) -> float:
    """From one view of each cell of the cache's, rendered twice: the first call also allocates."""
    sizes, seconds = situation.sizes, LEAST_SECONDS
    cached, attended = cache_cells(situation), attention_cells(situation)
    ones = []
    for cell in cached:
        camera = situation.camera(cell, situation.orbit(cell.scene, 1)[0])
        plain(cell.learner, camera, cell.chunk)
        ones.append(timed(lambda: plain(cell.learner, camera, cell.chunk), clock)[1])  # noqa: B023
    if ones:
        views: float = POSES + PATH_VIEWS * sizes.orbit + VARIANTS * sizes.confused
        if attended:
            own = run_bins(attended[0])
            refined = REFINED * sizes.repeats * (len(KINDS) + len(ORDERS) - 1)
            shared = (1 + sizes.shared) * (sum(evens(own)) / own + SHARED * len(KINDS)) + sizes.reference_bins / own
            views += len(attended) * (sizes.views * (1 + refined) + shared)
        seconds += BESIDE * (ones[0] * views + sum(ones) * (sizes.rounds + REFINED * sizes.first_frames))
    return seconds


def plan_lines(situation: Situation, seconds: float) -> list[str]:
    """In words, for the terminal."""
    quick = ", quick" if situation.quick else ""
    return [
        f"serving {situation.run.out}, {situation.width} px wide, seed {situation.seed}{quick}: about {seconds:.0f} s",
        f"  scenes   {' '.join(scene.name for scene in situation.scenes)}",
        f"  methods  {' '.join(situation.methods)}",
    ]
