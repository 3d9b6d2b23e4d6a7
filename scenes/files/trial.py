"""Somebody's code, tried in a process of its own first: it may end its process, and must not end ours in silence."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

_CHILD = """
import os, sys
sys.path[:0] = sys.argv[3].split(os.pathsep)
told = "done"
try:
    exec(sys.argv[1], {"arguments": sys.argv[4:]})
except KeyboardInterrupt:
    told = "raises KeyboardInterrupt"
except BaseException:  # which the caller meets as well, and can name
    pass
open(sys.argv[2], "w").write(told)
"""


def how_it_ends(code: str, *arguments: str) -> str:
    """Return in words how Python `code`, which finds `arguments`, ended its process; empty if it came to its end, or
    raised what our own process can catch. What it prints is not shown.
    """
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "told"
        command = [sys.executable, "-c", _CHILD, code, str(told), os.pathsep.join(map(os.path.abspath, sys.path))]
        quiet = subprocess.DEVNULL
        ended = subprocess.run([*command, *arguments], stdin=quiet, stdout=quiet, stderr=quiet, check=False).returncode
        text = told.read_text(encoding="utf-8") if told.exists() else ""
    if text:
        return "" if text == "done" else text
    return f"ends the process with {f'signal {-ended}' if ended < 0 else f'exit code {ended}'}"
