"""View cache, attention and first frame of the viewer → `OUT/serving.json`, by its own command and after every run."""

import hashlib
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import torch

from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.plan.defaults import SERVING_SECONDS, SERVING_SHARE, SERVING_WIDTH
from harness.playback.keys import ROOT, code_digest
from harness.playback.run_loader import FinishedRun
from harness.records.cells import records_folder
from harness.records.json_record import DamagedRecord, file_digest, finite_or_none
from harness.records.serving_record import SERVING_FILE, FirstFrame, ServingRecord, read_serving, write_serving
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.integrity import mend_serving
from harness.studies.serving import attention_study, cache_study
from harness.studies.serving.allocations import evens
from harness.studies.serving.anytime import KINDS, ORDERS
from harness.studies.serving.attention_study import cells_of as attention_cells
from harness.studies.serving.attention_study import run_bins
from harness.studies.serving.cache_latency import POSES
from harness.studies.serving.cache_study import cells_of
from harness.studies.serving.cache_study import cells_of as cache_cells
from harness.studies.serving.serving_context import CLOCK, Clock, ServingContext, plain, timed
from harness.training.checkpoints import checkpoint_path
from harness.training.metrics import psnr
from harness.training.trainer import Diverged
from harness.viewer.engine import FreshPixels, first_frame, seconds_of
from scenes.files.errors import InputError

PATH_VIEWS = 17
"""The renderings for each view of an orbit, on all paths together, with and without a cache."""
VARIANTS = 12
"""The number of variants that a key is asked for, including what it has seen."""
REFINED = 1.5
"""The time of refining relative to rendering: its chunks are smaller, and the coarse frame comes on top."""
SHARED = 6.0
"""The time relative to rendering of as many samples and as many evaluations by attention, one picture each,
together.
"""
BESIDE = 1.3
"""The factor for reading, writing, hashing and scoring, on top of rendering."""
LEAST_SECONDS = 1.0


def estimated_seconds(situation: ServingContext, clock: Clock = CLOCK) -> float:
    """Estimate the seconds from one view of each cell of the cache's, rendered twice: the first rendering also
    allocates.
    """
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


def plan_lines(situation: ServingContext, seconds: float) -> list[str]:
    """Return the plan in words, for the terminal."""
    quick = ", quick" if situation.quick else ""
    return [
        f"serving {situation.run.out}, {situation.width} px wide, seed {situation.seed}{quick}: about {seconds:.0f} s",
        f"  scenes   {' '.join(scene.name for scene in situation.scenes)}",
        f"  methods  {' '.join(situation.methods)}",
    ]


def measured(situation: ServingContext) -> FirstFrame | None:
    """Return the slowest of some requests, each of another pose with an empty cache; None if nothing can be rendered
    here.
    """
    cells = cells_of(situation)
    if not cells:
        return None
    calls = situation.sizes.first_frames
    methods = [cell.cell.method for cell in cells]
    cameras = [situation.camera(cells[0], pose) for pose in situation.orbit(cells[0].scene, calls)]
    shown = [first_frame(cells, camera) for camera in cameras]
    seconds = [seconds_of(frames) for frames in shown]
    return FirstFrame(
        scene=cells[0].scene.name,
        methods=methods,
        width=cameras[0].width,
        height=cameras[0].height,
        seconds_coarse=max(coarse for coarse, _ in seconds),
        seconds_whole=max(whole for _, whole in seconds),
        calls=len(shown),
        strides=[max(coarse_of(frames, method)[0] for frames in shown) for method in methods],
        psnr_coarse=[finite_or_none(min(coarse_of(frames, method)[1] for frames in shown)) for method in methods],
    )


def coarse_of(frames: Sequence[FreshPixels], method: str) -> tuple[int, float]:
    """Return the stride of a method's coarse frame, and its PSNR in dB against the complete picture."""
    mine = {frame.state: frame for frame in frames if frame.method == method}
    return mine["coarse"].stride or 1, psnr(mine["coarse"].colour, mine["whole"].colour)


