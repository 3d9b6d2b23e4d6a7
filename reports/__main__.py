"""python -m reports OUT [OUT …]: records in, report.html and summary.json out; the page's path is printed last.

Each record of studies in OUT has a page of its own, evidence.html, stability.html, speed.html or serving.html. The
report shows all but speed as well. A judgement.json has a page of its own.
Several outputs are compared in outputs.html, each with the first.
"""

import argparse
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.files.errors import DamagedRecord
from scenes.files.installed import packages_needed
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from harness.records.study import Studies
    from reports.data.beside import Beside
    from reports.data.load import Records
    from reports.studies.study_page import ShelfShown

OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED = 1, 2, 3, 130


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m reports",
        description="Build report.html and summary.json from the records of a run, and a page from each record of "
        "studies: evidence.html, stability.html, speed.html, serving.html. The report shows all but speed as well.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, 3 done, but some cell diverged or failed, a "
        "stability check of what is ours failed, or a check of the evidence does not hold, 130 stopped.",
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
        "--partial", action="store_true", help="of an unfinished or damaged run: report what is sound, and say so"
    )
    made.add_argument("--quiet", action="store_true", help="print nothing but the paths of the pages")
    made.add_argument(
        "--publish", metavar="DIR", type=Path, help="also write the README's small plots and numbers to DIR"
    )
    return made


