"""Study after study → `evidence.json`, written whenever one is whole."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from harness.chart_record import Series, Table
from harness.comparisons import METRICS
from harness.device import keep_freed_memory, multiplies_bfloat16, use_threads
from harness.evidence.situation import TRAININGS_FOLDER, Situation
from harness.evidence.studies import STUDIES, Study, measure_of
from harness.evidence_record import (
    EVIDENCE_FILE,
    Check,
    Effect,
    EvidenceRecord,
    StudyRecord,
    failed_checks,
    read_evidence,
    write_evidence,
)
from harness.output_folder import gone_on_with
from harness.plan import Machine
from harness.progress import Progress
from harness.provenance import provenance
from harness.scratch import scratch_folder
from harness.stopping import ON, told_when_stopped
from scenes.errors import InputError


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
        situation = Situation(out, view_sets, scratch, machine, multiplies_bfloat16(device), quick, show)
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


def measured(study: Study, situation: Situation) -> StudyRecord:
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


def _with_sound_trainings(record: EvidenceRecord, studies: list[str], situation: Situation) -> EvidenceRecord:
    """Without the studies, asked for now or not, on a training of `studies` that has to be gone on with, as other cells
    are other figures. Trainings of none of `studies` stay as they are, and so do their figures."""
    trainings = {name for study in studies for name in STUDIES[study].trainings}
    lost = {name for name in sorted(trainings) if situation.mended(name)}
    dropped = {one.info.id: sorted(lost & set(STUDIES[one.info.id].trainings)) for one in record.studies}
    for name, ended in dropped.items():
        if ended:
            situation.show.line(f"{name}: its figures are dropped, as {', '.join(ended)} has to be gone on with")
    return replace(record, studies=[one for one in record.studies if not dropped[one.info.id]])
