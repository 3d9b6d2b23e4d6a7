"""A stability record → stability.html and the section of the report, both self-contained."""

from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from harness.records.study import CHAPTERS, Check, Picture, Studies, StudyInfo, StudyRecord
from reports.data import wording
from reports.data.wording import counted, duration, of_any_size
from reports.drawing.images import data_uri, read, smaller
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid, tables_grids
from reports.page.script import content_policy
from reports.studies.stability_matrix import (
    LEGEND,
    MARKS,
    OWNERS,
    Group,
    Tone,
    anchor,
    groups,
    headline,
    sentences,
    shown,
    tone_of,
    verdict,
    wanted,
    written,
)
from scenes.files.atomic import write_atomically

BUDGET_BYTES = 3_000_000
"""The bytes of all pictures together, in base64."""
SIDES = (640, 480, 320, 240, 160, 96)
SMALL = 200
"""The pixels up to which a picture is shown enlarged with its pixels sharp."""


@dataclass(frozen=True)
class Shown:
    title: str
    caption: str
    source: str | None
    """A data URI; None if the file is missing or no picture."""
    wide: bool
    sharp: bool


@dataclass(frozen=True)
class Chapter:
    anchor: str
    title: str
    charts: list[Chart]
    tables: list[Grid]
    pictures: list[Shown]


@dataclass(frozen=True)
class CaseShown:
    anchor: str
    info: StudyInfo
    tally: list[tuple[Tone, str, str]]
    """Tone, mark and count, the gravest first."""
    failed: bool
    outcomes: Grid
    seconds: str


@dataclass(frozen=True)
class Stability:
    headline: str
    sentences: list[str]
    broken: list[tuple[str, str]]
    """The anchor of the case, and what of ours failed."""
    finished: bool
    quick: bool
    legend: list[tuple[Tone, str, str]]
    """Tone, mark, meaning."""
    groups: list[Group]
    findings: list[Grid]
    """The failures of the forms that are not ours."""
    cases: list[CaseShown]
    chapters: list[Chapter]


def stability(record: Studies, out: Path) -> Stability:
    """Return the section; `out` is the folder that its pictures are relative to."""
    tones = {tone_of(one) for _, one in record.checks()}
    anchors = {case.info.id: anchor(case) for case in record.studies}
    return Stability(
        headline=headline(record),
        sentences=sentences(record),
        broken=[(anchors[case.info.id], failure(case, one)) for case, one in record.broken],
        finished=record.finished,
        quick=record.is_quick,
        legend=[(tone, MARKS[tone], words) for tone, words in LEGEND if tone in tones],
        groups=groups(record),
        findings=[grid for whose in ("paper", "usual") if (grid := findings_grid(record, whose)).rows],
        cases=[case_shown(case) for case in record.studies],
        chapters=chapters(record, out),
    )


def failure(case: StudyRecord, one: Check) -> str:
    """Return a line such as `Q1 midpoint: 0.02, wanted ≤ 10⁻⁶ (largest relative error; …)`."""
    figure = shown(one, 3)
    bar = f", wanted {wanted(one)}" if one.limit is not None else ""
    said = "; ".join(filter(None, (one.what, one.why)))
    return f"{case.info.id} {one.subject}: {figure}{bar}" + (f" ({said})" if said else "")


def findings_grid(record: Studies, whose: str) -> Grid:
    """Return every bar that the forms of one owner miss."""
    columns = [Column("case", numeric=False), Column("form", numeric=False), Column("figure"), Column("wanted")]
    columns.append(Column("what it is", numeric=False))
    rows = [
        [
            Entry(case.info.id, case.info.title),
            Entry(one.subject),
            Entry(f"{MARKS['property']} {shown(one, 3)}", tone="property"),
            Entry(wanted(one)) if one.limit is not None else EMPTY,
            Entry(one.what or one.why, one.why if one.what else ""),
        ]
        for case, one in record.checks()
        if one.owner == whose and one.status == "fail"
    ]
    return Grid(f"What fails of {OWNERS[whose]}: {counted(len(rows), 'property', 'properties')}", columns, rows)


