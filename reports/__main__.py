"""python -m reports OUT [OUT …]: write report.html and summary.json from records; the page's path is printed last.

Each record of studies in OUT gets a separate page, evidence.html, stability.html, speed.html or serving.html; the
report also shows all of them except speed. A judgement.json gets a separate page as well.
Several outputs are compared in outputs.html, each with the first.
"""

import argparse
import sys
import textwrap
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from runpy import run_path
from typing import TYPE_CHECKING, TextIO

if __name__ == "__main__":  # before anything is imported that a folder of the user may replace
    run_path(str(Path(__file__).parents[1] / "harness" / "__main__.py"))["require_ours"]()

from scenes.files.atomic import require_suffix
from scenes.files.errors import DamagedRecord, InputError, printable
from scenes.files.installed import packages_needed
from scenes.files.standard_output import go_on_unheard
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from harness.records.study import Studies
    from reports.data.load import Records
    from reports.data.studies_load import ShelfRecords
    from reports.studies.study_page import ShelfShown

Show = Callable[[str], None]
"""Prints a line, or nothing with `--quiet`."""
COLUMNS = 80
OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED = 1, 2, 3, 130


def parser(program: str = "python -m reports") -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog=program,
        description="Build report.html and summary.json from the records of a run, and a page from each record of "
        "studies: evidence.html, stability.html, speed.html, serving.html. The report also shows all of these except "
        "speed.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, 3 done, but some cell diverged or failed, a "
        "stability check of this harness failed, or a check of the evidence does not hold, 130 stopped.",
    )
    made.add_argument(
        "out",
        metavar="OUT",
        type=Path,
        nargs="+",
        help="the output folder of a run, for instance out/latest; several are compared, each with the first",
    )
    made.add_argument(
        "--page",
        metavar="FILE",
        type=Path,
        help="where the page of several outputs goes (default: outputs.html in the first)",
    )
    made.add_argument(
        "--partial",
        action="store_true",
        help="report the valid parts of an unfinished or damaged run, and name what was left out",
    )
    made.add_argument("--quiet", action="store_true", help="print only the paths of the pages")
    made.add_argument(
        "--publish", metavar="DIR", type=Path, help="also write the README's small plots and numbers to DIR"
    )
    made.add_argument(
        "--export", metavar="FILE", type=Path, help="also write all figures (PDF, SVG, PNG) and tables to this zip"
    )
    return made


def main(arguments: list[str] | None = None, program: str = "python -m reports") -> int:
    options = parser(program).parse_args(arguments)
    out, several = options.out[0], len(options.out) > 1
    places = Counter(folder.resolve() for folder in options.out)
    twice = sorted({str(folder) for folder in options.out if places[folder.resolve()] > 1})
    refusals = {
        "--page: needs several outputs; give a second output, or leave it out": options.page and not several,
        "--publish: works with only one output": options.publish and several,
        "--export: works with only one output": options.export and several,
        "--partial: cannot be combined with --publish; finish the run first": options.publish and options.partial,
        f"{''.join(twice[:1])}: named twice; name each output once": twice,
    }
    for refusal in (words for words, holds in refusals.items() if holds):
        _say(refusal, sys.stderr)
        return BAD_INPUT
    from reports.data.load import NoRecords, NotForPublishing

    show = (lambda line: None) if options.quiet else _say
    try:
        for option, file, suffix in (("--page", options.page, ".html"), ("--export", options.export, ".zip")):
            if file is not None:
                require_suffix(file, suffix, option)
        if several:
            return build_outputs(options.out, options.page or out / "outputs.html", options.partial, show)
        return build(out, options.publish, options.partial, show, options.export)
    except KeyboardInterrupt:
        print("interrupted: every page that was written is complete; run the command again", file=sys.stderr)
        return STOPPED
    except InputError as refusal:
        _say(refusal, sys.stderr)
        return BAD_INPUT
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        words = str(problem)  # names no file if the damage shows only when the page is laid out
        _say(words if any(str(folder) in words for folder in options.out) else f"{out}: {words}", sys.stderr)
        return BAD_INPUT
    except OSError as error:
        reason = f"{error.strerror or error}; make room or choose a folder that can be written"
        _say(f"{error.filename or out}: {reason}", sys.stderr)
        return BAD_INPUT


def _say(what: object, to: TextIO | None = None) -> None:
    print(printable(str(what)), file=to)


