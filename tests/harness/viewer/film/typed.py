"""What a film's folder holds, and how a fixture renders."""

import json
from collections.abc import Callable
from pathlib import Path

from scenes.view_sets.images import read_channels

Said = Callable[..., str]
"""Renders with the given options, on one thread, and gives what was said."""


def contents(folder: Path) -> dict[str, object]:
    """Every file to the last bit, but of an EXR, which holds the time of day, its pixels."""
    files: dict[str, object] = {}
    for file in folder.rglob("*"):
        if file.suffix == ".exr":
            channels = read_channels(file)
            files[str(file.relative_to(folder))] = {name: values.tobytes() for name, values in channels.items()}
        elif file.name == "frames.json":
            frames = json.loads(file.read_text(encoding="utf-8"))
            files[str(file.relative_to(folder))] = {
                name: (frame["key"], frame[".png"]) for name, frame in frames.items()
            }
        elif file.is_file():
            files[str(file.relative_to(folder))] = file.read_bytes()
    return files
