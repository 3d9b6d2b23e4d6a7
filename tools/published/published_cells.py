"""The cells of a published summary.json as records, so that the functions that judge runs also judge published runs."""

from msgspec.structs import replace

from harness.records.cells import CellRecord, Checkpoint, empty_cell
from harness.records.json_record import as_promised, plain
from harness.records.metric_table import PRIMARY
from harness.verdicts.changes import Condition
from harness.verdicts.claim_files import usual_roles
from harness.verdicts.comparisons import compare
from harness.verdicts.headline_family import SENSES, headline_budgets
from scenes.files.json_object import JsonObject

Run = JsonObject
"""The content of a published JSON file other than a record of studies."""


def judged_again(run: Run) -> Run:
    """Return the summary with its comparisons of PSNR judged again from its cells by the present functions.

    A summary was judged by the version that published it. If it has p-values, that version judged like this one, and
    the summary is returned unchanged. Comparisons by other metrics are kept.
    """
    estimates = (row[sense] for row in run["comparisons"] for sense in SENSES)
    if any("p" in known for known in estimates if known):
        return run
    guests = {cell["method"] for cell in run["cells"]} - {row["method"] for row in run["comparisons"]}
    guests -= {row["against"] for row in run["comparisons"]}
    methods = [method for method in run["methods"] if method not in guests]
    rows = [plain(row) for row in compare(cells_of(run, methods), methods, usual_roles()) if row.metric == PRIMARY]
    return run | {"comparisons": rows + [row for row in run["comparisons"] if row["metric"] != PRIMARY]}


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
        train_core_seconds=row.get("train_core_seconds"),
        scores={PRIMARY: row[PRIMARY]},
        curve=_curve(row["curve"]),
        warnings=row.get("warnings", []),
    )


def _curve(columns: Run) -> list[Checkpoint]:
    names = [name for name in ("seconds", "core_seconds", "network_evaluations", PRIMARY) if name in columns]
    rows = zip(columns["steps"], *(columns[name] for name in names), strict=True)
    points = [{"step": step, **dict(zip(names, values, strict=True))} for step, *values in rows]
    return as_promised(points, list[Checkpoint])
