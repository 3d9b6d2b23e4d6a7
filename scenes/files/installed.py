"""Errors around a command: a missing package ends it with one line, a reader that stops ends it silently."""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PACKAGES = ("scenes", "baselines", "harness", "reports")
OF_UNIX = ("resource", "pwd", "termios")
"""Modules of the standard library that Windows lacks."""


@contextmanager
def packages_needed() -> Iterator[None]:
    """Wrap a command: if a package is not installed, the command ends with a line about it and exit code 2.

    Import errors within a user's scene file or package are reported where it is read, and do not arrive here. If
    standard output is closed, as by `| head`, the command ends silently. Matplotlib gets no backend of a notebook.
    """
    os.environ["MPLBACKEND"] = "Agg"  # no command shows a window, and a notebook's backend cannot be imported here
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        output = select.poll()
        output.register(sys.stdout, select.POLLERR)
        if not output.poll(0):  # standard output is still read
            raise  # another pipe, such as a worker's
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # where the interpreter's own flush goes
        sys.exit(1)
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name in PACKAGES:
            raise
        if name in OF_UNIX:
            sys.stderr.write(f"error: Python has no {name} on this system; this program runs on Linux and macOS\n")
            sys.exit(2)
        sys.stderr.write(
            f"error: {sys.executable} has no package {name}; activate the environment that nox made "
            "(. .nox/benchmark/bin/activate), or see what is missing with `python -m harness doctor`\n"
        )
        sys.exit(2)
