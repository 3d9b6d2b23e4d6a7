"""`python -m harness serving`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress

NARROWEST, WIDEST = 8, 4096
MOST_THREADS = 256


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    finished = "output folder of a finished run (default: out/latest)"
    add("out", type=Path, nargs="?", default=Path("out/latest"), metavar="OUT", help=finished)
    add("--scenes", nargs="+", metavar="SCENE", help="scenes of the run to look at (default: all)")
    add("--methods", nargs="+", metavar="METHOD", help="methods of the run to look at (default: all)")
    add("--seed", type=int, default=0, metavar="N", help="whose weights are shown (default: 0)")
    add("--width", type=int, default=100, metavar="PX", help="of the pictures that are timed (default: 100)")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add("--threads", type=int, default=1, metavar="N", help="of rendering (default: 1; more wait for a busy machine)")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")
    add("--quick", action="store_true", help="sizes at which no figure means anything, to try the studies themselves")
    add("--quiet", action="store_true", help="no progress")


def run_serving(options: argparse.Namespace, show: "Progress") -> int:
    """0, or 3 where nothing of the run could be rendered or a study failed; raises `InputError` for what cannot be."""
    from scenes.errors import InputError

    if not NARROWEST <= options.width <= WIDEST:
        raise InputError(f"--width {options.width}: must lie between {NARROWEST} and {WIDEST}")
    if not 1 <= options.threads <= MOST_THREADS:
        raise InputError(f"--threads {options.threads}: must lie between 1 and {MOST_THREADS}")

    from harness.device import chosen_device
    from harness.finished import FinishedRun
    from harness.folder_lock import locked_folder
    from harness.serving.runner import Asked, run
    from harness.serving_record import SERVING_FILE
    from harness.stopping import told_when_stopped

    finished = FinishedRun.of(options.out)
    scenes, methods = finished.scenes(options.scenes), finished.methods(options.methods)
    if options.seed not in finished.run.seeds:
        known = " ".join(map(str, finished.run.seeds))
        raise InputError(f"--seed {options.seed}: the run does not have it; it has {known}")
    asked = Asked([one.name for one in scenes], methods, options.seed, options.width, options.quick, options.threads)
    kept = f"studies that were finished are kept in {options.out / SERVING_FILE}; the same command begins again"
    with told_when_stopped(lambda: kept), locked_folder(options.out):
        record = run(finished, asked, chosen_device(options.device), options.view_sets, show)
    show.line(f"figures in {options.out / SERVING_FILE}")
    return 3 if record.failed or (record.cache is None and record.attention is None) else 0
