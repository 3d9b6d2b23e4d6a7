"""`python -m scenes noise` asked from here: the harness never imports Mitsuba, and Dr.Jit may end that process."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from typing import Any, Literal

from scenes.errors import InputError

Rows = dict[str, list[dict[str, Any]]]
"""Folder or scene → what was printed about it."""


def noise_rows(
    kind: Literal["folders", "scenes"],
    items: Sequence[str],
    options: Sequence[str] = (),
    say: Callable[[str], None] = lambda line: None,
    module: str = "scenes",
) -> Rows:
    """All rows of each of `items`, in order. `say` gets a line when an item is begun.

    Where a signal ends the process, the item that it was at and those behind are done once more with `scalar_rgb`.
    Raises `InputError` with what the renderer says of wrong input, `RuntimeError` where it fails otherwise.
    """
    rows, code, said = _asked(kind, items, options, say, module)
    if code < 0:
        say(f"rendering was ended by signal {-code}; going on with scalar_rgb")
        whole = list(rows)[:-1]
        rest = [item for item in items if item not in whole]
        again, code, said = _asked(kind, rest, [*options, "--variant", "scalar_rgb"], say, module)
        rows = {item: rows[item] for item in whole} | again
    if code == 2:
        raise InputError(said.removeprefix("scenes: "))
    if code:
        raise RuntimeError(f"rendering ended with exit code {code}: {said[-2000:]}")
    return rows


def _asked(
    kind: str, items: Sequence[str], options: Sequence[str], say: Callable[[str], None], module: str
) -> tuple[Rows, int, str]:
    """Rows so far, exit code and complaints."""
    rows: Rows = {}
    with tempfile.TemporaryFile("w+") as complaints:
        command = [sys.executable, "-m", module, "noise", f"--{kind}", *items, *options]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True)
        assert process.stdout is not None
        try:
            for line in process.stdout:
                row = json.loads(line)
                if row["item"] not in rows:
                    say(f"rendering {row['scene']} ({len(rows) + 1} of {len(items)})")
                rows.setdefault(row["item"], []).append(row)
            code = process.wait()
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            process.stdout.close()
        complaints.seek(0)
        return rows, code, complaints.read().strip()
