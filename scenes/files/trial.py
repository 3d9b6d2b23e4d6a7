"""A user's code is tried in a separate process first: it may end its process, and must not silently end this one."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

_CHILD = """
import os, sys
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


def how_it_ends(code: str, *arguments: str) -> str:
    """Return a text that says how Python `code`, with the list `arguments`, ended its process; empty if it finished, or
    raised an exception that this process can catch. Its output is not shown.
    """
    with tempfile.TemporaryDirectory() as folder:
        outcome = Path(folder) / "outcome"
        command = [sys.executable, "-c", _CHILD, code, str(outcome), os.pathsep.join(map(os.path.abspath, sys.path))]
        quiet = subprocess.DEVNULL
        ended = subprocess.run([*command, *arguments], stdin=quiet, stdout=quiet, stderr=quiet, check=False).returncode
        text = outcome.read_text(encoding="utf-8") if outcome.exists() else ""
    if text:
        return "" if text == "done" else text
    return f"ends the process with {f'signal {-ended}' if ended < 0 else f'exit code {ended}'}"