def case_shown(case: StudyRecord) -> CaseShown:
    tones = [tone_of(one) for one in case.checks]
    tally = [(tone, mark, str(tones.count(tone))) for tone, mark in MARKS.items() if tone in tones]
    seconds = duration(case.seconds) if case.seconds else ""
    return CaseShown(anchor(case), case.info, tally, "fails" in tones, outcomes_grid(case), seconds)


def outcomes_grid(case: StudyRecord) -> Grid:
    columns = [Column("subject", numeric=False), Column("outcome", numeric=False), Column("figure"), Column("wanted")]
    columns.append(Column("what it is", numeric=False))
    rows = []
    for one in case.checks:
        tone = tone_of(one)
        rows.append(
            [
                Entry(one.subject, OWNERS[one.owner]),
                Entry(f"{MARKS[tone]} {verdict(one)}", tone=tone),
                Entry(written(one)) if one.value is not None else EMPTY,
                Entry(wanted(one)) if one.limit is not None else EMPTY,
                Entry(one.what or one.why, one.why if one.what else ""),
            ]
        )
    return Grid(f"Outcomes of {case.info.id}", columns, rows)


def chapters(record: Studies, out: Path) -> list[Chapter]:
    """Return the chapters with something to look at: in their own order, then numbers that this version does not
    know.
    """
    series = [one for case in record.studies for one in case.series]
    tables = [one for case in record.studies for one in case.tables]
    pictures = [one for case in record.studies for one in case.pictures]
    known = list(CHAPTERS)
    found = {one.item for one in series if one.x} | {one.item for one in tables if one.rows and one.columns}
    found |= {one.item for one in pictures}
    side = side_for(out, pictures)
    return [
        Chapter(
            f"chapter-{item}",
            CHAPTERS.get(item, f"Chapter {item}"),
            charts([one for one in series if one.item == item], f"stability-{item}"),
            tables_grids([one for one in tables if one.item == item], of_any_size),
            [picture_shown(one, out, side) for one in pictures if one.item == item],
        )
        for item in sorted(found, key=lambda item: (known.index(item) if item in known else len(known), item))
    ]


def picture_shown(one: Picture, out: Path, side: int) -> Shown:
    pixels = read(out, one.path)
    if pixels is None:
        return Shown(one.title, one.caption, None, wide=False, sharp=False)
    height, width = pixels.shape[:2]
    source = data_uri(smaller(pixels, side))
    return Shown(one.title, one.caption, source, wide=width > 1.8 * height, sharp=max(height, width) <= SMALL)


def side_for(out: Path, pictures: list[Picture]) -> int:
    """Return the longest side at which all pictures stay within the page's budget, by the size of their files."""
    shapes = [found.shape[:2] for one in pictures if (found := read(out, one.path)) is not None]
    for side in SIDES:
        sizes = (height * width * min(1.0, side / max(height, width)) ** 2 for height, width in shapes)
        if 4 * sum(sizes) <= BUDGET_BYTES:
            return side
    return SIDES[-1]


def stability_page(record: Studies, out: Path, beside_report: bool = False) -> str:
    """Return the complete page as text; `beside_report` says that report.html lies in the same folder."""
    shown = stability(record, out)
    return (
        shell.environment()
        .get_template("stability_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "stability.css"),
            colours={},
            title=shown.headline,
            stability=shown,
            report=shell.RUN_PAGE if beside_report else "",
            provenance=provenance(record),
        )
    )


def provenance(record: Studies) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return groups of name and value: how to reproduce the figures, and how long that takes."""
    spent = [(f"{case.info.id} {case.info.title}", wording.duration(case.seconds)) for case in record.studies]
    total = [("all cases", wording.duration(sum(case.seconds for case in record.studies)))] if spent else []
    return shell.groups_of(record.provenance, record.settings, [*total, *spent])


def write_stability_page(record: Studies, out: Path, beside_report: bool = False) -> Path:
    """Write the page into `out`, where the pictures of the record are; returns its path."""
    path = out / shell.STABILITY_PAGE
    write_atomically(path, stability_page(record, out, beside_report), fsync=False)
    return path
