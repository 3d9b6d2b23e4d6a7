"""`python -m harness judge TABLE`: its options, and what it does."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        "tables",
        type=Path,
        nargs="+",
        metavar="TABLE",
        help="CSV, Parquet (extra parquet) or JSON with columns scene, method, a metric, perhaps seed, steps, seconds; "
        "nerfbaselines' result files or a folder of them; summary.json of a run",
    )
    add("--metric", metavar="NAME", help="column to judge (default: psnr, else the first one)")
    add("--lower", nargs="+", default=[], metavar="NAME", help="metrics that are better when lower")
    add("--margin", type=float, metavar="SIZE", help="smallest effect of interest (default: 0.2 dB of psnr, …)")
    add("--baseline", metavar="METHOD", help="compare each method with this one alone (default: all pairs)")
    add("--out", type=Path, metavar="DIR", help="output folder (default: a fresh out/judge-TIME)")


def run_judge(options: argparse.Namespace, show: "Progress") -> int:
    """Writes judgement.json and judgement.html; raises `InputError` for a table that cannot be judged."""
    import subprocess
    import sys
    import time

    from harness.json_record import file_digest
    from harness.judge.judgement import judge
    from harness.judge.record import JUDGEMENT_FILE, write_judgement
    from harness.judge.table import read_table
    from harness.judge.wording import lines
    from scenes.errors import InputError

    table = read_table(options.tables, options.metric, options.lower)
    digests = {str(path): file_digest(path) for path in options.tables if path.is_file()}
    record = judge(table, options.margin, options.baseline, digests)
    out = options.out or Path("out") / f"judge-{time.strftime('%Y%m%d-%H%M%S')}"
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder")
    write_judgement(out / JUDGEMENT_FILE, record)
    for line in lines(record):
        show.line(line)
    # the page is made from the record alone, as every page is
    return subprocess.run([sys.executable, "-m", "reports", str(out), "--quiet"], check=False).returncode
