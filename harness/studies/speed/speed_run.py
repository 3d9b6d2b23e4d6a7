"""Question after question → `speed.json`, written whenever something has been measured."""

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from harness.execution.progress import Progress
from harness.machine.device import available_cores, keep_freed_memory, use_threads
from harness.machine.provenance import provenance
from harness.machine.stopping import ON, told_when_stopped
from harness.records.charts import Series, Table
from harness.records.speed_record import QUESTIONS, Measurement, SpeedRecord, read_speed, write_speed
from harness.run_folder.folder_lock import scratch_folder
from harness.run_folder.output_folder import gone_on_with
from harness.studies.speed import (
    accelerations,
    growth,
    kernels,
    matrix_rate,
    memory,
    processes,
    throughput,
    time_to_target,
)
from harness.studies.speed.speed_context import SpeedContext, paper_settings, reduced_plan
from scenes.files.errors import InputError

Finding = Measurement | Series | Table
MEASURES: dict[int, Callable[[SpeedContext], Iterator[Finding]]] = {
    1: throughput.measure,
    2: matrix_rate.measure,
    3: time_to_target.measure,
    4: kernels.rendering,
    5: kernels.encodings,
    6: kernels.quadrature,
    7: kernels.ground_truth,
    8: memory.measure,
    9: growth.measure,
    10: processes.measure,
    11: accelerations.measure,
}
SECONDS = {1: 50, 2: 60, 4: 60, 5: 25, 6: 15, 7: 80, 8: 130, 9: 110, 10: 80, 11: 60}
"""Estimated, on two cores; question 3 depends on its option."""
QUICK_SECONDS = 4
VIEW_SET_SECONDS = 120
"""Rendering the three scenes, where they are not in the cache."""


SPEED_FILE = "speed.json"


def speed_file(out: Path) -> Path:
    return out / SPEED_FILE


def run(
    items: list[int],
    out: Path,
    device: torch.device,
    view_sets: Path,
    plain_seconds: float,
    quick: bool,
    resume: bool,
    show: Progress,
) -> None:
    """Measure what `items` ask for into `out`; with `resume` only what is not there yet.

    Raises `InputError` before anything is measured where `out` cannot be used.
    """
    # sizes of `quick` gain nothing from threads, which wait for each other on a machine that does something else
    threads = 1 if quick else available_cores()
    use_threads(threads)
    keep_freed_memory()
    record = gone_on_with(out, SPEED_FILE, resume, read_speed, show.line)

    def kept() -> str:
        whole = sum(str(item) in record.seconds for item in items) if record else 0
        return f"{whole} of {len(items)} questions are kept; `python -m reports {out}` reports them; {ON} {out}"

    with told_when_stopped(kept), scratch_folder(out) as scratch:
        situation = SpeedContext(device, threads, quick, plain_seconds, view_sets, scratch, show)
        fresh = SpeedRecord(provenance(device), settings_of(situation))
        if record is None:
            record = fresh
        elif record.settings != json.loads(json.dumps(fresh.settings)):
            raise InputError(f"--resume: {out} was measured with other options; use the same or a new folder")
        missing = [item for item in items if str(item) not in record.seconds]
        # what a question left behind that was stopped in the middle is measured again, all of it
        record = without_items(record, missing)
        write_speed(speed_file(out), record)
        for line in plan_lines(missing, situation):
            show.line(line)
        for item in missing:
            record = _answered(item, record, situation, out)


def _answered(item: int, record: SpeedRecord, situation: SpeedContext, out: Path) -> SpeedRecord:
    situation.show.line(f"{item}. {QUESTIONS[item]}")
    began = time.monotonic()
    for finding in MEASURES[item](situation):
        record = with_finding(record, finding)
        write_speed(speed_file(out), record)
        if isinstance(finding, Measurement):
            situation.show.line(f"  {line_of(finding)}")
    seconds = {**record.seconds, str(item): time.monotonic() - began}
    seconds["total"] = sum(value for name, value in seconds.items() if name != "total")
    record = replace(record, seconds=seconds)
    write_speed(speed_file(out), record)
    return record


def with_finding(record: SpeedRecord, finding: Finding) -> SpeedRecord:
    if isinstance(finding, Measurement):
        return replace(record, measurements=[*record.measurements, finding])
    if isinstance(finding, Series):
        return replace(record, series=[*record.series, finding])
    return replace(record, tables=[*record.tables, finding])


def without_items(record: SpeedRecord, items: list[int]) -> SpeedRecord:
    """The record as it was before these questions were asked."""
    return replace(
        record,
        measurements=[one for one in record.measurements if one.item not in items],
        series=[one for one in record.series if one.item not in items],
        tables=[one for one in record.tables if one.item not in items],
    )


def settings_of(situation: SpeedContext) -> dict[str, Any]:
    """Everything that the figures depend on, as JSON."""
    plan = reduced_plan(situation)
    return {
        "quick": situation.quick,
        "publishable": not situation.quick,
        "device": situation.device.type,
        "threads": situation.threads,
        "precision": situation.precision,
        "matrix_units": situation.matrix_units,
        "plain_seconds": situation.plain_seconds,
        "test_pixels": time_to_target.TEST_PIXELS,
        "paper": asdict(paper_settings(situation)),
        "same_network": asdict(time_to_target.same_network(situation, plan)),
        "reduced": {"train": asdict(plan.train), "views": asdict(plan.views), "budget": asdict(plan.budget)},
    }


def plan_lines(items: list[int], situation: SpeedContext) -> list[str]:
    """What is going to be measured, and how long it takes."""
    costs = {item: estimated_seconds(item, situation) for item in items}
    total = sum(costs.values())
    more = "" if situation.quick else f", and up to {VIEW_SET_SECONDS} s if view sets are not in the cache"
    return [
        f"speed of {situation.device.type}, {situation.threads} threads, {situation.precision} products; "
        f"about {total / 60:.0f} min{more}",
        *(f"  {item:2d}. {QUESTIONS[item]}: about {cost:.0f} s" for item, cost in costs.items()),
    ]


def estimated_seconds(item: int, situation: SpeedContext) -> float:
    if situation.quick:
        return QUICK_SECONDS
    if item == 3:
        # each scene: plain, then the others on their own clocks, and evaluation off the clock
        return len(time_to_target.SCENES) * (1.15 * situation.plain_seconds + 100)
    return SECONDS[item]


def line_of(one: Measurement) -> str:
    """One figure for the terminal."""
    if one.value is None:
        return f"{one.title}: not measured, {one.detail}"
    spread = f" [{one.low:.3g}, {one.high:.3g}]" if one.low is not None and one.high is not None else ""
    sense = "≥" if one.sense == "at_least" else "≤"
    goal = f"; target {sense} {one.target:g}: {'met' if one.met else 'MISSED'}" if one.target is not None else ""
    return f"{one.title}: {one.value:.3g} {one.unit}{spread}{goal}"
