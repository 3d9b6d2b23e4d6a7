"""The table of studies that a verdict rests on, and their run: study after study → `evidence.json`."""

import json
import time
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import torch

from harness.execution.progress import Progress
from harness.machine.device import keep_freed_memory, multiplies_bfloat16, use_threads
from harness.machine.provenance import provenance
from harness.machine.stopping import ON, told_when_stopped
from harness.plan.profiles import Machine
from harness.records.charts import Series, Table
from harness.records.evidence_record import (
    EVIDENCE_FILE,
    Check,
    Effect,
    EvidenceRecord,
    StudyInfo,
    StudyRecord,
    failed_checks,
    read_evidence,
    write_evidence,
)
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.output_folder import gone_on_with
from harness.studies.evidence.evidence_context import TRAININGS_FOLDER, EvidenceContext, Measure
from harness.verdicts.comparisons import METRICS
from scenes.files.errors import InputError


@dataclass(frozen=True)
class Study:
    info: StudyInfo
    measure: str
    """`module:function` in `harness.studies.evidence`."""
    seconds: float
    trainings: tuple[str, ...] = ()
    """What it trains (`harness.studies.evidence.evidence_context`), for its scale."""


def _study(
    name: str, title: str, question: str, method: str, measure: str, seconds: float, *trainings: str
) -> tuple[str, Study]:
    return name, Study(StudyInfo(name, title, question, method), measure, seconds, trainings)


STUDIES: dict[str, Study] = dict(
    [
        _study(
            "calibration",
            "Are the intervals calibrated?",
            "How often do the intervals hold the truth, and how often is an effect found that is there?",
            "Simulated studies of known truth, judged by the functions that judge a run: 4 to 16 scenes, 3 to 10 "
            "seeds, effects that differ by 0 to 0.6 dB from scene to scene, normal noise, heavy tails, and runs that "
            "collapse.",
            "calibration:calibration",
            15,
        ),
        _study(
            "positive_controls",
            "Does it find what is known?",
            "Does the comparer find the losses that the original NeRF's ablation found?",
            "NeRF without positional encoding, without view direction, with half and with a quarter of the training "
            "views where these are few, each against NeRF, judged like Q-NeRF.",
            "positive_controls:positive_controls",
            340,
            "no_encoding",
            "no_direction",
            "images",
            "half_images",
            "quarter_images",
        ),
        _study(
            "ceilings",
            "Is the noise ceiling right?",
            "Does the PSNR ceiling that follows from the ground truth's own variance agree with an independent render?",
            "Every test view is rendered once more with other random numbers; half of the mean square difference of "
            "two renders is the noise of one.",
            "ceilings:ceilings",
            90,
        ),
        _study(
            "factorial",
            "What does each part do?",
            "What do the φ encoding, the amplifier and the φ skip contribute, alone and together?",
            "All eight combinations of the three parts, under both readings of the amplifier: main effects, "
            "interactions, and the cumulative rows of Table 4.",
            "factorial:factorial",
            540,
            "factorial",
        ),
        _study(
            "bandwidth",
            "The golden ratio, or bandwidth?",
            "Is what the φ encoding changes owed to φ, or to how far its frequencies reach?",
            "φ with NeRF's reach, another base with φ's reach, and 2^k with φ's reach, beside both, at three "
            "resolutions and along training.",
            "bandwidth:bandwidth",
            1100,
            "bandwidth_100",
            "bandwidth_200",
            "bandwidth_300",
        ),
        _study(
            "repaired",
            "Can the paper's idea be repaired?",
            "Does the best reading that keeps the idea and can be opaque beat NeRF, on scenes it was not chosen on?",
            "Candidates were compared on validation views of two scenes with seeds of their own; the best at equal "
            "time is put to the test on the other six.",
            "repaired:repaired",
            900,
            "repaired",
        ),
        _study(
            "rendering",
            "Error against time of rendering",
            "Which quadrature rule and which sampler reach an error first?",
            "One trained field, rendered with every rule and sampler at growing numbers of samples, against a "
            "rendering so fine that its own error does not show.",
            "rendering_work:rendering_work",
            120,
        ),
        _study(
            "ground_truth",
            "Error against time of the ground truth",
            "How much time does Mitsuba need for how little noise?",
            "One view of every scene at growing numbers of samples a pixel, against a render with many more.",
            "ground_truth_work:ground_truth_work",
            120,
        ),
    ]
)


def measure_of(study: Study) -> Measure:
    """The function behind a study; heavy imports happen here, one study at a time."""
    module, _, function = study.measure.partition(":")
    found: Measure = getattr(import_module(f"harness.studies.evidence.{module}"), function)
    return found


