"""The published records of studies, each with pictures of the most important panels of its page."""

from collections.abc import Callable
from pathlib import Path

from msgspec.structs import replace

from harness.records.study import SHELVES, Series, Studies, write_studies
from reports.drawing.series_charts import panels_of
from reports.drawing.sheet import Drawing, key_of, key_of_pens, save_sheet
from reports.studies.forest import forests
from reports.studies.matrix import miniature
from reports.studies.study_page import of_interest

LARGEST = 1_000_000
"""The maximum size in bytes of a published record; a larger record loses its lines."""
CHAPTERS_DRAWN = (1, 2, 3, 9)
"""Rounding, truncation, gradients, ladders: the first chart of each is drawn."""


def write_published(record: Studies, folder: Path) -> None:
    """Write the record, and PNGs of the panels that it has."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / SHELVES[record.shelf]
    write_studies(path, record)
    if path.stat().st_size > LARGEST:
        write_studies(path, without(record, Series))
    for name, choose, across in PICTURES[record.shelf]:
        save_sheet(folder / name, choose(record), across)


def without(record: Studies, kind: type) -> Studies:
    studies = [
        replace(study, findings=[finding for finding in study.findings if not isinstance(finding, kind)])
        for study in record.studies
    ]
    return replace(record, studies=studies)


def charts_of(series: list[Series]) -> list[Drawing]:
    return [(panel, key_of_pens(pens)) for panel, pens in panels_of(series)]


def charts_of_study(record: Studies, name: str) -> list[Drawing]:
    study = record.study(name)
    return charts_of(study.series) if study else []


def first_charts(record: Studies) -> list[Drawing]:
    series = [line for study in record.studies for line in study.series]
    return [
        drawing for item in CHAPTERS_DRAWN for drawing in charts_of([line for line in series if line.item == item])[:1]
    ]


def effects_of_parts(record: Studies) -> list[Drawing]:
    study = record.study("factorial")
    effects = [effect for effect in study.effects if not effect.against] if study else []
    panels = forests(effects, of_interest(record))
    return [(panels[key], key_of(panels[key])) for key in panels if (key[0], key[2]) == ("psnr", "all")]


PICTURES: dict[str, list[tuple[str, Callable[[Studies], list[Drawing]], int]]] = {
    "evidence": [
        ("evidence_effects.png", effects_of_parts, 1),
        ("bandwidth.png", lambda record: charts_of_study(record, "bandwidth")[:1], 1),
    ],
    "stability": [
        ("stability.png", lambda record: [(small, key_of(small)) for small in miniature(record)], 1),
        ("stability_curves.png", first_charts, 2),
    ],
    "speed": [],
    "frontier": [("frontier.png", lambda record: charts_of_study(record, "error_against_time")[:1], 1)],
    "history": [("history.png", lambda record: charts_of(record.studies[0].series)[:3] if record.studies else [], 3)],
    "serving": [],
}
"""Shelf → its files, the panels of its page that each file shows, and the number of panels side by side."""
