"""python -m reports OUT [OUT …]: records in, report.html and summary.json out; the page's path is printed last.

Each record of studies in OUT has a page of its own, evidence.html, stability.html, speed.html or serving.html. The
report shows all but speed as well. A judgement.json has a page of its own.
Several outputs are compared in outputs.html, each with the first.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from scenes.files.errors import DamagedRecord, printable
from scenes.files.installed import packages_needed
from scenes.files.standard_output import go_on_unheard
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from harness.records.study import Studies
    from reports.data.beside import Beside
    from reports.data.load import Records
    from reports.studies.study_page import ShelfShown

Show = Callable[[str], None]
"""Prints a line, or nothing with `--quiet`."""
OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED = 1, 2, 3, 130


def parser(program: str = "python -m reports") -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog=program,
        description="Build report.html and summary.json from the records of a run, and a page from each record of "
        "studies: evidence.html, stability.html, speed.html, serving.html. The report shows all but speed as well.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, 3 done, but some cell diverged or failed, a "
        "stability check of this harness failed, or a check of the evidence does not hold, 130 stopped.",
    )
    made.add_argument(
        "out",
        metavar="OUT",
        type=Path,
        nargs="+",
        help="the output folder of a run, for instance out/latest; of several, each is compared with the first",
    )
    made.add_argument(
        "--page",
        metavar="FILE",
        type=Path,
        help="where the page of several outputs goes (default: outputs.html in the first)",
    )
    made.add_argument(
        "--partial", action="store_true", help="of an unfinished or damaged run: report the valid parts, and say so"
    )
    made.add_argument("--quiet", action="store_true", help="print nothing but the paths of the pages")
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
    places = Counter(given.resolve() for given in options.out)
    twice = sorted({str(given) for given in options.out if places[given.resolve()] > 1})
    refusals = {
        "--page: needs several outputs; give a second one, or leave it out": options.page and not several,
        "--publish: goes with one output alone": options.publish and several,
        "--export: goes with one output alone": options.export and several,
        "--partial: goes without --publish; finish the run first": options.publish and options.partial,
        f"{''.join(twice[:1])}: named twice; name each output once": twice,
    }
    for refusal in (words for words, holds in refusals.items() if holds):
        _say(refusal, sys.stderr)
        return BAD_INPUT
    from reports.data.load import NoRecords, NotForPublishing

    show = (lambda line: None) if options.quiet else _say
    try:
        if several:
            return build_outputs(options.out, options.page or out / "outputs.html", options.partial, show)
        return build(out, options.publish, options.partial, show, options.export)
    except KeyboardInterrupt:
        print("interrupted: pages that were written are whole; give the command again", file=sys.stderr)
        return STOPPED
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        words = str(problem)  # without a file if it was met only when what it holds was to be shown
        named = words if any(str(given) in words for given in options.out) else f"{out}: {words}"
        _say(named, sys.stderr)
        return BAD_INPUT
    except OSError as error:
        where = error.filename or out
        what = f"{where}: {error.strerror or error}; make room or choose a folder that can be written"
        _say(what, sys.stderr)
        return BAD_INPUT


def _say(what: object, to: TextIO | None = None) -> None:
    print(printable(str(what)), file=to)


def build(out: Path, publish: Path | None, partly: bool, show: Show, export: Path | None = None) -> int:
    """Read, write and print, with `partly` of a damaged run what is valid; what is heavy is imported last."""
    from harness.records.cells import records_folder
    from harness.records.judgements import JUDGEMENT_FILE, read_judgement
    from harness.records.study import SHELVES

    if (out / JUDGEMENT_FILE).is_file():
        from reports.studies.judgement import write_judgement_page

        _say(write_judgement_page(read_judgement(out / JUDGEMENT_FILE), out))
        if not any((out / file).exists() for file in (*SHELVES.values(), records_folder(out).name)):
            return 0

    from reports.data.beside import Beside
    from reports.data.kept_pictures import damaged as damaged_pictures
    from reports.data.load import NoRecords, if_sound, read_records
    from reports.data.studies_load import find_studies

    damaged: list[str] | None = [] if partly else None
    studies: dict[str, Studies] = {}
    for shelf in SHELVES:
        if (record := if_sound(partial(find_studies, out, shelf), None, damaged)) is not None:
            studies[shelf] = record
    if publish is not None:
        refuse_unfit(out, list(studies.values()))
    if not studies and out.is_dir() and not records_folder(out).is_dir():
        raise NoRecords(
            f"{out}: no {records_folder(out).name}/, no {', no '.join(SHELVES.values())} in it; give the output folder "
            "of a run, of `nox -s speed`, `nox -s stability` or `nox -s evidence`, for instance out/latest"
        )
    holds_run = (out / "records/run.json").is_file() and any((out / "records/cells").glob("*.json"))
    records = read_records(out, partly) if holds_run or not studies else None
    left_out = damaged or []
    if partly and records is not None:
        records.left_out.extend([*damaged_pictures(records), *left_out])
        left_out = records.left_out
    for line in left_out:
        show(f"left out: {line}")
    from reports.studies.study_page import shelf_shown

    shown = {shelf: shelf_shown(record, out) for shelf, record in studies.items()}
    failed = [build_shelf(studies[shelf], shown[shelf], out, publish, records, show) for shelf in studies]
    if records is not None:
        beside = Beside(*(studies.get(shelf) for shelf in ("stability", "evidence", "serving")))
        failed.append(build_report(records, publish, beside, shown, show))
        if export is not None:
            from reports.run.saving.export import write_export

            write_export(records, export, beside)
            _say(export)
    elif export is not None:
        raise NoRecords(f"{out}: --export writes the figures of a run, and there is none; leave it out")
    return SOME_FAILED if any(failed) else 0


def refuse_unfit(out: Path, studies: "list[Studies]") -> None:
    from harness.records.study import SHELVES, again
    from reports.data.load import NotForPublishing, refuse_quick

    for record in studies:
        path = out / SHELVES[record.shelf]
        refuse_quick(record.settings, path)
        if not record.is_complete:
            raise NotForPublishing(f"{path}: not finished; {again(record.shelf, out)}, or leave out --publish")


def build_outputs(outs: list[Path], page: Path, partly: bool, show: Show) -> int:
    """Build the page on which several runs are compared with the first, with `partly` the valid parts of each; returns
    3 if a cell of any of them failed.
    """
    from reports.data.load import read_records

    runs = [read_records(out, partly) for out in outs]
    from reports.run.outputs import write_outputs_page

    title = write_outputs_page(runs, page)
    for line in [*(f"left out: {line}" for records in runs for line in records.left_out), title]:
        show(line)
    _say(page)
    return SOME_FAILED if any(records.failed for records in runs) else 0


def build_shelf(
    record: "Studies", shown: "ShelfShown", out: Path, publish: Path | None, run: "Records | None", show: Show
) -> bool:
    """Build the page of a shelf, beside the report if there is a run; returns whether a check of ours fails."""
    from reports.studies.publishing import write_published
    from reports.studies.study_page import broken_line, headline, write_study_page

    page = write_study_page(record, out, run is not None, shown)
    if publish is not None:
        write_published(record, publish)
    for line in [headline(record), *(broken_line(*broken) for broken in record.broken)]:
        show(line)
    _say(page)
    return bool(record.broken)


def build_report(
    records: "Records", publish: Path | None, beside: "Beside", shown: "dict[str, ShelfShown]", show: Show
) -> bool:
    from reports.claims.headline import headline
    from reports.run.run_page import write_page
    from reports.run.saving.publish import write_published, write_summary

    out = records.out
    write_summary(records, out / "summary.json", beside)
    write_page(records, out / "report.html", beside, shown)
    if publish is not None:
        write_published(records, publish, beside)
    show(headline(records).title)
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
