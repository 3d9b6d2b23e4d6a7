"""python -m reports OUT: records in, report.html and summary.json out; the page's path is printed last.

Where OUT holds speed.json there is speed.html as well, or alone.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from harness.records import DamagedRecord, records_folder

if TYPE_CHECKING:
    from reports.load import Records

OWN_ERROR, BAD_INPUT, SOME_FAILED = 1, 2, 3


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m reports",
        description="Build report.html and summary.json from the records of a run, speed.html from its speed.json.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, 3 done, but some cell diverged or failed.",
    )
    made.add_argument("out", metavar="OUT", type=Path, help="the output folder of a run, for instance out/latest")
    made.add_argument("--quiet", action="store_true", help="print nothing but the path of the page")
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
    from reports.load import NoRecords, read_records
    from reports.speed_load import FILE, NotForPublishing, find_speed, refuse_quick

    try:
        speed = find_speed(out)
        if speed is not None and publish is not None:
            refuse_quick(speed, out)
        folder = records_folder(out)
        if speed is None and out.is_dir() and not folder.is_dir():
            raise NoRecords(
                f"{out}: no {folder.name}/ and no {FILE} in it; "
                "give the output folder of a run or of `nox -s speed`, for instance out/latest"
            )
        with_run = speed is None or (folder / "run.json").is_file()
        records = read_records(out) if with_run else None
    except (NoRecords, DamagedRecord, NotForPublishing) as problem:
        print(problem, file=sys.stderr)
        return BAD_INPUT

    if speed is not None:
        from reports.shell import SPEED_PAGE
        from reports.speed_page import write_speed_page

        write_speed_page(speed, out / SPEED_PAGE, beside_report=records is not None)
        if publish is not None:
            from reports.speed_publish import write_published_speed

            write_published_speed(speed, publish)
        print(out / SPEED_PAGE)
    return 0 if records is None else build_report(records, quiet, publish)


def build_report(records: "Records", quiet: bool, publish: Path | None) -> int:
    """The page and the numbers of a run."""
    from reports.headline import headline
    from reports.page import write_page
    from reports.summary import write_summary

    out = records.out
    write_summary(records, out / "summary.json")
    write_page(records, out / "report.html")
    if publish is not None:
        from reports.publish import write_published

        write_published(records, publish)
    if not quiet:
        print(headline(records).title)
        for cell in records.failed:
            print(
                f"{cell.scene}, {cell.method}, seed {cell.seed}: {cell.status} ({cell.reason or 'no reason recorded'})"
            )
    print(out / "report.html")
    return SOME_FAILED if records.failed else 0


if __name__ == "__main__":
    sys.exit(main())
