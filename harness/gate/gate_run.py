"""Gates → figures → checks → `gate.json`, `junit.xml`, pictures of failures; or measurements → new limits."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import torch
from msgspec import structs

from harness.execution.progress import Progress
from harness.gate import early, gate_families, gate_speed, images
from harness.gate.gate_context import GateContext
from harness.gate.gates import IMAGE_SCENES, KINDS, Gate, Kind, gates, settings_of
from harness.gate.limits import KindFacts, LimitsFile, changes, read_stored, write_stored
from harness.gate.quality import worse
from harness.gate.references import REFERENCES_FILE, Quotients, References
from harness.machine.device import available_cores, keep_freed_memory, use_threads
from harness.machine.processor_class import class_here
from harness.machine.provenance import committed, provenance
from harness.machine.stopping import in_child
from harness.plan.run_plan import Machine
from harness.records.study import Studies, StudyInfo, read_studies
from harness.run_folder.folder_lock import scratch_folder
from harness.studies import framework
from harness.studies.framework import Shelf, Study
from scenes.files.atomic import write_atomically
from scenes.files.digest import file_digest

JUNIT_FILE = "junit.xml"
CPU = torch.device("cpu")
TITLES: dict[Kind, tuple[str, str, float]] = {
    "changed": ("The first steps of training, compared with the stored ones", "early", 30),
    "worse": ("Short trainings, compared with the stored ones of the same seeds", "quality.worse", 90),
    "families": ("Short trainings of the other families, compared with other seeds", "gate_families", 40),
    "images": ("Renders, compared with the stored mean and variance", "images", 30),
    "fairness": ("Copies of a method, and shared weights and batches", "fairness", 15),
    "speed": ("Seconds, relative to plain code", "gate_speed", 30),
}
"""Kind → its title, its module, and the seconds that it takes."""
SHELF = Shelf(
    "gate",
    "kinds of gates",
    {kind: Study(StudyInfo(kind, title), f"{module}:measure", took) for kind, (title, module, took) in TITLES.items()},
    package="harness.gate",
    resumes=False,
)
RENEWALS: dict[Kind, Callable[[GateContext], References]] = {"changed": early.renew, "worse": worse.renew}
"""The renewals of references, without speed's, which belong to a class of processors."""
RENEWED_LIMITS: dict[Kind, Callable[[GateContext], dict[str, list[float]]]] = {
    "images": images.renew,
    "families": gate_families.renew,
}


def context_for(
    chosen: tuple[Gate, ...], limits_file: Path, out: Path, view_sets: Path, show: Progress, renewing: bool
) -> GateContext:
    """Return the context; raises `InputError` for unreadable stored files, and for a renewal by uncommitted code."""
    if renewing:
        committed()
    limits = LimitsFile() if renewing and not limits_file.exists() else read_stored(limits_file, LimitsFile)
    file = limits_file.parent / REFERENCES_FILE
    references = References() if renewing and not file.exists() else read_stored(file, References)
    context = GateContext(
        out, view_sets, out, False, show, Machine("cpu", available_cores(), 1),
        chosen, limits, references, limits_file, cache(lambda: in_child(early.courses)),
    )  # fmt: skip
    if not renewing:
        images.references_for(context)
    return context


def run(context: GateContext, replay: str) -> int:
    """Measure and judge; return 0, or 4 if a gate failed. The command `replay` repeats a gate by its name."""
    began = time.monotonic()
    out, show = context.out, context.show
    show.line(f"{len(context.gates)} of {len(gates())} gates, processor of class {class_here()}")
    kinds: list[str] = [kind for kind in KINDS if context.of_kind(kind)]
    framework.run(SHELF, kinds, context, resume=False)
    record = read_studies(out / SHELF.file)
    write_junit(out / JUNIT_FILE, record, replay)
    for _, check in record.broken:
        show.line(f"replay: {replay} --only {check.id}")
    failed, missing = len(record.broken), sum(check.status == "not_available" for _, check in record.checks())
    counts = f"{len(context.gates) - failed - missing} passed, {failed} failed"
    counts += f", {missing} not available here" if missing else ""
    show.line(f"{counts} in {time.monotonic() - began:.0f} s; {out / SHELF.file}, {out / JUNIT_FILE}")
    return 4 if failed else 0


def write_junit(file: Path, record: Studies, replay: str) -> None:
    """Write a suite per kind and a test case per gate, which share the time of their kind evenly."""
    top = ElementTree.Element(
        "testsuites", tests=str(len(list(record.checks()))), failures=str(len(record.broken)), errors="0"
    )
    for study in record.studies:
        name, checks = f"gate.{study.info.id}", study.checks
        failed = sum(check.is_broken for check in checks)
        missing = sum(check.status == "not_available" for check in checks)
        counts = {"tests": str(len(checks)), "failures": str(failed), "skipped": str(missing), "errors": "0"}
        suite = ElementTree.SubElement(top, "testsuite", {"name": name, **counts, "time": f"{study.seconds:.3f}"})
        for check in checks:
            share = f"{study.seconds / len(checks):.3f}"
            case = ElementTree.SubElement(suite, "testcase", classname=name, name=check.id, time=share)
            if check.is_broken:
                failure = ElementTree.SubElement(case, "failure", type="gate", message=framework.line_of(check))
                failure.text = f"replay: {replay} --only {check.id}\n"
            elif check.status == "not_available":
                ElementTree.SubElement(case, "skipped", message=check.why)
    ElementTree.indent(top)
    write_atomically(file, ElementTree.tostring(top, encoding="utf-8", xml_declaration=True))


def renew(context: GateContext) -> int:
    """Measure the kinds of the chosen gates again, each completely, and write them; print old → new for limits."""
    use_threads(1)
    keep_freed_memory()
    with scratch_folder(context.out) as scratch:
        context = replace(context, scratch=scratch)
        for kind in KINDS:
            if context.of_kind(kind):
                started = time.monotonic()
                context = _renewed(context, kind)
                context.show.line(f"{kind}: renewed in {time.monotonic() - started:.0f} s")
    return 0


def _renewed(context: GateContext, kind: Kind) -> GateContext:
    started, references, limits = time.monotonic(), context.references, context.limits

    def facts() -> KindFacts:
        origin = {**provenance(CPU), "commit": committed()}
        return KindFacts(settings_of(kind), origin, round(time.monotonic() - started, 1))

    if kind in RENEWED_LIMITS:
        values = RENEWED_LIMITS[kind](context)
        names = [f"{scene}.exr" for scene in IMAGE_SCENES] if kind == "images" else []
        files = {name: file_digest(context.images / name) for name in names}
        renewed = limits.renewed(kind, values, structs.replace(facts(), files=files))
        write_stored(context.limits_file, renewed)
        changed = changes(limits, renewed)
        for line in (*changed, f"{kind}: {len(changed)} limits changed; review {context.limits_file}"):
            context.show.line(line)
        return replace(context, limits=renewed)
    if kind == "speed":
        quotients = gate_speed.renew(context)
        references = structs.replace(
            references, speed={**references.speed, class_here(): Quotients(facts(), quotients)}
        )
    elif kind in RENEWALS:
        references = RENEWALS[kind](context)
        references = structs.replace(references, kinds={**references.kinds, kind: facts()})
    else:
        return context
    write_stored(context.limits_file.parent / REFERENCES_FILE, references)
    return replace(context, references=references)