def main(arguments: list[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    out, several = options.out[0], len(options.out) > 1
    places = Counter(out.resolve() for out in options.out)
    twice = sorted({str(out) for out in options.out if places[out.resolve()] > 1})
    refusals = {
        "--page: goes with several outputs alone; give a second one, or leave it out": options.page and not several,
        "--publish: goes with one output alone": options.publish and several,
        "--partial: goes without --publish; finish the run first": options.publish and options.partial,
        f"{''.join(twice[:1])}: named twice; name each output once": twice,
    }
    for refusal in (words for words, holds in refusals.items() if holds):
        print(refusal, file=sys.stderr)
        return BAD_INPUT
    from reports.data.load import NoRecords, NotForPublishing

    try:
        if several:
            return build_outputs(options.out, options.quiet, options.page or out / "outputs.html", options.partial)
        return build(out, options.quiet, options.publish, options.partial)
    except KeyboardInterrupt:
        print("interrupted: pages that were written are whole; give the command again", file=sys.stderr)
        return STOPPED
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        words = str(problem)  # without a file if it was found only when what it holds was to be shown
        print(words if any(str(given) in words for given in options.out) else f"{out}: {words}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        where = error.filename or out
        print(f"{where}: {error.strerror or error}; make room or choose a folder that can be written", file=sys.stderr)
        return BAD_INPUT


def build(out: Path, quiet: bool, publish: Path | None, partly: bool) -> int:
    """Read, write and print, with `partly` of a damaged run what is valid; what is heavy is imported last."""
    from harness.records.cells import records_folder
    from harness.records.judgements import JUDGEMENT_FILE, read_judgement
    from harness.records.study import SHELVES, FormerRecord

    if (out / JUDGEMENT_FILE).is_file():
        from reports.studies.judgement import write_judgement_page

        print(write_judgement_page(read_judgement(out / JUDGEMENT_FILE), out))
        if not any((out / file).exists() for file in (*SHELVES.values(), records_folder(out).name)):
            return 0

    from reports.data.beside import Beside
    from reports.data.kept_pictures import damaged as damaged_pictures
    from reports.data.load import NoRecords, if_sound, read_records
    from reports.data.studies_load import find_studies

    damaged: list[str] | None = [] if partly else None
    studies: dict[str, Studies] = {}
    for shelf in SHELVES:
        try:
            if (record := if_sound(partial(find_studies, out, shelf), None, damaged)) is not None:
                studies[shelf] = record
        except FormerRecord as former:  # the rest is reported
            tell([str(former)])
    beside = Beside(*(studies.get(shelf) for shelf in ("stability", "evidence", "serving")))
    if publish is not None:
        refuse_unfit(out, list(studies.values()))
    if not studies and out.is_dir() and not records_folder(out).is_dir():
        raise NoRecords(
            f"{out}: no {records_folder(out).name}/, no {', no '.join(SHELVES.values())} in it; give the output folder "
            "of a run, of `nox -s speed`, `nox -s stability` or `nox -s evidence`, for instance out/latest"
        )
    records = read_records(out, partly) if not studies or holds_run(out) else None
    left_out = damaged or []
    if partly and records is not None:
        records.left_out.extend([*damaged_pictures(records), *left_out])
        left_out = records.left_out
    if not quiet:
        tell(left_out)
    from reports.studies.study_page import shelf_shown

    shown = {shelf: shelf_shown(record, out) for shelf, record in studies.items()}
    codes = [
        build_shelf(study_record, shown[shelf], out, quiet, publish, records is not None)
        for shelf, study_record in studies.items()
    ]
    if records is not None:
        codes.append(build_report(records, quiet, publish, beside, shown))
    return max(codes)


def refuse_unfit(out: Path, studies: "list[Studies]") -> None:
    """Raise `NotForPublishing` for what is quick or not finished."""
    from harness.records.study import SHELVES, again
    from reports.data.load import NotForPublishing, refuse_quick

    for record in studies:
        path = out / SHELVES[record.shelf]
        refuse_quick(record.settings, path)
        if not record.is_complete:
            raise NotForPublishing(f"{path}: not finished; {again(record.shelf, out)}, or leave out --publish")


def tell(left_out: list[str]) -> None:
    for line in left_out:
        print(f"left out: {line}")


def build_outputs(outs: list[Path], quiet: bool, page: Path, partly: bool) -> int:
    """Build the page on which several runs are compared with the first, with `partly` the valid parts of each; returns
    3 if a cell of any of them failed.
    """
    from reports.data.load import read_records

    runs = [read_records(out, partly) for out in outs]
    from reports.run.outputs import write_outputs_page

    title = write_outputs_page(runs, page)
    if not quiet:
        tell([line for records in runs for line in records.left_out])
        print(title)
    print(page)
    return SOME_FAILED if any(records.failed for records in runs) else 0


def holds_run(out: Path) -> bool:
    """Return whether a run lies beside another record: its own file and at least one finished cell."""
    folder = out / "records"
    return (folder / "run.json").is_file() and any((folder / "cells").glob("*.json"))


def build_shelf(
    record: "Studies", shown: "ShelfShown", out: Path, quiet: bool, publish: Path | None, beside_report: bool
) -> int:
    """Build the page of a shelf; returns 3 if a check of ours fails."""
    from reports.studies.study_page import broken_line, headline, write_study_page

    page = write_study_page(record, out, beside_report, shown)
    if publish is not None:
        from reports.studies.publishing import write_published

        write_published(record, publish)
    if not quiet:
        print(headline(record))
        for study, fault in record.broken:
            print(broken_line(study, fault))
    print(page)
    return SOME_FAILED if record.broken else 0


def build_report(
    records: "Records", quiet: bool, publish: Path | None, beside: "Beside", shown: "dict[str, ShelfShown]"
) -> int:
    """Build the page and the numbers of a run."""
    from reports.claims.headline import headline
    from reports.run.publish import write_published as write_published_run
    from reports.run.publish import write_summary
    from reports.run.run_page import write_page

    out = records.out
    write_summary(records, out / "summary.json", beside)
    write_page(records, out / "report.html", beside, shown)
    if publish is not None:
        write_published_run(records, publish, beside)
    if not quiet:
        print(headline(records).title)
        for cell in records.failed:
            print(
                f"{cell.scene}, {cell.method}, seed {cell.seed}: {cell.status} ({cell.reason or 'no reason recorded'})"
            )
        for method, reasons in records.not_available.items():
            print(f"{method}: not available ({'; '.join(reasons)})")
    print(out / "report.html")
    return SOME_FAILED if records.failed else 0


if __name__ == "__main__":
    stop_on_signals()
    with packages_needed():
        sys.exit(main())
