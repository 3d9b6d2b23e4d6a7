"""Gates → figures → outcomes → `gate.json`, `junit.xml`, pictures of what failed; or measurements → new limits."""

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from harness.execution.progress import Progress
from harness.gate import early, fairness, gate_speed, images, worse
from harness.gate.gates import IMAGE_SCENES, KINDS, Gate, Kind, gates, settings_of
from harness.gate.limits import NONE_DIFFERS, KindFacts, Limit, LimitsFile, changes, read_limits, write_limits
from harness.gate.outcome import GateContext, GateOutcome, Measure, Pictures, Sample, judged, line_of, write_junit
from harness.gate.process import class_here, classes_here, forced
from harness.gate.references import References, read_references, references_file, references_for, write_references
from harness.machine.device import available_cores, keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.records.json_record import write_json
from harness.run_folder.integrity import sweep
from scenes.files.errors import InputError
from scenes.view_sets.images import write_png

GATE_FILE = "gate.json"
JUNIT_FILE = "junit.xml"
ENLARGED = 6
"""The pixels of a picture along each side of one of the image's."""

MEASURES: dict[Kind, Measure] = {
    "changed": early.measure,
    "worse": worse.measure,
    "images": images.measure,
    "fairness": fairness.measure,
    "speed": gate_speed.measure,
}
INPUTS: dict[Kind, Callable[[GateContext, tuple[Gate, ...]], object]] = {"images": images.references_for}
"""The inputs read from files before anything is measured, so that a damaged one costs no measurements."""
RENEWALS: dict[Kind, Callable[[GateContext], References]] = {
    "changed": early.renew,
    "worse": worse.renew,
    "speed": gate_speed.renew,
}
"""The renewals that depend on the class of processor; images do not."""
CLASSES = "classes"
RENEWED_CLASSES = ("avx2", "avx512")


def run(
    chosen: tuple[Gate, ...],
    limits_file: Path,
    out: Path,
    view_sets: Path,
    show: Progress,
    replay: str,
    of_class: str | None = None,
) -> int:
    """Measure and judge; returns 0, or 4 if a gate failed. `replay` is the command that a failing gate's name is added
    to.

    Raises `InputError` before anything is measured if limits, references or stored images cannot be read.
    """
    began = time.monotonic()
    limits = read_limits(limits_file)
    name = of_class or class_here()
    references = references_for(limits_file.parent / CLASSES, name)
    situation = _situation(out, limits, references, limits_file, view_sets, show)
    show.line(f"{len(chosen)} of {len(gates())} gates, {class_line(name, references)}")
    outcomes: list[GateOutcome] = []
    seconds: dict[str, float] = {}
    asked = {kind: of_kind for kind in KINDS if (of_kind := tuple(gate for gate in chosen if gate.kind == kind))}
    for kind in INPUTS.keys() & asked.keys():
        INPUTS[kind](situation, asked[kind])
    with forced(name):
        for kind, of_kind in asked.items():
            started = time.monotonic()
            found = _measured(kind, situation, of_kind)
            seconds[kind] = time.monotonic() - started
            outcomes += [judged(gate, found.get(gate.name), *_limit(gate, limits, references)) for gate in of_kind]
    failed = [one for one in outcomes if one.status == "fail"]
    commands = {one.gate.name: f"replay: {replay} --only {one.gate.name}" for one in failed}
    for one in outcomes:
        show.line(line_of(one))
        if one.status == "fail":
            show.line(f"      {one.gate.what}")
            left = _leave(one.pictures, out / "failed" / one.gate.name)
            show.line(f"      pictures: {left}" if left else "      no pictures: it is about no image")
            show.line(f"      {commands[one.gate.name]}")
    seconds["total"] = time.monotonic() - began
    answers = answers_of(outcomes)
    write_json(out / GATE_FILE, _record(outcomes, seconds, commands, name, references, answers))
    write_junit(out / JUNIT_FILE, outcomes, seconds, commands)
    for question, answer in answers.items():
        show.line(f"{question} {answer}")
    show.line(
        f"{len(outcomes) - len(failed)} passed, {len(failed)} failed in {seconds['total']:.0f} s; "
        f"{out / GATE_FILE}, {out / JUNIT_FILE}"
    )
    return 4 if failed else 0


def class_line(name: str, references: References) -> str:
    """Return which class of processor is compared with which references."""
    if references.known:
        return f"processor of class {name}"
    return (
        f"processor of class {name}, of which nothing is stored: held to {references.name} with wider limits; "
        f"`python -m harness gate --renew --class {name}` makes its own"
    )


def answers_of(outcomes: Sequence[GateOutcome]) -> dict[str, str]:
    """Return the answers to the two questions about training, as far as they were asked."""
    found = {}
    changed = [one for one in outcomes if one.gate.kind == "changed"]
    if changed:
        failed = [one.gate.name for one in changed if one.status == "fail"]
        found["Has anything changed?"] = f"yes: {', '.join(failed)}" if failed else "no more than the order of sums"
    for one in outcomes:
        if one.gate.name == "worse.all.psnr":
            found["Is it worse?"] = one.why or "there is no answer"
    return found


