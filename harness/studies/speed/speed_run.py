"""What the questions about speed depend on besides the machine, and their run into `speed.json`."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from harness.execution.progress import Progress
from harness.machine.device import available_cores, keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.studies import framework
from harness.studies.speed import time_to_target
from harness.studies.speed.questions import QUICK_SECONDS, SHELF
from harness.studies.speed.speed_context import SpeedContext, paper_settings, reduced_plan


def run(
    questions: list[str],
    out: Path,
    device: torch.device,
    view_sets: Path,
    plain_seconds: float,
    quick: bool,
    resume: bool,
    show: Progress,
) -> int:
    """Measure what `questions` ask for into `out`; with `resume` only what is not there yet.

    Raises `InputError` before anything is measured if `out` cannot be used.
    """
    # sizes of `quick` gain nothing from threads, which wait for each other on a machine that does something else
    threads = 1 if quick else available_cores()
    use_threads(threads)
    keep_freed_memory()

    def context(scratch: Path, _: tuple[str, ...] = ()) -> SpeedContext:
        return SpeedContext(out, view_sets, scratch, quick, show, device, threads, plain_seconds)

    costs = (lambda name: QUICK_SECONDS) if quick else None
    settings = settings_of(context(out))
    return framework.run(SHELF, questions, out, resume, settings, provenance(device), context, show, costs)


def settings_of(context: SpeedContext) -> dict[str, Any]:
    """Return everything that the figures depend on, as JSON."""
    plan = reduced_plan(context)
    return {
        "quick": context.quick,
        "publishable": not context.quick,
        "device": context.device.type,
        "threads": context.threads,
        "precision": context.precision,
        "matrix_units": context.matrix_units,
        "plain_seconds": context.plain_seconds,
        "test_pixels": time_to_target.TEST_PIXELS,
        "paper": asdict(paper_settings(context)),
        "same_network": asdict(time_to_target.same_network(context, plan)),
        "reduced": {"train": asdict(plan.train), "views": asdict(plan.views), "budget": plan.budget.settings()},
    }
