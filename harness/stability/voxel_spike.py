"""The explicit field in the same small training as networks, with one gradient that is far too large: part of O2."""

from dataclasses import replace
from typing import Any

from harness.lockstep import box_of, needs_view_direction
from harness.make_learner import drjit_backend, learner_for
from harness.schedule import Budget
from harness.stability.situation import Situation
from harness.stability.small_training import CPU, STREAM, setup


def losses_of_voxels(situation: Situation, at: int, factor: float) -> list[float]:
    """Of `voxels_drjit`, whose gradient is `factor` times as large at step `at`; 1 is no spike.

    Raises `harness.learner.NotAvailable` where Dr.Jit does not work.
    """
    here = setup(situation)
    budget, directions = Budget(here.steps, None), needs_view_direction(here.views)
    drjit_backend(CPU)  # which finds the library that drjit loads
    import drjit as dr

    threads = dr.thread_count()
    try:
        # its trainer takes one thread for the whole process
        learner: Any = learner_for(
            "voxels_drjit", box_of(here.views, CPU), here.settings, budget, STREAM, CPU, directions
        )
        slope = learner._slope

        def spiked(*batch: Any) -> Any:
            found = slope(*batch)
            if learner.step != at or factor == 1.0:
                return found
            larger = {name: values * factor for name, values in found.gradients.items()}
            return replace(found, norm=found.norm * factor, gradients=larger)

        learner._slope = spiked
        losses = []
        for _ in range(here.steps):
            learner.train_on(*here.batches.batch(STREAM, learner.step, here.settings.rays))
            losses.append(learner.last_loss)
        return losses
    finally:
        dr.set_thread_count(threads)