def build(out: Path, publish: Path | None, partly: bool, show: Show, export: Path | None = None) -> int:
    """Read the records, write the pages and print their paths; `partly` reports the valid parts of a damaged run.

    Heavy packages are imported last, so that bad input is refused at once.
    """
    from harness.records.cells import records_folder
    from harness.records.judgements import JUDGEMENT_FILE, read_judgement
    from harness.records.study import SHELVES

    if (out / JUDGEMENT_FILE).is_file():
        from reports.studies.judgement import write_judgement_page

        _say(write_judgement_page(read_judgement(out / JUDGEMENT_FILE), out))
        if not any((out / file).exists() for file in (*SHELVES.values(), records_folder(out).name)):
            return 0

    from reports.data.load import NoRecords, if_valid, read_records
    from reports.data.saved_pictures import damaged as damaged_pictures
    from reports.data.studies_load import ShelfRecords, find_studies

    damaged: list[str] | None = [] if partly else None
    read = {shelf: if_valid(partial(find_studies, out, shelf), None, damaged) for shelf in SHELVES}
    studies = {shelf: record for shelf, record in read.items() if record is not None}
    if publish is not None:
        for record in studies.values():
            refuse_unfinished(record, out / SHELVES[record.shelf])
    if not studies and out.is_dir() and not records_folder(out).is_dir():
        raise NoRecords(
            f"{out}: no {records_folder(out).name}/, no {', no '.join(SHELVES.values())} in it; give the output folder "
            "of a run, of `nox -s speed`, `nox -s stability` or `nox -s evidence`, for instance out/latest"
        )
    holds_run = (out / "records/run.json").is_file() and any((out / "records/cells").glob("*.json"))
    records = read_records(out, partly) if holds_run or not studies else None
    if export is not None and records is None:
        raise NoRecords(f"{out}: --export writes the figures of a run, but there is no run; leave it out")
    left_out = damaged or []
    if partly and records is not None:
        records.left_out.extend([*damaged_pictures(records), *left_out])
        left_out = records.left_out
    for line in left_out:
        show(f"left out: {line}")
    from reports.studies.study_page import shelf_shown

    shown = {shelf: shelf_shown(record) for shelf, record in studies.items()}
    failed = [build_shelf(shelf, out, publish, records is not None, show) for shelf in shown.values()]
    if records is not None:
        shelves = ShelfRecords(*(studies.get(shelf) for shelf in ("stability", "evidence", "serving")))
        failed.append(build_report(records, publish, shelves, shown, show))
        if export is not None:
            from reports.run.saving.export import write_export

            write_export(records, export, shelves)
            _say(export)
    return SOME_FAILED if any(failed) else 0


def refuse_unfinished(record: "Studies", path: Path) -> None:
    from harness.records.study import again
    from reports.data.load import NotForPublishing

    if record.is_quick:
        remedy = "measure again without --quick, or leave out --publish"
        raise NotForPublishing(f"{path}: a quick run, too rough to publish; {remedy}")
    if not record.is_complete:
        raise NotForPublishing(f"{path}: not finished; {again(record.shelf, path.parent)}, or leave out --publish")


def build_outputs(outs: list[Path], page: Path, partly: bool, show: Show) -> int:
    """Build the page on which several runs are compared with the first; returns 3 if a cell of any of them failed."""
    from reports.data.load import read_records

    runs = [read_records(out, partly) for out in outs]
    from reports.run.outputs import write_outputs_page

    title = write_outputs_page(runs, page)
    for line in [*(f"left out: {line}" for records in runs for line in records.left_out), title]:
        show(line)
    _say(page)
    return SOME_FAILED if any(records.failed for records in runs) else 0


def build_shelf(shown: "ShelfShown", out: Path, publish: Path | None, has_report: bool, show: Show) -> bool:
    """Build the page of a shelf; returns whether a check of our own code fails."""
    from reports.studies.publishing import write_published
    from reports.studies.study_page import broken_line, write_study_page

    record = shown.record
    page = write_study_page(shown, out, has_report)
    if publish is not None:
        write_published(record, publish)
    for line in [shown.headline, *(broken_line(*broken) for broken in record.broken)]:
        show(line)
    _say(page)
    return bool(record.broken)


def build_report(
    records: "Records", publish: Path | None, shelves: "ShelfRecords", shown: "dict[str, ShelfShown]", show: Show
) -> bool:
    from reports.claims.headline import headline
    from reports.run.run_page import write_page
    from reports.run.saving.publish import write_published, write_summary

    out = records.out
    write_summary(records, out / "summary.json", shelves)
    write_page(records, out / "report.html", shelves, shown)
    if publish is not None:
        write_published(records, publish, shelves)
    show(textwrap.fill(headline(records).title, COLUMNS, break_on_hyphens=False))
    for cell in records.failed:
        show(f"{cell.scene}, {cell.method}, seed {cell.seed}: {cell.status} ({cell.reason or 'no reason recorded'})")
    for method, reasons in records.not_available.items():
        show(f"{method}: not available ({'; '.join(reasons)})")
    _say(out / "report.html")
    return bool(records.failed)


if __name__ == "__main__":
    go_on_unheard()
    stop_on_signals()
    with packages_needed():
        sys.exit(main())