THREADS = 1
"""The threads of torch. Several wait for each other whenever the machine does something else, and rendering then takes
many times as long; on two cores that do nothing else, two render 1.4 to 1.6 times as fast as one. A hit uses one in any
case.
"""
MEASURING = ("harness/studies/serving/*.py", "harness/playback/*.py")
"""The sources that figures come from, besides those that render."""
SAME = ("system", "processor", "cores", "device", "torch_build", "packages", "python")
"""The facts about where a record was made that must agree: on another machine, or with other versions, figures are
other ones.
"""

STUDIES: dict[str, tuple[str, Callable[[ServingContext], Any]]] = {
    "cache": ("view cache", cache_study.measured),
    "attention": ("attention-prioritised rendering", attention_study.measured_attention),
    "first_frame": ("first frame of the viewer", measured),
}
"""Field of the record → its title and what measures it."""


@dataclass(frozen=True)
class ServingRequest:
    """The part of a run to measure."""

    scenes: list[str]
    methods: list[str]
    seed: int
    width: int
    quick: bool
    threads: int = THREADS


def run(
    finished: FinishedRun,
    asked: ServingRequest,
    device: torch.device,
    view_sets: Path,
    show: Progress,
    survive: bool = False,
    most_seconds: float | None = None,
) -> ServingRecord:
    """Measure and write. What cannot be rendered is a sentence in `left_out`; with `survive` any other failure, too.

    Nothing is measured if it would take more than `most_seconds`, and nothing is begun once they are over. Whatever
    ends it, studies that were finished are written, but not over a complete record of the same weights.
    """
    began = time.monotonic()
    use_threads(asked.threads)
    keep_freed_memory()
    settings = settings_of(finished, asked, device)
    record = ServingRecord(provenance(device), settings, None, None)
    mend_serving(finished.out, show.line)
    with scratch_folder(finished.out) as scratch:
        deadline = None if most_seconds is None else began + most_seconds
        situation = _situation(finished, asked, device, view_sets, scratch, show, deadline)
        failed: list[str] = []

        def kept(complete: bool = False, **studies: Any) -> ServingRecord:
            now, seconds = {**settings, "complete": complete}, time.monotonic() - began
            left_out = list(situation.left_out)
            return replace(record, settings=now, seconds=seconds, left_out=left_out, failed=list(failed), **studies)

        try:
            planned = _estimate(situation, most_seconds, survive)
            for field, (title, study) in STUDIES.items() if planned else ():
                if situation.is_over(title):
                    continue
                show.line(f"serving: {title}")
                found = _studied(title, study, situation, survive, failed)
                record = kept(**{field: found})
                if found is not None:
                    _write(finished.out, record, situation.scratch)
        except BaseException as stop:
            situation.leave_out(f"not everything was measured: stopped by {type(stop).__name__}")
            try:
                _write(finished.out, kept(), situation.scratch)
            except (OSError, ValueError) as error:
                # what stopped it is what has to be known
                show.line(f"serving: its record could not be written: {reason_of(error)}")
            raise
        record = kept(complete=planned and not failed and not situation.is_late)
        if not _write(finished.out, record, situation.scratch):
            show.line(f"serving: {finished.out / SERVING_FILE} is kept, as it says more")
    return record


def after_run(out: Path, device: str, view_sets: Path, show: Progress) -> None:
    """Measure what `python -m harness run` measures at its end, unless it is there already. It never costs the run
    anything but time: whatever goes wrong is reported, here and in the record.
    """
    try:
        finished = FinishedRun.of(out)
        settings = finished.run.settings
        asked = ServingRequest(
            scenes=[one.name for one in finished.run.scenes],
            methods=finished.run.main_methods,
            seed=finished.run.seeds[0],
            width=min(SERVING_WIDTH, *(one.width for one in finished.run.scenes)),
            quick=settings.get("profile") == "smoke",
        )
        if is_measured(out, settings_of(finished, asked, torch.device(device)), provenance(torch.device(device))):
            show.line("serving: measured before")
            return
        most = max(SERVING_SECONDS, SERVING_SHARE * finished.run.phases.get("total", 0.0))
        run(finished, asked, torch.device(device), view_sets, show, survive=True, most_seconds=most)
    except Exception as error:
        # the run is done and recorded: this was an extra
        show.line(f"serving was not measured: {reason_of(error)}")


