"""The page of a run that still trains, written again as groups end, by a process of its own.

It has a low priority and takes at most a twentieth of the time of one core, so that training hardly waits for it.
"""

import resource
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

NICENESS = 10
MOST = 0.05
"""The maximum share of one core's time."""


class LivePage:
    """Renews `OUT/report.html`, which is replaced atomically: an open page stays whole."""

    def __init__(self, out: Path, say: Callable[[str], None]) -> None:
        self._out, self._say = out, say
        self._process: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._began: float | None = None
        self._cost = 0.0
        self._shown = False
        self._closed = False

    def renew(self) -> None:
        """Begin to write the page, unless one is being written or the last is too recent."""
        now = time.monotonic()
        if self._thread is not None and self._thread.is_alive():
            return
        if self._began is not None and now - self._began < self._cost / MOST:
            return
        self._began, self._closed = now, False
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the writing; the page stays as it was written last."""
        self._closed = True
        if self._process is not None:
            self._process.kill()
        if self._thread is not None:
            self._thread.join()

    def _write(self) -> None:
        if self._closed:
            return
        spent = _spent_by_children()
        command = ["nice", "-n", str(NICENESS), sys.executable, "-m", "reports", str(self._out), "--partial", "--quiet"]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if self._closed:  # while it was started
            self._process.kill()
        written = self._process.wait() in (0, 3)  # 3: some cell failed
        self._cost = _spent_by_children() - spent
        if written and not self._shown:
            self._shown = True
            self._say(f"page of the run so far: {self._out / 'report.html'}")


def _spent_by_children() -> float:
    """Return the processor seconds of ended child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
