"""`python -m harness view | render`: their options, and how they are checked. Nothing heavy is imported for the
help."""

import argparse
import errno
import math
import os
import socket
import sys
import threading
import webbrowser
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette

    from harness.execution.progress import Progress

PORT = 8008
LOOPBACK = ("127.0.0.1", "localhost", "::1")


def add_view_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    finished = "output folder of a finished run (default: out/latest)"
    add("out", type=Path, nargs="?", default=Path("out/latest"), metavar="OUT", help=finished)
    add("--scene", metavar="SCENE", help="scene to begin with (default: the first that was trained)")
    add("--methods", nargs="+", metavar="METHOD", help="to begin with (default: nerf qnerf, else the first two)")
    add("--seed", type=int, default=0, metavar="N", help="of the runs to show (default: 0)")
    add("--host", default="127.0.0.1", metavar="ADDRESS", help="to listen on (default: this machine alone)")
    add("--port", type=int, default=PORT, metavar="N", help=f"0 takes a free one (default: {PORT})")
    add("--no-browser", action="store_true", help="print the address, open nothing")
    add("--threads", type=int, metavar="N", help="that render (default: all cores but one)")
    add("--resolution", type=int, metavar="PX", help="width of the pictures (default: that of the run's views)")
    add("--device", default="auto", choices=("auto", "cpu", "cuda"), help="ROCm is torch's cuda")
    add(
        "--mask",
        type=Path,
        metavar="FILE",
        help="image, stretched over the picture: its bright pixels can be attended",
    )
    add("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR", help="cache of view sets")


def run_view(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0 when it was stopped; raises `InputError` for invalid options."""
    try:
        return _run_view(options, show)
    except KeyboardInterrupt:
        return 0


def _run_view(options: argparse.Namespace, show: "Progress") -> int:
    from harness.machine.device import chosen_device, rendering_threads, use_threads
    from harness.viewer.asked import LARGEST_WIDTH
    from harness.viewer.attended import read_mask
    from harness.viewer.shown_run import ShownRun
    from scenes.files.errors import InputError

    if not 0 <= options.port <= 65535:
        raise InputError(f"--port {options.port}: must lie between 0 and 65535")
    if options.threads is not None and not 1 <= options.threads <= 256:
        raise InputError(f"--threads {options.threads}: must lie between 1 and 256")
    if options.resolution is not None and not 8 <= options.resolution <= LARGEST_WIDTH:
        raise InputError(f"--resolution {options.resolution}: must lie between 8 and {LARGEST_WIDTH}")
    shown = ShownRun.of(
        options.out,
        options.scene,
        options.methods,
        options.seed,
        options.view_sets,
        options.resolution,
        chosen_device(options.device),
        None if options.mask is None else read_mask(options.mask),
    )
    listening = bound(options.host, options.port)
    threads = options.threads or rendering_threads()

    from harness.viewer.server import Announced, application

    # torch's number of threads is one of each thread's own settings
    worker = ThreadPoolExecutor(1, "render", initializer=use_threads, initargs=(threads,))
    port = listening.getsockname()[1]
    site = application(shown, worker, hosts_of(options.host))
    config = config_of(site)
    address = f"http://{_in_address(options.host)}:{port}/"
    if options.host not in LOOPBACK:
        print(
            f"warning: --host {options.host}: whoever reaches this machine can look at {options.out} and have views "
            "rendered; there is no password",
            file=sys.stderr,
        )

    def announce() -> None:
        show.line(f"{options.out} on {address} (Ctrl-C ends it)")
        if not options.no_browser and _has_screen():
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    try:
        Announced(config, announce).run(sockets=[listening])
    finally:
        worker.shutdown(wait=False, cancel_futures=True)
    return 0


def config_of(site: "Starlette") -> "uvicorn.Config":
    """Return a configuration that logs nothing of its own, and waits for nobody at the end."""
    import uvicorn

    return uvicorn.Config(
        site,
        log_config=None,
        log_level="critical",
        lifespan="off",
        ws="none",
        server_header=False,
        timeout_graceful_shutdown=0,
    )


def bound(host: str, port: int) -> socket.socket:
    """Return a socket that listens; raises `InputError` for an address that is not this machine's or is in use."""
    from scenes.files.errors import InputError

    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(128)
    except OSError as error:
        found.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(f"--port {port}: another program listens there; --port 0 takes a free one") from error
        if error.errno == errno.EACCES:
            raise InputError(f"--port {port}: not allowed; choose one above 1023, or --port 0") from error
        raise InputError(f"--host {host}: not an address of this machine ({error.strerror or error})") from error
    except (UnicodeError, ValueError) as error:
        found.close()
        raise InputError(f"--host {host!r}: not an address") from error
    return found


def hosts_of(host: str) -> list[str]:
    """Return the names under which the page may be requested. A name that an attacker's own server gives this machine
    (DNS rebinding) is not among them.
    """
    names = {"127.0.0.1", "localhost", "[::1]"}
    if host not in LOOPBACK:
        here = socket.gethostname()
        names |= {_in_address(host), here, socket.getfqdn()}
        with suppress(OSError):
            names |= {_in_address(str(entry[4][0])) for entry in socket.getaddrinfo(here, None)}
    return sorted(name.lower() for name in names if name and "*" not in name)


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _has_screen() -> bool:
    """Whether there is a screen; elsewhere a browser that runs in the terminal would be opened."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


PATH_NAMES = ("orbit", "spiral", "walk", "test")
"""The names of `harness.playback.camera_paths.PATHS`, and the test views themselves."""
MOST_FRAMES = 10_000
MOST_PIXELS = 4096
MOST_FPS = 60


def add_render_options(command: argparse.ArgumentParser) -> None:
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
    """Return 0 when done, or 130 if it was interrupted; raises `InputError` for invalid options."""
    from scenes.files.errors import InputError

    _check(options)

    from harness.machine.device import chosen_device, keep_freed_memory, rendering_threads, use_threads
    from harness.playback.run_loader import FinishedRun
    from harness.run_folder.folder_lock import locked_folder
    from harness.viewer.film.film_folder import claim
    from harness.viewer.film.film_making import filmed
    from harness.viewer.film.film_plan import planned
    from harness.viewer.film.takes import FilmSpec

    device = chosen_device(options.device)
    use_threads(options.threads or rendering_threads())
    keep_freed_memory()
    run = FinishedRun.of(options.run)
    wish = FilmSpec(
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
        print(f"interrupted: finished frames are kept in {folder}; the same command goes on", file=sys.stderr)
        return 130
    return 0


def _check(options: argparse.Namespace) -> None:
    """Raise `InputError` for numbers that no film can be made with."""
    from scenes.files.errors import InputError

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
