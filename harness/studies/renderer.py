"""Runs `python -m scenes` as a separate process that prints rows of JSON, so that this one never imports Mitsuba."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence

from scenes.files.json_object import JsonObject


def printed_rows(
    words: Sequence[str],
    on_row: Callable[[JsonObject], object],
    environment: Mapping[str, str] | None = None,
    module: str = "scenes",
) -> tuple[int, str]:
    """Call `on_row` with each row as soon as it is printed; return the exit code and the error output."""
    command = [sys.executable, "-m", module, *words]
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=complaints, text=True, env={**os.environ, **(environment or {})}
        ) as process,
    ):
        assert process.stdout is not None
        try:
            for line in process.stdout:
                on_row(json.loads(line))
            process.wait()
        finally:
            process.kill()
        complaints.seek(0)
        return process.returncode, complaints.read().strip()