def run(
    studies: list[str], out: Path, view_sets: Path, machine: Machine, quick: bool, resume: bool, show: Progress
) -> int:
    """Does `studies` into `out`; with `resume` only those that are not whole there, or whose trainings hold cells that
    had no chance. 0, or 3 where a check fails.

    Raises `InputError` before anything is measured where `out` cannot be used.
    """
    device = torch.device(machine.device)
    use_threads(machine.threads)
    keep_freed_memory()
    interest = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
    settings = {"quick": quick, "device": machine.device, "smallest_of_interest": interest}
    record = _claimed(out, resume, settings, device, show)

    def kept() -> str:
        whole = sum(one.info.id in studies for one in record.studies)
        return f"{whole} of {len(studies)} studies are kept; `python -m reports {out}` reports them; {ON} {out}"

    with told_when_stopped(kept), scratch_folder(out) as scratch:
        situation = EvidenceContext(out, view_sets, scratch, machine, multiplies_bfloat16(device), quick, show)
        if resume:
            record = _with_sound_trainings(record, studies, situation)
            # before any training is whole again: from then on nothing tells that figures were of other cells
            write_evidence(out / EVIDENCE_FILE, record)
        missing = [name for name in studies if name not in {one.info.id for one in record.studies}]
        minutes = sum(STUDIES[name].seconds for name in missing) / 60
        show.line(f"evidence: {len(missing)} studies, about {minutes:.0f} min")
        for place, name in enumerate(missing):
            show.line(f"[{place + 1}/{len(missing)}] {name}: {STUDIES[name].info.question}")
            record = _with_study(record, measured(STUDIES[name], situation))
            write_evidence(out / EVIDENCE_FILE, record)
    record = replace(record, finished=True)
    write_evidence(out / EVIDENCE_FILE, record)
    for study, check in failed_checks(record):
        show.line(f"does not hold: {study.info.id}: {line_of(check)}")
    return 3 if failed_checks(record) else 0


def measured(study: Study, situation: EvidenceContext) -> StudyRecord:
    """Everything that one study yields, said as it comes."""
    began = time.monotonic()
    kinds: dict[type, list[Any]] = {str: [], Check: [], Effect: [], Series: [], Table: []}
    for finding in measure_of(study)(situation):
        kinds[type(finding)].append(finding)
        if isinstance(finding, str):
            situation.show.line(f"  {finding}")
        elif isinstance(finding, Check):
            situation.show.line(f"  {'holds' if finding.holds else 'DOES NOT HOLD'}: {line_of(finding)}")
    return StudyRecord(
        study.info,
        situation.scale(*study.trainings),
        kinds[str],
        kinds[Check],
        kinds[Effect],
        kinds[Series],
        kinds[Table],
        time.monotonic() - began,
    )


def line_of(one: Check) -> str:
    """`share of A/A comparisons called better or worse: 0.013 (at most 0.05)`"""
    figure = "no figure" if one.figure is None else f"{one.figure:.3g}{one.unit and ' ' + one.unit}"
    ends = (("at least", one.low), ("at most", one.high))
    limits = [f"{word} {limit:.3g}" for word, limit in ends if limit is not None]
    note = f"; {one.why}" if one.why else ""
    return f"{one.what}: {figure} ({', '.join(limits)}){note}"


def _with_study(record: EvidenceRecord, study: StudyRecord) -> EvidenceRecord:
    order = list(STUDIES)
    studies = sorted([*record.studies, study], key=lambda one: order.index(one.info.id))
    return replace(record, studies=studies, finished=False)


def _claimed(out: Path, resume: bool, settings: dict[str, Any], device: torch.device, show: Progress) -> EvidenceRecord:
    """The record to go on with, or a fresh one. Raises `InputError`."""
    record = gone_on_with(
        out, EVIDENCE_FILE, resume, read_evidence, show.line, beside=True, folders=(TRAININGS_FOLDER,)
    )
    if record is None:
        record = EvidenceRecord(provenance(device), settings)
        write_evidence(out / EVIDENCE_FILE, record)
    if record.settings != json.loads(json.dumps(settings)):
        raise InputError(f"--resume: {out} was made with other options; use the same or a new folder")
    return replace(record, studies=[one for one in record.studies if one.info.id in STUDIES], finished=False)


def _with_sound_trainings(record: EvidenceRecord, studies: list[str], situation: EvidenceContext) -> EvidenceRecord:
    """Without the studies, asked for now or not, on a training of `studies` that has to be gone on with, as other cells
    are other figures. Trainings of none of `studies` stay as they are, and so do their figures."""
    trainings = {name for study in studies for name in STUDIES[study].trainings}
    lost = {name for name in sorted(trainings) if situation.mended(name)}
    dropped = {one.info.id: sorted(lost & set(STUDIES[one.info.id].trainings)) for one in record.studies}
    for name, ended in dropped.items():
        if ended:
            situation.show.line(f"{name}: its figures are dropped, as {', '.join(ended)} has to be gone on with")
    return replace(record, studies=[one for one in record.studies if not dropped[one.info.id]])
