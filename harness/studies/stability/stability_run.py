"""Case after case → `stability.json`, written whenever one is whole."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from harness.execution.progress import Progress
from harness.machine.device import available_cores, keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.machine.stopping import ON, told_when_stopped
from harness.records.charts import Series, Table
from harness.records.stability_record import (
    PICTURES_FOLDER,
    STABILITY_FILE,
    CaseRecord,
    Outcome,
    Picture,
    StabilityRecord,
    broken,
    read_stability,
    write_stability,
)
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.output_folder import gone_on_with
from harness.studies.stability.cases import CASES, Case, measure_of
from harness.studies.stability.stability_context import StabilityContext
from scenes.files.errors import InputError


def run(
    cases: list[str], methods: tuple[str, ...], out: Path, view_sets: Path, quick: bool, resume: bool, show: Progress
) -> int:
    """Tries `cases` into `out`; with `resume` only those that are not whole there. 0, or 3 where what must pass failed.

    Raises `InputError` before anything is tried where `out` cannot be used.
    """
    workers = available_cores()
    use_threads(workers)
    keep_freed_memory()
    settings: dict[str, Any] = {"methods": list(methods), "quick": quick, "precision": "float32"}
    record = _claimed(out, resume, settings, show)
    missing = [name for name in cases if name not in {one.info.id for one in record.cases}]
    show.line(f"stability: {len(missing)} cases, about {sum(CASES[name].seconds for name in missing) / 60:.0f} min")

    def kept() -> str:
        whole = sum(one.info.id in cases for one in record.cases)
        return f"{whole} of {len(cases)} cases are kept; `python -m reports {out}` reports them; {ON} {out}"

    with told_when_stopped(kept), scratch_folder(out) as scratch:
        situation = StabilityContext(methods, out, view_sets, scratch, workers, quick, show, tuple(missing))
        for place, name in enumerate(missing):
            show.line(f"[{place + 1}/{len(missing)}] {name} {CASES[name].info.title}")
            record = _with_case(record, measured(CASES[name], situation))
            write_stability(out / STABILITY_FILE, record)
    record = replace(record, finished=True)
    write_stability(out / STABILITY_FILE, record)
    return 3 if broken(record) else 0


def measured(case: Case, situation: StabilityContext) -> CaseRecord:
    """Everything that one case yields, said as it comes."""
    began = time.monotonic()
    kinds: dict[type, list[Any]] = {Outcome: [], Series: [], Table: [], Picture: []}
    for finding in measure_of(case)(situation):
        kinds[type(finding)].append(finding)
        if isinstance(finding, Outcome):
            if finding.case != case.info.id:
                raise ValueError(f"case {case.info.id} gave an outcome of case {finding.case}")
            situation.show.line(f"  {line_of(finding)}")
    return CaseRecord(case.info, kinds[Outcome], kinds[Series], kinds[Table], kinds[Picture], time.monotonic() - began)


def line_of(one: Outcome) -> str:
    """`midpoint  pass  2.1e-07 (at most 1e-06): largest relative error`"""
    outcome = one.status.replace("_", " ")
    if one.status == "fail":
        outcome = "FAIL" if one.must_pass else "fails, a property of it"
    figure = "" if one.figure is None else f"  {one.figure:.3g}{one.unit and ' ' + one.unit}"
    bar = "" if one.bar is None else f" ({one.sense.replace('_', ' ')} {one.bar:.3g})"
    note = "; ".join(filter(None, (one.what, one.why)))
    return f"{one.subject}  {outcome}{figure}{bar}{note and ': ' + note}"


def _with_case(record: StabilityRecord, case: CaseRecord) -> StabilityRecord:
    order = list(CASES)
    cases = sorted([*record.cases, case], key=lambda one: order.index(one.info.id))
    return replace(record, cases=cases, finished=False)


def _claimed(out: Path, resume: bool, settings: dict[str, Any], show: Progress) -> StabilityRecord:
    """The record to go on with, or a fresh one. Raises `InputError`."""
    record = gone_on_with(out, STABILITY_FILE, resume, read_stability, show.line, folders=(PICTURES_FOLDER,))
    if record is None:
        record = StabilityRecord(provenance(torch.device("cpu")), settings)
        write_stability(out / STABILITY_FILE, record)
    if record.settings != json.loads(json.dumps(settings)):
        raise InputError(f"--resume: {out} was made with other options; use the same or a new folder")
    return replace(record, cases=[one for one in record.cases if one.info.id in CASES], finished=False)
