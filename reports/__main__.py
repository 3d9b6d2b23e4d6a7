"""python -m reports OUT: records in, report.html and summary.json out; the page's path is printed last."""

import argparse
import sys
from pathlib import Path

from harness.records import DamagedRecord

OWN_ERROR, BAD_INPUT, SOME_FAILED = 1, 2, 3


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(
        prog="python -m reports",
        description="Build report.html and summary.json from the records of a run.",
        epilog="Exit codes: 0 done, 1 own error, 2 bad usage or input, 3 done, but some cell diverged or failed.",
    )
    made.add_argument("out", metavar="OUT", type=Path, help="the output folder of a run, for instance out/latest")
    made.add_argument("--quiet", action="store_true", help="print nothing but the path of the page")
    made.add_argument("--publish", metavar="DIR", type=Path, help="also write the README's small plots to DIR")
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

    try:
        records = read_records(out)
    except (NoRecords, DamagedRecord) as problem:
        print(problem, file=sys.stderr)
        return BAD_INPUT

    from reports.headline import headline
    from reports.page import write_page
    from reports.summary import write_summary

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
