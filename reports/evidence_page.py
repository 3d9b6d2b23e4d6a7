"""An evidence record → evidence.html, in the same design as the report and as self-contained."""

from pathlib import Path

from markupsafe import Markup

from harness.evidence_record import EvidenceRecord
from reports import shell, wording
from reports.evidence_view import evidence, sentences
from reports.script import content_policy


def evidence_page(record: EvidenceRecord) -> str:
    """The whole page as text."""
    shown = evidence(record)
    return (
        shell.environment()
        .get_template("evidence_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "evidence.css"),
            colours={},
            title=shown.headline,
            evidence=shown,
            sentences=sentences(record),
            provenance=provenance(record),
        )
    )


def provenance(record: EvidenceRecord) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of name and value: how to get the same again, and how long that takes."""
    spent = [(study.info.title, wording.duration(study.seconds)) for study in record.studies if study.seconds]
    return shell.groups_of(record.provenance, record.settings, spent)


def write_evidence_page(record: EvidenceRecord, out: Path) -> Path:
    """Into `out`; gives the page's path."""
    path = out / shell.EVIDENCE_PAGE
    shell.write_whole(evidence_page(record), path)
    return path
