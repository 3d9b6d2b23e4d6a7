"""python -m reports OUT [OUT …]: records in, report.html and summary.json out; the page's path is printed last.

Where OUT holds speed.json or stability.json there is speed.html or stability.html as well, or alone. The studies of an
evidence.json stand in report.html, or alone in evidence.html; what a serving.json holds stands in report.html.
A judgement.json has a page of its own.
Several outputs are compared in outputs.html, each with the first.
"""

import argparse
import sys
from functools import partial as partial_of
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.files.errors import DamagedRecord
from scenes.files.installed import packages_needed
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from harness.records.study import Studies
    from reports.data.beside import Beside
    from reports.data.load import Records

OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED = 1, 2, 3, 130
OUTPUTS_PAGE = "outputs.html"


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m reports",
        description="Build report.html and summary.json from the records of a run, speed.html from its speed.json, "
        "stability.html from its stability.json, and the studies of its evidence.json, in report.html or alone in "
        "evidence.html. What its serving.json holds stands in report.html.",
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
    out = options.out[0]
    try:
        if len(options.out) > 1:
            return build_outputs(options.out, options.quiet, options.publish, options.page, options.partial)
        if options.page is not None:
            print("--page: goes with several outputs alone; give a second one, or leave it out", file=sys.stderr)
            return BAD_INPUT
        return build(out, options.quiet, options.publish, options.partial)
    except KeyboardInterrupt:
        print("interrupted: pages that were written are whole; give the command again", file=sys.stderr)
        return STOPPED
    except DamagedRecord as problem:  # found only when what it holds was to be shown
        print(f"{out}: {problem}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        where = error.filename or out
        print(f"{where}: {error.strerror or error}; make room or choose a folder that can be written", file=sys.stderr)
        return BAD_INPUT


def build(out: Path, quiet: bool, publish: Path | None, partial: bool = False) -> int:
    """Reads, writes, prints, with `partial` of a damaged run what is sound; what is heavy is imported last."""
    from harness.records.cells import records_folder
    from harness.records.judgements import JUDGEMENT_FILE
    from harness.records.serving_record import SERVING_FILE
    from harness.records.study import SHELVES

    if (out / JUDGEMENT_FILE).is_file():
        code = build_judgement(out)
        others = (out / file for file in (*SHELVES.values(), records_folder(out).name))
        if not any(other.exists() for other in others):
            return code

    from reports.data.beside import Beside
    from reports.data.load import NoRecords, NotForPublishing, if_sound, read_records, refuse_quick
    from reports.data.serving_load import find_serving, is_whole
    from reports.data.studies_load import find_studies

    try:
        if partial and publish is not None:
            raise NotForPublishing("--partial: goes without --publish; finish the run first")
        damaged: list[str] | None = [] if partial else None
        studies = {
            shelf: found
            for shelf in SHELVES
            if (found := if_sound(partial_of(find_studies, out, shelf), None, damaged)) is not None
        }
        serving = if_sound(lambda: find_serving(out), None, damaged)
        if publish is not None:
            for shelf, record in studies.items():
                refuse_quick(record.settings, out / SHELVES[shelf])
            if serving is not None:
                refuse_quick(serving.settings, out / SERVING_FILE)
            if "evidence" in studies and not studies["evidence"].finished:
                raise NotForPublishing(
                    f"{out / SHELVES['evidence']}: not finished; let `nox -s evidence` end, or leave out --publish"
                )
            if serving is not None and not is_whole(serving):
                raise NotForPublishing(
                    f"{out / SERVING_FILE}: not whole; run `python -m harness study serving {out}`, or leave out "
                    "--publish"
                )
        if not studies and out.is_dir() and not records_folder(out).is_dir():
            raise NoRecords(
                f"{out}: no {records_folder(out).name}/, no {', no '.join(SHELVES.values())} in it; "
                "give the output folder of a run, of `nox -s speed`, `nox -s stability` or `nox -s evidence`, for "
                "instance out/latest"
            )
        records = read_records(out, partial) if not studies or holds_run(out) else None
        left_out = damaged or []
        if partial and records is not None:
            from reports.data.kept_pictures import damaged as damaged_pictures

            records.left_out.extend([*damaged_pictures(records), *left_out])
            left_out = records.left_out
        if not quiet:
            _tell(left_out)
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        print(problem, file=sys.stderr)
        return BAD_INPUT

    codes = [build_shelf(record, out, quiet, publish, records is not None) for record in studies.values()]
    if records is not None:
        beside = Beside(studies.get("stability"), studies.get("evidence"), serving)
        codes.append(build_report(records, quiet, publish, beside))
    return max(codes)


def _tell(left_out: list[str]) -> None:
    for line in left_out:
        print(f"left out: {line}")


def build_outputs(outs: list[Path], quiet: bool, publish: Path | None, page: Path | None, partial: bool = False) -> int:
    """Build the page on which several runs are compared with the first, with `partial` the valid parts of each; returns
    3 if a cell of any of them failed.
    """
    from reports.data.load import NoRecords, read_records

    twice = sorted({str(out) for out in outs if sum(out.resolve() == other.resolve() for other in outs) > 1})
    if twice or publish is not None:
        why = f"{twice[0]}: named twice; name each output once" if twice else "--publish: goes with one output alone"
        print(why, file=sys.stderr)
        return BAD_INPUT
    try:
        found = [read_records(out, partial) for out in outs]
    except (NoRecords, DamagedRecord) as problem:
        print(problem, file=sys.stderr)
        return BAD_INPUT
    from reports.run.outputs import write_outputs_page

    page = page or outs[0] / OUTPUTS_PAGE
    title = write_outputs_page(found, page)
    if not quiet:
        _tell([line for records in found for line in records.left_out])
        print(title)
    print(page)
    return SOME_FAILED if any(records.failed for records in found) else 0


def holds_run(out: Path) -> bool:
    """Whether a run lies beside another record: its own file and at least one finished cell."""
    folder = out / "records"
    return (folder / "run.json").is_file() and any((folder / "cells").glob("*.json"))


def build_judgement(out: Path) -> int:
    """The page about somebody's table; raises `DamagedRecord`."""
    from harness.records.judgements import JUDGEMENT_FILE, read_judgement
    from reports.studies.judgement import write_judgement_page

    print(write_judgement_page(read_judgement(out / JUDGEMENT_FILE), out))
    return 0


def build_shelf(record: "Studies", out: Path, quiet: bool, publish: Path | None, beside_report: bool) -> int:
    """Build the page of a shelf; returns 3 if a check of ours fails."""
    from reports.studies.study_page import broken_line, headline, write_study_page

    page = write_study_page(record, out, beside_report)
    if publish is not None:
        from reports.studies.publishing import write_published

        write_published(record, publish)
    if not quiet:
        print(headline(record))
        for study, one in record.broken:
            print(broken_line(study, one))
    print(page)
    return SOME_FAILED if record.broken else 0


def build_report(records: "Records", quiet: bool, publish: Path | None, beside: "Beside") -> int:
    """Build the page and the numbers of a run."""
    from reports.claims.headline import headline
    from reports.run.publish import write_summary
    from reports.run.run_page import write_page

    out = records.out
    write_summary(records, out / "summary.json", beside)
    write_page(records, out / "report.html", beside)
    if publish is not None:
        from reports.run.publish import write_published

        write_published(records, publish, beside)
        if beside.serving is not None:
            from reports.studies.publishing import write_published_serving

            write_published_serving(beside.serving, records.methods, publish)
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
