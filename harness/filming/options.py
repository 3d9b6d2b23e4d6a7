"""`python -m harness render`: its options, and how they are checked. Nothing heavy is imported to show the help."""

import argparse
import errno
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress

PATH_NAMES = ("orbit", "spiral", "walk", "test")
"""Those of `harness.camera_paths.PATHS`, and the test views themselves."""
MOST_FRAMES = 10_000
MOST_PIXELS = 4096
MOST_FPS = 60


def add_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    finished = "output folder of a finished run (default: out/latest)"
    add("run", type=Path, nargs="?", default=Path("out/latest"), metavar="OUT", help=finished)
    add("--path", default="orbit", choices=PATH_NAMES, help="where the camera goes (default: orbit)")
    add("--scenes", nargs="+", metavar="SCENE", help="scenes (default: all of the run)")
    add("--methods", nargs="+", metavar="METHOD", help="methods side by side (default: nerf qnerf)")
    add("--seed", type=int, default=0, metavar="N", help="of the training whose weights are shown (default: 0)")
    add("--frames", type=int, metavar="N", help="default: 60; with --path test every test view of the run")
    add("--resolution", type=int, metavar="PX", help="width of the pictures (default: that of the run)")
    add("--fps", type=int, default=20, metavar="N", help="frames a second of the animation (default: 20)")
    add("--elevation", type=float, metavar="DEG", help="height of an orbit above the horizon (default: 30)")
    add("--to", type=Path, metavar="DIR", help="folder to write to or to go on with (default: OUT/films/…)")
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="view-set cache, for --path test")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add(
        "--threads",
        type=int,
        metavar="N",
        help="that render (default: all cores but one, as in `view`); views that were cached with another number are "
        "rendered anew, as they may differ in their last bits",
    )
    add("--no-cache", action="store_true", help="render every missing frame; neither read nor fill the view cache")
    add("--dry-run", action="store_true", help="print the plan and its estimated cost, do nothing")
    add("--quiet", action="store_true", help="no progress")


def run_render(options: argparse.Namespace, show: "Progress") -> int:
    """0 done, or 130 where it was interrupted; raises `InputError` for what cannot be."""
    from scenes.errors import InputError

    _check(options)

    from harness.device import chosen_device, keep_freed_memory, rendering_threads, use_threads
    from harness.filming.film import filmed
    from harness.filming.folder import claim
    from harness.filming.plan import planned
    from harness.filming.takes import Wish
    from harness.finished import FinishedRun
    from harness.folder_lock import locked_folder

    device = chosen_device(options.device)
    use_threads(options.threads or rendering_threads())
    keep_freed_memory()
    run = FinishedRun.of(options.run)
    wish = Wish(
        path=options.path,
        frames=options.frames,
        resolution=options.resolution,
        elevation=options.elevation,
        seed=options.seed,
    )
    cache = options.run / "view_cache"
    # a dry run writes nothing, not even an empty cache
    disk = None if options.no_cache or (options.dry_run and not cache.is_dir()) else cache
    folder = options.to or options.run / "films" / wish.name
    try:
        plan = planned(run, options.scenes, options.methods, wish, folder, options.view_sets, disk, device)
        for line in plan.lines():
            (print if options.dry_run else show.line)(line)
        if options.dry_run:
            return 0
        with locked_folder(folder, "--to"):
            claim(folder, wish, run.out, show.line)
            for line in filmed(plan, options.fps, show):
                show.line(line)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EIO):
            raise
        raise InputError(
            f"{error.filename or folder}: {error.strerror or error}; mend that and give the same command again: "
            "finished frames are kept"
        ) from error
    except KeyboardInterrupt:
        show.close()
        print(f"interrupted: finished frames are kept in {folder}; the same command goes on", file=sys.stderr)  # noqa: T201
        return 130
    return 0


def _check(options: argparse.Namespace) -> None:
    """Raises `InputError` for numbers that no film can be made with."""
    from scenes.errors import InputError

    bounds = {
        "frames": (1, MOST_FRAMES),
        "resolution": (1, MOST_PIXELS),
        "fps": (1, MOST_FPS),
        "threads": (1, 256),
        "seed": (0, 2**31),
        "elevation": (-90, 90),
    }
    for name, (least, most) in bounds.items():
        value = getattr(options, name)
        if value is not None and not (math.isfinite(value) and least <= value <= most):
            raise InputError(f"--{name} {value}: must lie between {least} and {most}")
    if options.elevation is not None and options.path != "orbit":
        raise InputError(f"--elevation: --path {options.path} has heights of its own; leave it out")
