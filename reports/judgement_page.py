"""A judgement of somebody's table → judgement.html, in the same design as the report and as self-contained."""

from pathlib import Path

from markupsafe import Markup

from harness.judge.record import JudgementRecord
from harness.judge.wording import headline, missing_line, suspect_line, without_line
from reports import shell
from reports.judgement_view import changes_grid, matrix, methods_grid, panel, suspects_grid
from reports.plots import plots
from reports.script import content_policy

JUDGEMENT_PAGE = "judgement.html"


def judgement_page(record: JudgementRecord) -> str:
    """The whole page as text."""
    clean = record.without_suspects
    return (
        shell.environment()
        .get_template("judgement_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "judgement.css"),
            colours={},
            title=headline(record),
            record=record,
            missing=missing_line(record) if record.missing else "",
            suspects=[suspect_line(record, one) for one in record.suspects[:3]],
            without=without_line(record),
            methods=methods_grid(record, record.given, "Methods from best to worst"),
            suspects_grid=suspects_grid(record),
            cleaned=methods_grid(record, clean, "Without the suspect results") if clean else None,
            changes=changes_grid(record),
            matrix=matrix(record),
            plots=plots([panel(record)], "judgement"),
            provenance=provenance(record),
        )
    )


def provenance(record: JudgementRecord) -> list[tuple[str, list[tuple[str, str]]]]:
    """Which table was judged, and how."""
    better = "higher" if record.higher_is_better else "lower"
    settings = {"metric": record.metric, "better": better, "smallest effect of interest": record.margin}
    settings |= {"baseline": record.baseline} if record.baseline is not None else {}
    return [("SHA-256 of the table", [*record.digests.items()]), ("Settings", shell.flat(settings))]


def write_judgement_page(record: JudgementRecord, out: Path) -> Path:
    """Into `out`; gives the page's path."""
    path = out / JUDGEMENT_PAGE
    shell.write_whole(judgement_page(record), path)
    return path
