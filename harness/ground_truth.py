"""View sets for a plan: rendered by Mitsuba in a process of its own, or taken from the cache.

The harness never imports Mitsuba: if Dr.Jit aborts, only that process ends.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from harness.settings import ViewSettings
from scenes.errors import InputError

if TYPE_CHECKING:
    from scenes.view_set import ViewSet


@dataclass(frozen=True)
class Rendered:
    """Progress of one scene, and its folder once it is complete."""

    scene: str
    done: int
    total: int
    path: Path | None = None


def read_views(
    folder: Path, views: ViewSettings, scratch: Path, scored_on: Literal["val", "test"] = "test"
) -> "ViewSet":
    """What a cell trains on and is scored on, as its settings ask; decoded images go to `scratch`, a folder on a disk.

    Raises `InputError` for whatever is wrong with the folder.
    """
    from harness.needed import with_needs
    from scenes.view_set import read_view_set

    found = read_view_set(
        folder,
        resolution=views.resolution,
        splits=("train", scored_on),
        train_count=views.train,
        val_count=views.val,
        test_count=views.test,
        scratch=scratch,
    )
    return with_needs(found, views.need, views.no_need)


def render_view_sets(scenes: tuple[str, ...], views: ViewSettings, cache: Path) -> Iterator[Rendered]:
    """Yields progress, and a `path` for each scene. Raises `InputError` with what the renderer said.

    Where Dr.Jit takes its process down in the middle, the scenes that are missing are rendered with `scalar_rgb`.
    """
    missing = list(scenes)
    try:
        for event in _render(missing, views, cache, ()):
            if event.path is not None:
                missing.remove(event.scene)
            yield event
    except _Aborted:
        yield from _render(missing, views, cache, ("--variant", "scalar_rgb"))


class _Aborted(RuntimeError):
    """The renderer's process was ended by a signal."""


def _render(scenes: list[str], views: ViewSettings, cache: Path, options: tuple[str, ...]) -> Iterator[Rendered]:
    command = [sys.executable, "-m", "scenes", "render", *scenes, "--view-sets", str(cache), *options]
    for option, value in {
        "resolution": views.resolution,
        "train": views.train,
        "val": views.val,
        "test": views.test,
        "spp-train": views.spp_train,
        "spp-test": views.spp_test,
    }.items():
        command += [f"--{option}", str(value)]
    for integrator, chosen in {"volpath": views.need, "path": views.no_need}.items():
        if "participating_media" in chosen:
            command += ["--integrator", integrator]
    with tempfile.TemporaryFile("w+") as complaints:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True)
        assert process.stdout is not None
        try:
            for line in process.stdout:
                message = json.loads(line)
                path = Path(message["path"]) if message.get("path") else None
                yield Rendered(message["scene"], message.get("done", 0), message.get("total", 0), path)
            code = process.wait()
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()
            process.stdout.close()
        complaints.seek(0)
        said = complaints.read().strip()
    if code == 2:
        raise InputError(said.removeprefix("scenes: "))
    if code < 0:
        raise _Aborted(f"rendering was ended by signal {-code}: {said[-2000:]}")
    if code:
        raise RuntimeError(f"rendering ended with exit code {code}: {said[-2000:]}")