def is_measured(out: Path, settings: dict[str, Any], origin: dict[str, Any]) -> bool:
    """Whether there is a complete record of just this, made by the same code on the same machine."""
    there = _earlier(out)
    return (
        there is not None
        and there.settings == json.loads(json.dumps({**settings, "complete": True}))
        and all(there.provenance.get(name) == origin[name] for name in SAME)
    )


def settings_of(finished: FinishedRun, asked: ServingRequest, device: torch.device) -> dict[str, Any]:
    """Return everything that the figures depend on but the machine, as JSON."""
    return {
        "scenes": asked.scenes,
        "methods": asked.methods,
        "seed": asked.seed,
        "width": asked.width,
        "threads": asked.threads,
        "quick": asked.quick,
        "device": device.type,
        "attention": KINDS,
        "code": _code(),
        "weights": {
            f"{scene}.{method}": digest
            for scene in asked.scenes
            for method in asked.methods
            if (digest := _digest(checkpoint_path(finished.out, scene, method, asked.seed))) is not None
        },
    }


def reason_of(error: BaseException) -> str:
    """Return the reason in one sentence: a mistake speaks for itself, of an error of ours the kind is named as well."""
    said = " ".join(str(error).split())
    return said if isinstance(error, EXPECTED) else f"{type(error).__name__}: {said}"


EXPECTED = (InputError, DamagedRecord, Diverged)
"""The errors of a run that cannot be rendered; all else is an error of ours."""


def _studied(
    title: str, study: Callable[[ServingContext], Any], situation: ServingContext, survive: bool, failed: list[str]
) -> Any:
    try:
        return study(situation)
    except Exception as error:
        if not (survive or isinstance(error, EXPECTED)):
            raise
        failed.append(title)
        situation.leave_out(f"{title}: {reason_of(error)}")
        return None


def _write(out: Path, record: ServingRecord, scratch: Path) -> bool:
    """Write the record and its pictures, which lie under `scratch`; neither if the existing record can be read and says
    more. Returns whether they were written.
    """
    there = _earlier(out)
    if there is not None and not _replaces(record, there):
        return False
    pictures, target = records_folder(scratch), records_folder(out)
    for frame in record.attention.frames if record.attention else ():
        if (pictures / frame.image).is_file():  # else put there with an earlier study's record
            (target / frame.image).parent.mkdir(parents=True, exist_ok=True)
            (pictures / frame.image).replace(target / frame.image)
    frames = record.attention.frames if record.attention else ()
    digests = {one.image: file_digest(target / one.image) for one in frames if (target / one.image).is_file()}
    write_serving(out, replace(record, files=digests))
    return True


def _replaces(record: ServingRecord, there: ServingRecord) -> bool:
    """Whether a record replaces the existing one: not if nothing was measured; else if it is complete, or the other was
    not, or was of other weights.
    """
    if record.cache is None and record.attention is None and record.first_frame is None:
        return False
    if record.settings["complete"]:
        return True
    weights, before = record.settings["weights"], there.settings.get("weights", {})
    same = all(before[name] == digest for name, digest in weights.items() if name in before)
    return not (there.settings.get("complete") and same)


def _earlier(out: Path) -> ServingRecord | None:
    """Return the existing record if it can be read."""
    try:
        return read_serving(out / SERVING_FILE)
    except DamagedRecord:
        return None


def _estimate(situation: ServingContext, most_seconds: float | None, survive: bool) -> bool:
    """Print what is going to be measured; returns whether it will be."""
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
        "`python -m harness study serving OUT` does it"
    )
    return False


def _situation(
    finished: FinishedRun,
    asked: ServingRequest,
    device: torch.device,
    view_sets: Path,
    scratch: Path,
    show: Progress,
    deadline: float | None,
) -> ServingContext:
    return ServingContext(
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
        deadline=deadline,
    )


@cache
def _code() -> str:
    """Return the digest of the sources that render and measure, as they are at the first request."""
    found = hashlib.blake2b(code_digest().encode(), digest_size=16)
    for file in sorted(file for pattern in MEASURING for file in ROOT.glob(pattern)):
        found.update(f"{file.name}\n".encode() + file.read_bytes())
    return found.hexdigest()


def _digest(path: Path) -> str | None:
    """Return the digest of a checkpoint; None if there is none."""
    return hashlib.blake2b(path.read_bytes(), digest_size=16).hexdigest() if path.is_file() else None
