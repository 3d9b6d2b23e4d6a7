"""python -m reports OUT: records in, report.html and summary.json out; the page's path is printed last.

Where OUT holds speed.json or stability.json there is speed.html or stability.html as well, or alone.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from harness.records import DamagedRecord, records_folder
from harness.speed_record import SpeedRecord
from harness.stability_record import STABILITY_FILE, StabilityRecord, broken

if TYPE_CHECKING:
    from reports.load import Records

OWN_ERROR, BAD_INPUT, SOME_FAILED = 1, 2, 3


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m reports",
        description="Build report.html and summary.json from the records of a run, speed.html from its speed.json, "
        "stability.html from its stability.json.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, "
        "3 done, but some cell diverged or failed, or a stability check of what is ours failed.",
    )
    made.add_argument("out", metavar="OUT", type=Path, help="the output folder of a run, for instance out/latest")
    made.add_argument("--quiet", action="store_true", help="print nothing but the paths of the pages")
    made.add_argument(
        "--publish", metavar="DIR", type=Path, help="also write the README's small plots and numbers to DIR"
    )
    return made


def main(arguments: list[str] | None = None) -> int:
    options = parser().parse_args(arguments)
    try:
        return build(options.out, options.quiet, options.publish)
    except OSError as error:
        where = error.filename or options.out
        print(f"{where}: {error.strerror or error}; make room or choose a folder that can be written", file=sys.stderr)
        return BAD_INPUT


def build(out: Path, quiet: bool, publish: Path | None) -> int:
    """Reads, writes, prints; what is heavy is imported only once the records are known to be sound."""
    from reports.load import NoRecords, NotForPublishing, read_records, refuse_quick
    from reports.speed_load import FILE, find_speed
    from reports.stability_load import find_stability

    try:
        speed, stability = find_speed(out), find_stability(out)
        if publish is not None:
            for found, file in ((speed, FILE), (stability, STABILITY_FILE)):
                if found is not None:
                    refuse_quick(found.settings, out / file)
        alone = speed is None and stability is None
        if alone and out.is_dir() and not records_folder(out).is_dir():
            raise NoRecords(
                f"{out}: no {records_folder(out).name}/, no {FILE} and no {STABILITY_FILE} in it; give the output "
                "folder of a run, of `nox -s speed` or of `nox -s stability`, for instance out/latest"
            )
        records = read_records(out) if alone or holds_run(out) else None
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        print(problem, file=sys.stderr)
        return BAD_INPUT

    codes = []
    if speed is not None:
        codes.append(build_speed(speed, out, publish, records is not None))
    if stability is not None:
        codes.append(build_stability(stability, out, quiet, publish, records is not None))
    if records is not None:
        codes.append(build_report(records, quiet, publish, stability))
    return max(codes)


def holds_run(out: Path) -> bool:
    """Whether a run lies beside another record: its own file and at least one finished cell."""
    folder = records_folder(out)
    return (folder / "run.json").is_file() and any((folder / "cells").glob("*.json"))


def build_speed(record: SpeedRecord, out: Path, publish: Path | None, beside_report: bool) -> int:
    """The page about speed."""
    from reports.shell import SPEED_PAGE
    from reports.speed_page import write_speed_page

    write_speed_page(record, out / SPEED_PAGE, beside_report)
    if publish is not None:
        from reports.speed_publish import write_published_speed

        write_published_speed(record, publish)
    print(out / SPEED_PAGE)
    return 0


def build_stability(record: StabilityRecord, out: Path, quiet: bool, publish: Path | None, beside_report: bool) -> int:
    """The page about stability; 3 where something of ours failed."""
    from reports.stability_page import write_stability_page
    from reports.stability_view import failure
    from reports.stability_wording import headline

    page = write_stability_page(record, out, beside_report)
    if publish is not None:
        from reports.stability_publish import write_published_stability

        write_published_stability(record, publish)
    if not quiet:
        print(headline(record))
        for one in broken(record):
            print(failure(one))
    print(page)
    return SOME_FAILED if broken(record) else 0


def build_report(records: "Records", quiet: bool, publish: Path | None, stability: StabilityRecord | None) -> int:
    """The page and the numbers of a run."""
    from reports.headline import headline
    from reports.page import write_page
    from reports.summary import write_summary

    out = records.out
    write_summary(records, out / "summary.json")
    write_page(records, out / "report.html", stability)
    if publish is not None:
        from reports.publish import write_published

        write_published(records, publish)
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
    sys.exit(main())