def _limit(gate: Gate, limits: LimitsFile, references: References) -> tuple[Limit | None, str]:
    if gate.kind == "fairness":
        return NONE_DIFFERS, ""
    if gate.kind == "images":
        return limits.limit_of(gate)
    missing = references.missing(gate)
    return (None, missing) if missing or gate.rule != "none_differs" else (NONE_DIFFERS, "")


def _measured(kind: Kind, situation: GateContext, of_kind: tuple[Gate, ...]) -> Mapping[str, Sample]:
    """Measure each kind; an error of ours in one costs its gates, not the others'."""
    missing = situation.references.missing(of_kind[0]) if kind in RENEWALS else ""
    if missing:
        return {}
    try:
        return MEASURES[kind](situation, of_kind)
    except (InputError, OSError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        return {gate.name: Sample([], why) for gate in of_kind}


def renew(
    chosen: tuple[Gate, ...],
    limits_file: Path,
    out: Path,
    view_sets: Path,
    show: Progress,
    of_class: str | None = None,
) -> int:
    """Measure anew the reference values of chosen gates, and write them; prints old → new for limits of images.

    A kind is renewed completely, so that its limits have one origin; without `of_class` for the usual classes that this
    machine can be, with it for that one and without what does not depend on it.
    """
    before = read_limits(limits_file) if limits_file.exists() else LimitsFile()
    kinds = {gate.kind for gate in chosen}
    folder = limits_file.parent / CLASSES
    names = (of_class,) if of_class else tuple(name for name in RENEWED_CLASSES if name in classes_here())
    for name in names or (class_here(),):
        references = read_references(folder, name) if references_file(folder, name).exists() else References(name)
        for kind in (kind for kind in RENEWALS if kind in kinds):
            started = time.monotonic()
            with forced(name):
                situation = _situation(out, before, references, limits_file, view_sets, show)
                references = RENEWALS[kind](situation)
            facts = _facts(kind, started)
            references = replace(references, kinds={**references.kinds, kind: facts})
            write_references(folder, references)
            show.line(f"{kind}: references of class {name} renewed in {facts.seconds:.0f} s")
    if "images" not in kinds or of_class:
        return 0
    started = time.monotonic()
    situation = _situation(out, before, References(""), limits_file, view_sets, show)
    values = images.renew(situation)
    facts = replace(
        _facts("images", started),
        files={f"{scene}.exr": images.digest(situation.images / f"{scene}.exr") for scene in IMAGE_SCENES},
    )
    after = before.renewed("images", values, facts, gates())
    write_limits(limits_file, after)
    changed = changes(before, after)
    for line in changed:
        show.line(line)
    show.line(f"{len(changed)} limits changed; review {limits_file} before it is committed")
    return 0


def _facts(kind: Kind, started: float) -> KindFacts:
    return KindFacts(settings_of(kind), provenance(torch.device("cpu")), round(time.monotonic() - started, 1))


def _situation(
    out: Path, limits: LimitsFile, references: References, limits_file: Path, view_sets: Path, show: Progress
) -> GateContext:
    use_threads(1)
    keep_freed_memory()
    return GateContext(out, limits, references, limits_file.parent / "images", view_sets, available_cores(), show)


def _leave(pictures: Pictures | None, folder: Path) -> Path | None:
    """Write image, reference and difference as PNG, enlarged."""
    if pictures is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    for name, pixels in asdict(pictures).items():
        enlarged = np.repeat(np.repeat(pixels, ENLARGED, axis=0), ENLARGED, axis=1)
        opaque = np.ones((*enlarged.shape[:2], 1))
        write_png(folder / f"{name}.png", np.concatenate([np.clip(enlarged, 0.0, 1.0), opaque], axis=-1))
    return folder


def _record(
    outcomes: Sequence[GateOutcome],
    seconds: Mapping[str, float],
    commands: Mapping[str, str],
    name: str,
    references: References,
    answers: Mapping[str, str],
) -> dict[str, Any]:
    rows = []
    for one in outcomes:
        limit = one.limit
        rows.append(
            {
                "name": one.gate.name,
                "kind": one.gate.kind,
                "what": one.gate.what,
                "unit": one.gate.unit,
                "status": one.status,
                "measured": one.figure,
                "low": limit.low if limit else None,
                "high": limit.high if limit else None,
                "excess": one.excess,
                "detects": limit.detects if limit else None,
                "why": one.why,
                "replay": commands.get(one.gate.name, ""),
            }
        )
    return {
        "schema": 2,
        "class": name,
        "references": references.name,
        "answers": dict(answers),
        "seconds": dict(seconds),
        "provenance": provenance(torch.device("cpu")),
        "gates": rows,
    }


def cleared(out: Path) -> None:
    """Remove large files that are not needed again."""
    shutil.rmtree(out / "renders", ignore_errors=True)
    sweep(out)
