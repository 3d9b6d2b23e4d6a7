"""The page of a run that still trains, written again as groups end, by a process of its own.

It has a low priority and takes at most a tenth of the time of one core, so that training hardly waits for it.
"""

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

NICENESS = 10
MOST = 0.1
"""The maximum share of one core's time."""


class LivePage:
    """Renews `OUT/report.html`, which is replaced atomically: an open page stays whole."""

    def __init__(self, out: Path, say: Callable[[str], None]) -> None:
        self._out, self._say = out, say
        self._process: subprocess.Popen[bytes] | None = None
        self._began = self._spent = self._cost = 0.0
        self._shown = False

    def renew(self) -> None:
        """Begin to write the page, unless one is being written or the last is too recent. Say once where it is."""
        now = time.monotonic()
        if not self._is_ready():
            return
        if not self._shown and (self._out / "report.html").is_file():
            self._shown = True
            self._say(f"page of the run so far: {self._out / 'report.html'}")
        if self._began and now - self._began < self._cost / MOST:
            return
        self._began, self._spent = now, _spent_by_children()
        command = ["nice", "-n", str(NICENESS), sys.executable, "-m", "reports", str(self._out), "--partial", "--quiet"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        """End the writing; the page stays as it was written last."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _is_ready(self) -> bool:
        """Return whether no page is being written; note the cost of the last."""
        if self._process is None:
            return True
        if self._process.poll() is None:
            return False
        self._process, self._cost = None, _spent_by_children() - self._spent
        return True


def _spent_by_children() -> float:
    """Return the processor seconds of ended child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
