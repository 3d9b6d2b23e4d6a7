"""The studies of serving at the end of a run, into `OUT/serving.json`: never at the cost of the run."""

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
"""The facts about where a record was made that must agree: on another machine, or with other versions, figures are
other ones.
"""


def after_run(out: Path, device: str, view_sets: Path, show: Progress) -> None:
    """Measure what `python -m harness run` measures at its end, unless it is there already. It never costs the
    run anything but time: whatever goes wrong is reported, and what the time is too short for is left out.
    """
    try:
        finished = FinishedRun.of(out)
        run, quick = finished.run, finished.run.settings.get("profile") == "smoke"
        width = min(SERVING_WIDTH, *(scene.width for scene in run.scenes))
        asked = ServingContext(
            out, view_sets, out, quick, show, Machine(device, 1, 1),
            finished, run.scenes, run.main_methods, run.seeds[0], width,
        )  # fmt: skip
        there = _earlier(asked)
        if there is not None and there.is_complete:
            show.line("serving: measured before")
            return
        most = max(SERVING_SECONDS, SERVING_SHARE * run.phases.get("total", 0.0))
        timed = replace(asked, deadline=time.monotonic() + most)
        framework.run(SHELF, list(STUDIES), timed, resume=there is not None)
    except Exception as error:
        # the run is done and recorded: this was an extra
        show.line(f"serving was not measured: {reason_of(error)}")


def _earlier(asked: ServingContext) -> Studies | None:
    """Return the existing record, if it is of just this, made by the same code on the same machine."""
    origin = provenance(asked.device)
    with suppress(DamagedRecord):
        there = read_studies(asked.out / SHELF.file)
        same = there.settings == json.loads(json.dumps(asked.settings()))
        if same and all(there.provenance.get(name) == origin[name] for name in SAME):
            return there
    return None
