"""Gates → figures → outcomes → `gate.json`, `junit.xml`, pictures of what failed; or measurements → new limits."""

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from harness.device import available_cores, keep_freed_memory, use_threads
from harness.gate import fairness, images, speed, training
from harness.gate.catalog import FALSE_ALARM, IMAGE_SCENES, KINDS, Gate, Kind, gates, settings_of
from harness.gate.junit import write_junit
from harness.gate.limits import EXACT
from harness.gate.limits_file import KindFacts, LimitsFile, changes, read_limits, source_of, write_limits
from harness.gate.outcome import Outcome, Pictures, Sample, judged, line_of
from harness.gate.situation import Measure, Renew, Situation
from harness.json_record import write_json
from harness.progress import Progress
from harness.provenance import provenance
from harness.soundness import sweep
from scenes.errors import InputError
from scenes.images import write_png

GATE_FILE = "gate.json"
JUNIT_FILE = "junit.xml"
ENLARGED = 6
"""Pixels of a picture along each side of one of the image's."""

MEASURES: dict[Kind, Measure] = {
    "training": training.measure,
    "images": images.measure,
    "fairness": fairness.measure,
    "speed": speed.measure,
}
INPUTS: dict[Kind, Callable[[Situation, tuple[Gate, ...]], object]] = {"images": images.references_for}
"""What is read from files: read before anything is measured, so that a damaged one costs no measurements."""
RENEWALS: dict[Kind, Renew] = {"training": training.renew, "images": images.renew, "speed": speed.renew}


def run(chosen: tuple[Gate, ...], limits_file: Path, out: Path, view_sets: Path, show: Progress, replay: str) -> int:
    """Measures and judges; 0, or 4 where a gate failed. `replay` is the command that a failing gate's name is added to.

    Raises `InputError` before anything is measured where the limits or the stored images cannot be read.
    """
    began = time.monotonic()
    limits = read_limits(limits_file)
    situation = _situation(out, limits, limits_file, view_sets, show)
    family = len(gates())
    show.line(f"{len(chosen)} of {family} gates, together at most {FALSE_ALARM:.0%} false alarms")
    outcomes: list[Outcome] = []
    seconds: dict[str, float] = {}
    asked = {kind: of_kind for kind in KINDS if (of_kind := tuple(gate for gate in chosen if gate.kind == kind))}
    for kind in INPUTS.keys() & asked.keys():
        INPUTS[kind](situation, asked[kind])
    for kind, of_kind in asked.items():
        started = time.monotonic()
        found = _measured(kind, situation, of_kind)
        seconds[kind] = time.monotonic() - started
        outcomes += [judged(gate, found.get(gate.name), *limits.limit_of(gate, family)) for gate in of_kind]
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
    write_json(out / GATE_FILE, _record(outcomes, seconds, commands))
    write_junit(out / JUNIT_FILE, outcomes, seconds, commands)
    show.line(
        f"{len(outcomes) - len(failed)} passed, {len(failed)} failed in {seconds['total']:.0f} s; "
        f"{out / GATE_FILE}, {out / JUNIT_FILE}"
    )
    return 4 if failed else 0


def _measured(kind: Kind, situation: Situation, of_kind: tuple[Gate, ...]) -> Mapping[str, Sample]:
    """An error of ours in one kind costs its gates, not the others'."""
    try:
        return MEASURES[kind](situation, of_kind)
    except (InputError, OSError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        return {gate.name: Sample([], why) for gate in of_kind}


def renew(chosen: tuple[Gate, ...], limits_file: Path, out: Path, view_sets: Path, show: Progress) -> int:
    """Measures anew what limits of the chosen gates are made of, and writes them; prints old → new.

    A kind is renewed as a whole, so that its limits have one origin.
    """
    before = read_limits(limits_file) if limits_file.exists() else LimitsFile()
    after = before
    table = gates()
    for kind in RENEWALS:
        if not any(source_of(gate) == kind and gate.rule not in EXACT for gate in chosen):
            continue
        of_kind = tuple(gate for gate in table if source_of(gate) == kind and gate.rule not in EXACT)
        started = time.monotonic()
        situation = _situation(out, after, limits_file, view_sets, show)
        values = RENEWALS[kind](situation, of_kind)
        facts = KindFacts(
            settings_of(kind),
            provenance(torch.device("cpu")),
            round(time.monotonic() - started, 1),
            {f"{scene}.exr": images.digest(situation.images / f"{scene}.exr") for scene in IMAGE_SCENES}
            if kind == "images"
            else {},
        )
        after = after.renewed(kind, values, facts, table)
        write_limits(limits_file, after, len(table))
        show.line(f"{kind}: limits of {len(of_kind)} gates renewed")
    changed = changes(before, after)
    for line in changed:
        show.line(line)
    show.line(f"{len(changed)} limits changed; review {limits_file} before it is committed")
    return 0


def _situation(out: Path, limits: LimitsFile, limits_file: Path, view_sets: Path, show: Progress) -> Situation:
    use_threads(1)
    keep_freed_memory()
    return Situation(out, limits, limits_file.parent / "images", view_sets, available_cores(), show)


def _leave(pictures: Pictures | None, folder: Path) -> Path | None:
    """Image, reference and difference as PNG, enlarged."""
    if pictures is None:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    for name, pixels in asdict(pictures).items():
        enlarged = np.repeat(np.repeat(pixels, ENLARGED, axis=0), ENLARGED, axis=1)
        opaque = np.ones((*enlarged.shape[:2], 1))
        write_png(folder / f"{name}.png", np.concatenate([np.clip(enlarged, 0.0, 1.0), opaque], axis=-1))
    return folder


def _record(outcomes: Sequence[Outcome], seconds: Mapping[str, float], commands: Mapping[str, str]) -> dict[str, Any]:
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
        "schema": 1,
        "false_alarm": FALSE_ALARM,
        "family": len(gates()),
        "seconds": dict(seconds),
        "provenance": provenance(torch.device("cpu")),
        "gates": rows,
    }


def cleared(out: Path) -> None:
    """Removes what takes room and is not looked at again."""
    shutil.rmtree(out / "renders", ignore_errors=True)
    sweep(out)
