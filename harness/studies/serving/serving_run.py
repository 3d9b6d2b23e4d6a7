"""The studies of serving at the end of a run, into `OUT/serving.json`; their failure never fails the run."""

import json
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from harness.execution.progress import Progress
from harness.machine.provenance import provenance
from harness.plan.defaults import SERVING_SECONDS, SERVING_SHARE, SERVING_WIDTH
from harness.plan.run_plan import Machine
from harness.playback.run_loader import FinishedRun
from harness.records.study import Studies, read_studies
from harness.studies import framework
from harness.studies.serving.serving_context import ServingContext, reason_of
from harness.studies.serving.serving_studies import SHELF, STUDIES
from scenes.files.errors import DamagedRecord

SAME = ("system", "processor", "cores", "device", "torch_build", "packages", "python")
"""The facts of a record's origin that must agree, as another machine or other versions give other figures."""


def after_run(out: Path, device: str, view_sets: Path, show: Progress) -> None:
    """Measure serving at the end of `python -m harness run`, unless a complete record exists. It costs the run only
    time: a failure is reported, and studies that do not fit the time are left out.
    """
    try:
        finished = FinishedRun.of(out)
        run, quick = finished.run, finished.run.settings.get("profile") == "smoke"
        width = min(SERVING_WIDTH, *(scene.width for scene in run.scenes))
        context = ServingContext(
            out, view_sets, out, quick, show, Machine(device, 1, 1),
            finished, run.scenes, run.main_methods, run.seeds[0], width,
        )  # fmt: skip
        earlier = _earlier(context)
        if earlier is not None and earlier.is_complete:
            show.line("serving: measured before")
            return
        limit = max(SERVING_SECONDS, SERVING_SHARE * run.phases.get("total", 0.0))
        timed = replace(context, deadline=time.monotonic() + limit)
        framework.run(SHELF, list(STUDIES), timed, resume=earlier is not None)
    except Exception as error:
        # the run is done and recorded; serving is an extra
        show.line(f"serving was not measured: {reason_of(error)}")


def _earlier(context: ServingContext) -> Studies | None:
    """Return the existing record if it has the same settings, and the same code made it on the same machine."""
    origin = provenance(context.device)
    with suppress(DamagedRecord):
        record = read_studies(context.out / SHELF.file)
        same = record.settings == json.loads(json.dumps(context.settings()))
        if same and all(record.provenance.get(name) == origin[name] for name in SAME):
            return record
    return None
