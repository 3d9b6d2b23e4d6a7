"""`python -m harness speed`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from harness.speed_record import QUESTIONS

if TYPE_CHECKING:
    from harness.progress import Progress

PLAIN_SECONDS = 420.0
QUICK_PLAIN_SECONDS = 1.5


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    questions = "; ".join(f"{number} {title}" for number, title in QUESTIONS.items())
    add("--items", nargs="+", type=int, metavar="N", help=f"questions to answer (default: all). {questions}")
    add("--plain-seconds", type=float, metavar="S", help=f"training of the plain side, question 3 ({PLAIN_SECONDS:g})")
    add("--quick", action="store_true", help="sizes at which no figure means anything, to try the benchmark itself")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")
    add("--out", type=Path, metavar="DIR", help="output folder (default: a fresh out/speed-TIME)")
    add("--resume", action="store_true", help="answer what --out lacks")
    add("--quiet", action="store_true", help="no progress")


def run_speed(options: argparse.Namespace, show: "Progress") -> int:
    """0; raises `InputError` for what cannot be."""
    from harness.device import chosen_device
    from harness.folder_lock import locked_folder
    from harness.output_folder import fresh_folder
    from scenes.errors import InputError

    items = options.items or list(QUESTIONS)
    unknown = [str(item) for item in items if item not in QUESTIONS]
    if unknown:
        raise InputError(f"--items {' '.join(unknown)}: choose from {' '.join(map(str, QUESTIONS))}")
    seconds = options.plain_seconds
    if seconds is None:
        seconds = QUICK_PLAIN_SECONDS if options.quick else PLAIN_SECONDS
    if not (math.isfinite(seconds) and 1.0 <= seconds <= 86400.0):
        raise InputError(f"--plain-seconds {seconds:g}: must lie between 1 and 86400")
    if options.resume and options.out is None:
        raise InputError("--resume: name the folder to go on with, --out DIR")
    device = chosen_device(options.device)

    from harness.speed.runner import run, speed_file

    out = options.out or fresh_folder("speed", resume=False)
    with locked_folder(out):
        run(sorted(set(items)), out, device, options.view_sets, seconds, options.quick, options.resume, show)
    show.line(f"figures in {speed_file(out)}")
    return 0
