"""`python -m harness view | render | splats`; nothing heavy is imported for the help."""

import argparse
import errno
import os
import socket
import sys
import threading
import webbrowser
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.options import FINISHED_RUN, Command, Options, flag, option, require_between, require_use, shared
from harness.execution.progress import Progress
from scenes.files.atomic import require_suffix, write_atomically
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette


PORT = 8008
LOOPBACK = ("127.0.0.1", "localhost", "::1")
VIEW: Options = {
    "out": FINISHED_RUN,
    "--scene": option("scene to begin with (default: the first that was trained)", "SCENE"),
    "--methods": option("methods to begin with (default: baseline and first contender)"),
    "--seed": {},
    "--host": option("address to listen on (default: only this machine)", "ADDRESS", default="127.0.0.1"),
    "--port": option(f"port; 0 takes a free one (default: {PORT})", "N", int, default=PORT),
    "--no-browser": flag("only print the address"),
    **shared("--threads", "--resolution", "--device", "--view-sets"),
}


def run_view(options: argparse.Namespace, show: Progress) -> int:
    with suppress(KeyboardInterrupt):  # the usual end
        _serve_view(options, show)
    return 0


def _serve_view(options: argparse.Namespace, show: Progress) -> None:
    from harness.machine.device import chosen_device, rendering_threads, use_threads
    from harness.viewer.requests import LARGEST_WIDTH
    from harness.viewer.shown_run import ShownRun

    require_between(options, port=(0, 65535), threads=(1, 256), resolution=(8, LARGEST_WIDTH))
    shown = ShownRun.of(
        options.out,
        options.scene,
        options.methods,
        options.seed,
        options.view_sets,
        options.resolution,
        chosen_device(options.device),
    )
    listening = bound(options.host, options.port)
    threads = options.threads or rendering_threads()

    from harness.viewer.server import Announced, application

    # torch keeps a number of threads for each thread
    worker = ThreadPoolExecutor(1, "render", initializer=use_threads, initargs=(threads,))
    port = listening.getsockname()[1]
    config = config_of(application(shown, worker, hosts_of(options.host)))
    address = f"http://{_in_address(options.host)}:{port}/"
    if options.host not in LOOPBACK:
        print(
            f"warning: --host {options.host}: everyone who reaches this machine can view {options.out} and have views "
            "rendered; there is no password",
            file=sys.stderr,
        )

    def announce() -> None:
        show.line(f"{options.out} on {address} (Ctrl-C ends it)")
        has_display = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
        if not options.no_browser and (has_display or sys.platform in ("darwin", "win32")):
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    try:
        Announced(config, announce).run(sockets=[listening])
    finally:
        worker.shutdown(wait=False, cancel_futures=True)


def config_of(site: "Starlette") -> "uvicorn.Config":
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
    """Return a listening socket; raises `InputError` for an address that is in use or not one of this machine."""
    listener = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(128)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise InputError(f"--port {port}: another program listens there; --port 0 takes a free one") from error
        if error.errno == errno.EACCES:
            raise InputError(f"--port {port}: not allowed; choose one above 1023, or --port 0") from error
        raise InputError(f"--host {host}: not an address of this machine ({error.strerror or error})") from error
    except (UnicodeError, ValueError) as error:
        listener.close()
        raise InputError(f"--host {host!r}: not an address") from error
    return listener


def hosts_of(host: str) -> list[str]:
    """Return the names under which the page may be requested, which refuses those of attackers (DNS rebinding)."""
    names = {"127.0.0.1", "localhost", "[::1]"}
    if host not in LOOPBACK:
        here = socket.gethostname()
        names |= {_in_address(host), here, socket.getfqdn()}
        with suppress(OSError):
            names |= {_in_address(str(entry[4][0])) for entry in socket.getaddrinfo(here, None)}
    return sorted(name.lower() for name in names if name and "*" not in name)


def _in_address(host: str) -> str:
    return f"[{host}]" if ":" in host else host


PATH_NAMES = ("orbit", "spiral", "walk", "test")
"""The names of `harness.playback.camera_paths.PATHS`, and the test views."""
MOST_FRAMES = 10_000
RENDER: Options = {
    "run": FINISHED_RUN,
    "--path": option("where the camera goes (default: orbit)", default="orbit", choices=PATH_NAMES),
    "--scenes": {},
    "--methods": option("methods side by side (default: baseline and first contender)"),
    "--seed": {},
    "--frames": option("number of frames (default: 60; with --path test all test views of the run)", "N", int),
    "--resolution": {},
    "--fps": option("frames per second of the animation (default: 20)", "N", int, default=20),
    "--elevation": option("height of an orbit above the horizon (default: 30)", "DEG", float),
    "--to": option("folder to write to or to resume (default: OUT/films/…)", "DIR", Path),
    "--view-sets": option("cache of view sets, for --path test"),
    "--device": {},
    "--threads": option(
        "threads of rendering (default: all cores but one, as in `view`); views that were cached with another number "
        "are rendered again, as they may differ in their last bits"
    ),
    "--no-cache": flag("render every missing frame; neither read nor fill the view cache"),
    **shared("--dry-run", "--quiet"),
}


