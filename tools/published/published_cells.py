"""The cells of a published summary.json as records, so that the functions that judge runs also judge published runs."""

from msgspec.structs import replace

from harness.records.cells import CellRecord, Checkpoint, empty_cell
from harness.records.json_record import as_promised
from harness.records.metric_table import PRIMARY
from harness.verdicts.changes import Condition
from harness.verdicts.headline_family import headline_budgets
from scenes.files.json_object import JsonObject

Run = JsonObject
"""The content of a published JSON file other than a record of studies."""


def cells_of(run: Run, methods: list[str]) -> list[CellRecord]:
    return [_cell(row) for row in run["cells"] if row["method"] in methods]


def condition_of(run: Run, methods: list[str], equal_time: bool = False) -> Condition:
    """Return the cells at equal steps, or at equal core seconds (training seconds if those were not counted)."""
    budgets = headline_budgets([row["budget"] for row in run["comparisons"]])
    return Condition(cells_of(run, methods), budgets[equal_time])


def _cell(row: Run) -> CellRecord:
    named = empty_cell(row["scene"], row["method"], row["seed"], row["status"], row["reason"] or "")
    return replace(
        named,
        steps=row["steps"],
        train_seconds=row["train_seconds"],
        train_core_seconds=row["train_core_seconds"],
        scores={PRIMARY: row[PRIMARY]},
        curve=_curve(row["curve"]),
        warnings=row["warnings"],
    )


def _curve(columns: Run) -> list[Checkpoint]:
    names = [name for name in ("seconds", "core_seconds", "network_evaluations", PRIMARY) if name in columns]
    rows = zip(columns["steps"], *(columns[name] for name in names), strict=True)
    points = [{"step": step, **dict(zip(names, values, strict=True))} for step, *values in rows]
    return as_promised(points, list[Checkpoint])
