"""`python -m harness view`: its options, and how they are checked. Nothing heavy is imported to show the help."""

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

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette

    from harness.progress import Progress

PORT = 8008
LOOPBACK = ("127.0.0.1", "localhost", "::1")


def add_options(command: argparse.ArgumentParser) -> None:
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
    """0 when it was stopped; raises `InputError` for what cannot be."""
    try:
        return _run_view(options, show)
    except KeyboardInterrupt:
        return 0


def _run_view(options: argparse.Namespace, show: "Progress") -> int:
    from harness.device import chosen_device, rendering_threads, use_threads
    from harness.viewer.asked import LARGEST_WIDTH
    from harness.viewer.attended import read_mask
    from harness.viewer.shown_run import ShownRun
    from scenes.errors import InputError

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
        print(  # noqa: T201
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
    """Says nothing of its own, and waits for nobody at the end."""
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
    """A socket that listens; raises `InputError` for an address that is not this machine's or is in use."""
    from scenes.errors import InputError

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
    """Names under which the page may be asked for. A name that an attacker's own server gives this machine (DNS
    rebinding) is not among them.
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
    """Elsewhere a browser that runs in the terminal would be opened."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
