"""A user's code is tried in a separate process first: it may end its process, never end, or leave processes behind."""

import os
import signal
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

LIMIT = 180.0
"""The seconds within which code must end."""
# standard input ends with the process that tries the code, however that ends
_CHILD = """
import os, signal, sys, threading
watched = os.dup(0)
os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
threading.Thread(target=lambda: os.read(watched, 1) or os.killpg(0, signal.SIGKILL), daemon=True).start()
sys.path[:0] = sys.argv[3].split(os.pathsep)
outcome = "done"
try:
    exec(sys.argv[1], {"arguments": sys.argv[4:]})
except KeyboardInterrupt:
    outcome = "raises KeyboardInterrupt"
except BaseException:  # the caller gets the same error and can name it
    pass
open(sys.argv[2], "w").write(outcome)
"""


def how_it_ends(code: str, *arguments: str, limit: float = LIMIT) -> str:
    """Return a text that says how Python `code`, with the list `arguments`, ended its process; empty if it finished, or
    raised an exception that this process can catch. Its output is not shown. After `limit` seconds, or if this process
    is stopped, it is ended with all processes that it started.
    """
    with tempfile.TemporaryDirectory() as folder:
        outcome = Path(folder) / "outcome"
        command = [sys.executable, "-c", _CHILD, code, str(outcome), os.pathsep.join(map(os.path.abspath, sys.path))]
        quiet = subprocess.DEVNULL
        tried = subprocess.Popen(
            [*command, *arguments], stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, start_new_session=True
        )
        try:
            ended = tried.wait(limit)
        except subprocess.TimeoutExpired:
            return f"does not end within {limit:g} s"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(tried.pid, signal.SIGKILL)
            tried.wait()
            assert tried.stdin is not None
            tried.stdin.close()
        text = outcome.read_text(encoding="utf-8") if outcome.exists() else ""
    if text:
        return "" if text == "done" else text
    return f"ends the process with {f'signal {-ended}' if ended < 0 else f'exit code {ended}'}"
