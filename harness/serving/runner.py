"""Study after study → `OUT/serving.json`, by its own command and at the end of every run."""

import hashlib
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from harness.checkpoints import checkpoint_path
from harness.device import available_cores, keep_freed_memory, use_threads
from harness.finished import FinishedRun
from harness.progress import Progress
from harness.provenance import provenance
from harness.records import DamagedRecord
from harness.serving import attention_study, cache_study, first_frame
from harness.serving.attention_maps import KINDS
from harness.serving.plan import estimated_seconds, plan_lines
from harness.serving.situation import Situation
from harness.serving_record import SERVING_FILE, ServingRecord, read_serving, write_serving
from harness.trainer import Diverged
from scenes.errors import InputError

WIDTH = 100
"""Of the pictures at the end of a run, or its views' where they are smaller."""
MOST_SECONDS, MOST_SHARE = 240.0, 0.05
"""What a run may spend on it at its end: so many seconds, or so much of its own time where that is more."""

STUDIES: dict[str, tuple[str, Callable[[Situation], Any]]] = {
    "cache": ("view cache", cache_study.measured),
    "attention": ("attention-prioritised rendering", attention_study.measured_attention),
    "first_frame": ("first frame of the viewer", first_frame.measured),
}
"""Field of the record → its title and what measures it."""


@dataclass(frozen=True)
class Asked:
    """What of a run is looked at."""

    scenes: list[str]
    methods: list[str]
    seed: int
    width: int
    quick: bool


def run(
    finished: FinishedRun,
    asked: Asked,
    device: torch.device,
    view_sets: Path,
    show: Progress,
    survive: bool = False,
    most_seconds: float | None = None,
) -> ServingRecord:
    """Measures and writes. What cannot be rendered is a sentence in `left_out`; with `survive` any other failure, too.

    Nothing is measured where it would take more than `most_seconds`. Whatever ends it, studies that were finished are
    written.
    """
    began = time.monotonic()
    # sizes of `quick` gain nothing from threads, which wait for each other on a machine that does something else
    threads = 1 if asked.quick else available_cores()
    use_threads(threads)
    keep_freed_memory()
    settings = settings_of(finished, asked, threads, device)
    record = ServingRecord(provenance(device), settings, None, None)
    with tempfile.TemporaryDirectory(prefix=".serving-", dir=finished.out) as scratch:
        situation = _situation(finished, asked, device, view_sets, Path(scratch), show)

        def kept(complete: bool = False, **studies: Any) -> ServingRecord:
            seconds, said = time.monotonic() - began, list(situation.left_out)
            return replace(
                record, settings={**settings, "complete": complete}, left_out=said, seconds=seconds, **studies
            )

        try:
            planned = _estimate(situation, most_seconds, survive)
            for field, (title, study) in STUDIES.items() if planned else ():
                show.line(f"serving: {title}")
                record = kept(**{field: _studied(title, study, situation, survive)})
                write_serving(finished.out, record)
        except BaseException as stop:
            situation.leave_out(f"not everything was measured: stopped by {type(stop).__name__}")
            write_serving(finished.out, kept())
            raise
        record = kept(complete=planned)
        write_serving(finished.out, record)
    return record


def after_run(out: Path, device: str, view_sets: Path, show: Progress) -> None:
    """What `python -m harness run` measures at its end, unless it is there already. Never costs the run anything but
    time: whatever goes wrong is said, here and in the record.
    """
    try:
        finished = FinishedRun.of(out)
        settings = finished.run.settings
        asked = Asked(
            scenes=[one.name for one in finished.run.scenes],
            methods=list(finished.run.methods),
            seed=finished.run.seeds[0],
            width=min(WIDTH, *(one.width for one in finished.run.scenes)),
            quick=settings.get("profile") == "smoke",
        )
        threads = 1 if asked.quick else available_cores()
        if is_measured(out, settings_of(finished, asked, threads, torch.device(device))):
            show.line("serving: measured before")
            return
        most = max(MOST_SECONDS, MOST_SHARE * finished.run.phases.get("total", 0.0))
        run(finished, asked, torch.device(device), view_sets, show, survive=True, most_seconds=most)
    except Exception as error:
        # the run is done and recorded: this was an extra
        show.line(f"serving was not measured: {reason_of(error)}")


def is_measured(out: Path, settings: dict[str, Any]) -> bool:
    """Whether there is a whole record of just this."""
    try:
        return read_serving(out / SERVING_FILE).settings == json.loads(json.dumps({**settings, "complete": True}))
    except DamagedRecord:
        return False


def settings_of(finished: FinishedRun, asked: Asked, threads: int, device: torch.device) -> dict[str, Any]:
    """Everything that the figures depend on, as JSON."""
    return {
        "scenes": asked.scenes,
        "methods": asked.methods,
        "seed": asked.seed,
        "width": asked.width,
        "threads": threads,
        "quick": asked.quick,
        "device": device.type,
        "attention": KINDS,
        "weights": {
            f"{scene}.{method}": digest
            for scene in asked.scenes
            for method in asked.methods
            if (digest := _digest(checkpoint_path(finished.out, scene, method, asked.seed))) is not None
        },
    }


def reason_of(error: BaseException) -> str:
    """In one sentence: a mistake speaks for itself, of an error of ours the kind is said as well."""
    said = " ".join(str(error).split())
    return said if isinstance(error, EXPECTED) else f"{type(error).__name__}: {said}"


EXPECTED = (InputError, DamagedRecord, Diverged)
"""What a run may hold that cannot be rendered; all else is an error of ours."""


def _studied(title: str, study: Callable[[Situation], Any], situation: Situation, survive: bool) -> Any:
    try:
        return study(situation)
    except Exception as error:
        if not (survive or isinstance(error, EXPECTED)):
            raise
        situation.leave_out(f"{title}: {reason_of(error)}")
        return None


def _estimate(situation: Situation, most_seconds: float | None, survive: bool) -> bool:
    """Says what is going to be measured; whether it is."""
    try:
        seconds = estimated_seconds(situation)
    except Exception as error:
        if not (survive or isinstance(error, EXPECTED)):
            raise
        situation.leave_out(f"how long it takes is not known: {reason_of(error)}")
        return most_seconds is None
    for line in plan_lines(situation, seconds):
        situation.show.line(line)
    if most_seconds is None or seconds <= most_seconds:
        return True
    situation.leave_out(
        f"nothing was measured at the end of the run: it would have taken about {seconds / 60:.0f} min; "
        "`python -m harness serving OUT` does it"
    )
    return False


def _situation(
    finished: FinishedRun, asked: Asked, device: torch.device, view_sets: Path, scratch: Path, show: Progress
) -> Situation:
    return Situation(
        run=finished,
        scenes=finished.scenes(asked.scenes),
        methods=asked.methods,
        seed=asked.seed,
        width=asked.width,
        device=device,
        view_sets=view_sets,
        scratch=scratch,
        quick=asked.quick,
        show=show,
    )


def _digest(path: Path) -> str | None:
    """Of a checkpoint; None where there is none."""
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest() if path.is_file() else None
