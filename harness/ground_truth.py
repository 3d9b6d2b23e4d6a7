"""View sets for a plan: rendered by Mitsuba in a process of its own, or taken from the cache.

The harness never imports Mitsuba: if Dr.Jit aborts, only that process ends.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.settings import ViewSettings
from scenes.errors import InputError


@dataclass(frozen=True)
class Rendered:
    """Progress of one scene, and its folder once it is complete."""

    scene: str
    done: int
    total: int
    path: Path | None = None


def render_view_sets(scenes: tuple[str, ...], views: ViewSettings, cache: Path) -> Iterator[Rendered]:
    """Yields progress, and a `path` for each scene. Raises `InputError` with what the renderer said."""
    command = [sys.executable, "-m", "scenes", "render", *scenes, "--view-sets", str(cache)]
    for option, value in {
        "resolution": views.resolution,
        "train": views.train,
        "val": views.val,
        "test": views.test,
        "spp-train": views.spp_train,
        "spp-test": views.spp_test,
    }.items():
        command += [f"--{option}", str(value)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        for line in process.stdout:
            message = json.loads(line)
            path = Path(message["path"]) if message.get("path") else None
            yield Rendered(message["scene"], message.get("done", 0), message.get("total", 0), path)
        said = process.stderr.read().strip()
        if process.wait() == 2:
            raise InputError(said)
        if process.returncode != 0:
            raise RuntimeError(f"rendering ended with exit code {process.returncode}: {said[-2000:]}")
    finally:
        if process.poll() is None:
            process.terminate()
            process.wait()