def run_render(options: argparse.Namespace, show: Progress) -> int:
    require_between(options, frames=(1, MOST_FRAMES), resolution=(1, 4096), fps=(1, 60))
    require_between(options, threads=(1, 256), seed=(0, 2**31), elevation=(-90, 90))
    require_use(options, "with --path orbit", options.path == "orbit", "elevation")

    from harness.machine.device import chosen_device, keep_freed_memory, rendering_threads, use_threads
    from harness.machine.stopping import told_when_stopped
    from harness.playback.run_loader import FinishedRun
    from harness.run_folder.folder_lock import locked_folder
    from harness.viewer.film.film_folder import claim
    from harness.viewer.film.film_making import make_film
    from harness.viewer.film.film_plan import plan_film
    from harness.viewer.film.takes import FilmSpec

    device = chosen_device(options.device)
    use_threads(options.threads or rendering_threads())
    keep_freed_memory()
    run = FinishedRun.of(options.run)
    names = ("path", "frames", "resolution", "elevation", "seed")
    film = FilmSpec(**{name: getattr(options, name) for name in names})
    cache = options.run / "view_cache"
    # a dry run writes nothing, not even an empty cache
    disk = None if options.no_cache or (options.dry_run and not cache.is_dir()) else cache
    folder = options.to or options.run / "films" / film.name
    try:
        with told_when_stopped(lambda: f"finished frames are kept in {folder}; the same command resumes"):
            plan = plan_film(run, options.scenes, options.methods, film, folder, options.view_sets, disk, device)
            for line in plan.lines():
                (print if options.dry_run else show.line)(line)
            if options.dry_run:
                return 0
            with locked_folder(folder, "--to"):
                claim(folder, film, run.out, show.line)
                for line in make_film(plan, options.fps, show):
                    show.line(line)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EIO):
            raise
        raise InputError(
            f"{error.filename or folder}: {error.strerror or error}; repair that and give the same command again: "
            "finished frames are kept"
        ) from error
    return 0


SPLATS: Options = {
    "run": FINISHED_RUN,
    "--scene": option("scene of the run (default: the first that was trained)", "SCENE"),
    "--method": option("method that trains Gaussians (default: the first of the run)", "METHOD"),
    "--seed": {},
    "--to": option("file to write (default: OUT/SCENE-METHOD-SEED.ply)", "FILE", Path),
}


def run_splats(options: argparse.Namespace, show: Progress) -> int:
    import torch

    from baselines.catalog import CATALOG
    from baselines.methods.explicit import GaussianSettings
    from baselines.splats.gaussians import Gaussians
    from baselines.splats.ply import ply_bytes
    from harness.playback.run_loader import FinishedRun

    run = FinishedRun.of(options.run)
    (scene, *_) = run.scenes([options.scene] if options.scene else None, "--scene")
    of_run = [*run.run.methods, *run.run.guests]
    explicit = [name for name in of_run if name in CATALOG and isinstance(CATALOG[name].settings, GaussianSettings)]
    method = options.method or next(iter(explicit), "splats")
    file = options.to or options.run / f"{scene.name}-{method}-{options.seed}.ply"
    require_suffix(file, ".ply", "--to")
    learner = run.trained(scene, method, options.seed, torch.device("cpu")).learner
    if not isinstance(field := learner.field, Gaussians):
        raise InputError(f"--method {method}: has no Gaussians; train some with --methods splats")
    try:
        write_atomically(file, ply_bytes(field))
    except OSError as error:
        raise InputError(f"--to {file}: cannot be written ({error.strerror}); choose another file") from error
    show.line(f"{file}: {len(field.values)} Gaussians of {method} on {scene.name}, in the units of its view set")
    return 0


COMMANDS = {
    "view": Command("view a finished run in the browser", VIEW, run_view),
    "render": Command("render a camera path through a finished run, its methods side by side", RENDER, run_render),
    "splats": Command("write the Gaussians of a finished run as .ply, for viewers of splats", SPLATS, run_splats),
}
