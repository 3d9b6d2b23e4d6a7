"""`python -m harness stability`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add("--cases", nargs="+", metavar="CASE", help="Q1 Q2 … R1: cases to try (default: all)")
    add("--methods", nargs="+", metavar="METHOD", help="methods to try them on (default: those worth comparing)")
    add("--quick", action="store_true", help="sizes at which no figure means anything, to try the catalogue itself")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")
    add("--out", type=Path, metavar="DIR", help="output folder (default: a fresh out/stability-TIME)")
    add("--resume", action="store_true", help="try what --out lacks")
    add("--list", action="store_true", help="print the catalogue, try nothing")
    add("--quiet", action="store_true", help="no progress")


def run_stability(options: argparse.Namespace, show: "Progress") -> int:
    """0, or 3 where a case that must pass failed; raises `InputError` for what cannot be."""
    from harness.stability.catalog import CASES

    if options.list:  # before anything that imports torch
        for case in CASES.values():
            print(f"{case.info.id:4} {case.info.title}: {case.info.bar}")  # noqa: T201
        return 0

    from baselines.catalog import CATALOG
    from harness.folder_lock import locked_folder
    from harness.output_folder import fresh_folder
    from harness.plan import known_names
    from harness.stability.situation import METHODS
    from harness.stability_record import STABILITY_FILE
    from scenes.errors import InputError

    cases = known_names("--cases", options.cases or list(CASES), list(CASES))
    methods = known_names("--methods", options.methods or list(METHODS), list(CATALOG))
    if options.resume and options.out is None:
        raise InputError("--resume: name the folder to go on with, --out DIR")

    from harness.stability.runner import run

    out = options.out or fresh_folder("stability", resume=False)
    with locked_folder(out):
        code = run(list(cases), methods, out, options.view_sets, options.quick, options.resume, show)
    show.line(f"outcomes in {out / STABILITY_FILE}")
    return code
