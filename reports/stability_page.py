"""A stability record → stability.html, in the same design as the report and as self-contained."""

from pathlib import Path

from markupsafe import Markup

from harness.stability_record import StabilityRecord
from reports import shell, wording
from reports.script import content_policy
from reports.stability_view import stability


def stability_page(record: StabilityRecord, out: Path, beside_report: bool = False) -> str:
    """The whole page as text; `beside_report` says that report.html lies in the same folder."""
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


def provenance(record: StabilityRecord) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of name and value: how to get the same again, and how long that takes."""
    spent = [(f"{case.info.id} {case.info.title}", wording.duration(case.seconds)) for case in record.cases]
    total = [("all cases", wording.duration(sum(case.seconds for case in record.cases)))] if spent else []
    return shell.groups_of(record.provenance, record.settings, [*total, *spent])


def write_stability_page(record: StabilityRecord, out: Path, beside_report: bool = False) -> Path:
    """Into `out`, where the pictures of the record are; gives the page's path."""
    path = out / shell.STABILITY_PAGE
    shell.write_whole(stability_page(record, out, beside_report), path)
    return path
