"""How a question is measured: a catalogue of studies, and the one loop that runs them into `OUT/<shelf>.json`.

A study is a generator of findings and one entry in the catalogue of its shelf. A resumed run skips those in the file.
"""

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import msgspec

from harness.execution.progress import Progress
from harness.records.study import Answer, Check, Finding, Studies, StudyInfo, StudyRecord, read_studies, write_studies
from scenes.files.errors import DamagedRecord, InputError

if TYPE_CHECKING:
    import torch

    from harness.plan.run_plan import Machine

TRAININGS_FOLDER = "studies"
"""The folder under OUT in which the runs of studies that train lie."""
Found = Finding | str
"""What a study yields; a string becomes an `Answer`."""
Rows = list[list[str | float | None]]


@dataclass(frozen=True)
class Study:
    info: StudyInfo
    measure: str
    """The generator of findings, as `module:function` in the shelf's package; imported when it is measured."""
    seconds: float
    """The estimated duration on two cores."""
    trainings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Shelf:
    """A catalogue of studies, and how its record is kept."""

    name: str
    noun: str
    """The word for its studies: `studies`, `cases`, `questions`."""
    studies: dict[str, Study]
    folders: tuple[str, ...] = ()
    """The folders under OUT that only this shelf writes: OUT is known by them."""
    in_run_folder: bool = False
    """Whether OUT may also hold a run, whose report then includes the shelf."""
    replaces: bool = False
    """Whether an existing record is replaced unless it is resumed."""
    resumes: bool = True
    """Whether a stopped measurement can be resumed and reported."""
    package: str = ""
    """The package of its studies; empty: `harness.studies.<name>`."""

    @property
    def file(self) -> str:
        return f"{self.name}.json"

    def measure_of(self, name: str) -> Callable[[Any], Iterator[Found]]:
        """Import the generator of a study: heavy libraries are imported here, for one study at a time."""
        package = self.package or f"harness.studies.{self.name}"
        measure: Callable[[Any], Iterator[Found]] = resolve_name(f"{package}.{self.studies[name].measure}")
        return measure


def asking(name: str, title: str, question: str, method: str, measure: str, seconds: float, *trainings: str) -> Study:
    return Study(StudyInfo(name, title, question, method), measure, seconds, trainings)


def catalogue(*studies: Study) -> dict[str, Study]:
    return {study.info.id: study for study in studies}


@dataclass(frozen=True)
class StudyContext(ABC):
    """What the studies of every shelf need in one run; each shelf adds its own fields and settings."""

    out: Path
    view_sets: Path
    scratch: Path
    """A folder for temporary files; `run` replaces it with a fresh folder, removed afterwards."""
    quick: bool
    """Whether to use sizes at which no figure means anything, to try out the studies themselves."""
    show: Progress
    machine: "Machine"

    @property
    def device(self) -> "torch.device":
        import torch

        return torch.device(self.machine.device)

    @property
    def threads(self) -> int:
        return self.machine.threads

    @abstractmethod
    def settings(self) -> dict[str, object]:
        """Return all that the figures depend on except the machine, as JSON; records with others are not resumed."""

    def within(self, scratch: Path, missing: tuple[str, ...]) -> "StudyContext":
        return replace(self, scratch=scratch)

    def valid(self, record: Studies, shelf: Shelf, asked: list[str]) -> Studies:
        """Return a resumed record without the studies that have to be measured again."""
        return record

    def scale(self, study: Study) -> str:
        return ""

    def seconds(self, study: Study, asked: list[Study]) -> float:
        return study.seconds


def run(shelf: Shelf, asked: list[str], context: StudyContext, resume: bool) -> int:
    """Measure the studies `asked` into OUT; with `resume` only those that are not complete there.

    Returns 0, or 3 if a check of this harness fails. Raises `InputError` if OUT cannot be used.
    """
    from harness.machine.device import keep_freed_memory, use_threads
    from harness.machine.provenance import commit
    from harness.machine.stopping import ON, told_when_stopped
    from harness.run_folder.folder_lock import scratch_folder

    out, show = context.out, context.show
    use_threads(context.threads)
    keep_freed_memory()
    path = out / shelf.file
    record = _claimed(shelf, context, resume)

    def kept() -> str:
        complete = sum(study.info.id in asked for study in record.studies)
        then = f"; `python -m reports {out}` reports them; {ON} {out}" if shelf.resumes else f" in {path}"
        return f"{complete} of {len(asked)} {shelf.noun} are kept{then}"

    with told_when_stopped(kept), scratch_folder(out) as scratch:
        if resume:
            record = context.valid(record, shelf, asked)
            # written first: once a training is resumed, nothing shows that old figures came from other cells
            write_studies(path, record)
        missing = [shelf.studies[name] for name in asked if record.study(name) is None]
        here = context.within(scratch, tuple(study.info.id for study in missing))
        seconds = sum(context.seconds(study, [shelf.studies[name] for name in asked]) for study in missing)
        show.line(f"{shelf.name}: {len(missing)} {shelf.noun}, about {seconds / 60:.0f} min")
        for place, study in enumerate(missing):
            info = study.info
            show.line(f"[{place + 1}/{len(missing)}] {info.id}: {info.question or info.title}")
            began = time.monotonic()
            findings = measure(shelf.measure_of(info.id)(here), show)
            scale, measured_at = here.scale(study), commit()
            if measured_at != record.provenance.get("commit") and measured_at not in scale:
                scale = ". ".join(filter(None, (scale, f"Measured at commit {measured_at}")))
            entry = StudyRecord(with_bar(info, findings), scale, findings, time.monotonic() - began)
            studies = sorted([*record.studies, entry], key=lambda done: list(shelf.studies).index(done.info.id))
            record = msgspec.structs.replace(record, studies=studies)
            write_studies(path, record)
    record = msgspec.structs.replace(record, finished=True)
    write_studies(path, record)
    for study_record, check in record.broken:
        show.line(f"does not hold: {study_record.info.id}: {line_of(check)}")
    return 3 if record.broken else 0


