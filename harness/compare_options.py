"""`python -m harness compare A B`: its options, and what it does."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    command.description = (
        "How far two outputs of the same plan differ: scores cell by cell, verdicts, headline. Made on two machines, "
        "or on one with ATEN_CPU_CAPABILITY=avx2 in the environment of the second run, which makes torch leave out "
        "AVX-512 (ONEDNN_MAX_CPU_ISA=AVX2 does so for products of matrices); the provenance of every cell says which."
    )
    command.add_argument("first", type=Path, metavar="A", help="output folder of a run")
    command.add_argument("second", type=Path, metavar="B", help="output folder of the same run, made again")
    command.add_argument("--json", type=Path, metavar="FILE", help="write everything that is printed, as JSON")


def run_compare(options: argparse.Namespace, show: "Progress") -> int:
    """Raises `InputError` for outputs of different plans, and `DamagedRecord`."""
    from harness.json_record import write_json
    from harness.two_runs import as_json, lines_of, two_runs

    found = two_runs(options.first, options.second)
    sys.stdout.write("\n".join(lines_of(found)) + "\n")
    if options.json is not None:
        write_json(options.json, as_json(found))
    return 0
