"""A speed record → speed.html: how fast this machine is, in the same design as the report and as self-contained."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from harness.speed_record import SpeedRecord
from reports import shell, wording
from reports.grid import Grid
from reports.record_tables import tables_grids
from reports.script import content_policy
from reports.series_charts import Chart, charts
from reports.speed_load import is_quick
from reports.speed_tables import aims, headline, items, measurements_grid, question


@dataclass(frozen=True)
class Section:
    item: int
    title: str
    measurements: Grid | None
    charts: list[Chart]
    tables: list[Grid]


def speed_page(record: SpeedRecord, beside_report: bool = False) -> str:
    """The whole page as text; `beside_report` says that report.html lies in the same folder."""
    targets = aims(record)
    return (
        shell.environment()
        .get_template("speed_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "speed_page.css"),
            colours={},
            title=headline(targets),
            machine=machine(record.provenance),
            effort=effort(record),
            quick=is_quick(record),
            report=shell.RUN_PAGE if beside_report else "",
            aims=targets,
            sections=[section(record, item) for item in items(record)],
            provenance=provenance(record),
        )
    )


def section(record: SpeedRecord, item: int) -> Section:
    return Section(
        item,
        question(item),
        measurements_grid(record, item),
        charts(record.series, item, "speed"),
        tables_grids(record.tables, item, wording.figure),
    )


def machine(origin: dict[str, Any]) -> str:
    """`Measured on X with 2 cores and 2 threads, which multiply bfloat16 matrices fast.`"""
    words = f"Measured on {_known(origin, 'processor') or 'an unnamed processor'}"
    parts = [
        wording.counted(origin[name], noun)
        for name, noun in (("cores", "core"), ("threads", "thread"))
        if isinstance(origin.get(name), int)
    ]
    words += f" with {wording.listed(parts)}" if parts else ""
    device = _known(origin, "device")
    words += f", on its {device}" if device not in ("", "cpu") else ""
    has = origin.get("bfloat16_products")
    if isinstance(has, bool):
        words += f", {'with' if has else 'without'} units for bfloat16 matrix products"
    return f"{words}."


def effort(record: SpeedRecord) -> str:
    """`32 figures in 12 min 05 s.`"""
    measured = sum(one.value is not None for one in record.measurements)
    if not record.measurements:
        return "No figure was recorded."
    total = record.seconds.get("total")
    words = wording.counted(measured, "figure")
    lost = len(record.measurements) - measured
    words += f", {wording.count(lost)} more could not be measured" if lost else ""
    return f"{words}; the run took {wording.duration(total)}." if total is not None else f"{words}."


def _known(origin: dict[str, Any], name: str) -> str:
    value = origin.get(name)
    return value if isinstance(value, str) else ""


def provenance(record: SpeedRecord) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of name and value: how to get the same again, and how long that takes."""
    spent = [(_named(name), wording.duration(seconds)) for name, seconds in record.seconds.items()]
    return shell.groups_of(record.provenance, record.settings, spent)


def _named(key: str) -> str:
    """Seconds are kept by a question's number."""
    return question(int(key)) if key.isascii() and key.isdecimal() else key


def write_speed_page(record: SpeedRecord, path: Path, beside_report: bool = False) -> None:
    shell.write_whole(speed_page(record, beside_report), path)
