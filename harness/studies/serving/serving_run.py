"""What the serving studies depend on, and their run into `OUT/serving.json`, by their own command and after a run."""

import hashlib
import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import torch
from msgspec import structs

from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, use_threads
from harness.machine.provenance import PROGRAM, provenance, versions
from harness.plan.defaults import SERVING_SECONDS, SERVING_SHARE, SERVING_WIDTH
from harness.playback.run_loader import FinishedRun
from harness.records.json_record import DamagedRecord
from harness.records.study import Studies, read_studies
from harness.run_folder.integrity import aside
from harness.studies import framework
from harness.studies.serving.serving_context import ServingContext, ServingRequest, reason_of
from harness.studies.serving.serving_studies import SHELF, STUDIES
from harness.training.checkpoints import checkpoint_path

SAME = ("system", "processor", "cores", "device", "torch_build", "packages", "python")
"""The facts about where a record was made that must agree: on another machine, or with other versions, figures are
other ones.
"""
QUICK_SHARE = 0.1
"""The share of the time that `quick` takes."""


def settings_of(asked: ServingRequest) -> dict[str, Any]:
    """Return everything that the figures depend on but the machine, as JSON."""
    scenes = [scene.name for scene in asked.scenes]
    return {
        "scenes": scenes,
        "methods": asked.methods,
        "seed": asked.seed,
        "width": asked.width,
        "threads": asked.threads,
        "quick": asked.quick,
        "device": asked.device.type,
        "code": versions()[PROGRAM],
        "weights": {
            f"{scene}.{method}": hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest()
            for scene in scenes
            for method in asked.methods
            if (path := checkpoint_path(asked.run.out, scene, method, asked.seed)).is_file()
        },
    }


def run(
    asked: ServingRequest, studies: list[str], resume: bool, show: Progress, most_seconds: float | None = None
) -> int:
    """Measure `studies`; with `resume` only those that are not complete there, else all anew. Returns 0, or 3 if a
    study or a check of ours fails.

    With `most_seconds` no failure ends it, and nothing is begun once they are over. Raises `InputError`.
    """
    out = asked.run.out
    use_threads(asked.threads)
    keep_freed_memory()
    if not resume:
        try:
            read_studies(out / SHELF.file)
            (out / SHELF.file).unlink()
        except DamagedRecord:
            aside(out, SHELF.file)
    deadline = None if most_seconds is None else time.monotonic() + most_seconds
    return framework.run(
        SHELF,
        studies,
        out,
        resume,
        settings_of(asked),
        provenance(asked.device),
        lambda scratch, _: ServingContext(**vars(asked), scratch=scratch, show=show, deadline=deadline),
        show,
        lambda name: STUDIES[name].seconds * (QUICK_SHARE if asked.quick else 1.0),
        lambda record, _: structs.replace(record, studies=[each for each in record.studies if not each.cut_short]),
    )


def after_run(out: Path, device: str, view_sets: Path, show: Progress) -> None:
    """Measure what `python -m harness run` measures at its end, unless it is there already. It never costs the
    run anything but time: whatever goes wrong is reported, and what the time is too short for is left out.
    """
    try:
        finished = FinishedRun.of(out)
        asked = ServingRequest(
            finished,
            finished.run.scenes,
            finished.run.main_methods,
            finished.run.seeds[0],
            min(SERVING_WIDTH, *(scene.width for scene in finished.run.scenes)),
            finished.run.settings.get("profile") == "smoke",
            torch.device(device),
            view_sets,
        )
        there = _earlier(asked)
        if there is not None and there.is_complete:
            show.line("serving: measured before")
            return
        most = max(SERVING_SECONDS, SERVING_SHARE * finished.run.phases.get("total", 0.0))
        run(asked, list(STUDIES), there is not None, show, most)
    except Exception as error:
        # the run is done and recorded: this was an extra
        show.line(f"serving was not measured: {reason_of(error)}")


def _earlier(asked: ServingRequest) -> Studies | None:
    """Return the existing record, if it is of just this, made by the same code on the same machine."""
    origin = provenance(asked.device)
    with suppress(DamagedRecord):
        there = read_studies(asked.run.out / SHELF.file)
        same = there.settings == json.loads(json.dumps(settings_of(asked)))
        if same and all(there.provenance.get(name) == origin[name] for name in SAME):
            return there
    return None