def measure(findings: Iterable[Found], show: Progress) -> list[Finding]:
    """Return all findings of one study; answers and checks are printed as they come."""
    complete: list[Finding] = []
    for item in findings:
        finding = Answer(item) if isinstance(item, str) else item
        complete.append(finding)
        if isinstance(finding, Answer):
            show.line(f"  {finding.text}")
        elif isinstance(finding, Check):
            show.line(f"  {line_of(finding)}")
    return complete


def with_bar(info: StudyInfo, findings: list[Finding]) -> StudyInfo:
    """Return the facts about a study, with the limits that can fail a run as the fact `bar`."""
    bars = [
        f"{check.what} {limits_of(check)}{check.unit and f' {check.unit}'}"
        for check in findings
        if isinstance(check, Check) and check.must_hold and limits_of(check)
    ]
    if not info.facts or not bars:
        return info
    return msgspec.structs.replace(info, facts={**info.facts, "bar": "; ".join(dict.fromkeys(bars))})


def limits_of(check: Check) -> str:
    """Return `at least 0.5, at most 1e-06`; empty without limits."""
    ends = (("at least", check.low), ("at most", check.high))
    return ", ".join(f"{word} {end:.3g}" for word, end in ends if end is not None)


def line_of(check: Check) -> str:
    """Return a line such as `midpoint: pass: largest relative error 2.1e-07 (at most 1e-06)`."""
    status = check.status.replace("_", " ")
    if check.status == "fail":
        status = "FAIL" if check.must_hold else "missed" if check.owner == "machine" else "fails, by its definition"
    between = f" ({limits})" if (limits := limits_of(check)) else ""
    if check.value is not None:
        unit = check.unit and f" {check.unit}"
        spread = f" [{check.spread[0]:.3g}, {check.spread[1]:.3g}]" if check.spread else ""
        figure = f"{check.what} {check.value:.3g}{unit}{spread}{between}".strip()
    elif check.status in ("fail", "inconclusive"):
        figure = ", ".join(filter(None, (check.what, f"no figure{between}")))
    else:
        figure = check.what
    return ": ".join(filter(None, (check.subject, status, figure))) + (f"; {check.why}" if check.why else "")


def list_lines(shelf: Shelf) -> list[str]:
    lines = []
    for name, study in shelf.studies.items():
        asks = study.info.question or study.info.facts.get("danger", "")
        lines.append(f"{name:18} {study.seconds / 60:4.0f} min  " + ": ".join(filter(None, (study.info.title, asks))))
    return lines


def _claimed(shelf: Shelf, context: StudyContext, resume: bool) -> Studies:
    """Return the record to resume, or a fresh one. Raises `InputError`."""
    from harness.machine.provenance import provenance
    from harness.run_folder.integrity import quarantine
    from harness.run_folder.output_folder import resumable_record

    out, settings = context.out, json.loads(json.dumps(context.settings()))
    say = context.show.line
    if shelf.replaces and not resume:
        try:
            read_studies(out / shelf.file)
            (out / shelf.file).unlink()
        except DamagedRecord:
            quarantine(out, shelf.file)
    record = resumable_record(
        out, shelf.file, resume, read_studies, say, in_run_folder=shelf.in_run_folder, folders=shelf.folders
    )
    if record is None:
        record = Studies(shelf.name, provenance(context.device), settings)
        write_studies(out / shelf.file, record)
    if record.settings != settings:
        raise InputError(f"--resume: {out} was made with other options; use the same or a new folder")
    known = [study for study in record.studies if study.info.id in shelf.studies]
    return msgspec.structs.replace(record, studies=known, finished=False)
