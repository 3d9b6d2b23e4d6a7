"""The contents of a film's folder, and the type of the fixture that renders."""

import json
from collections.abc import Callable
from pathlib import Path

from scenes.view_sets.images import read_channels

Said = Callable[..., str]
"""Render with the given options, on one thread; returns the printed lines."""


def contents(folder: Path) -> dict[str, object]:
    """Return the bytes of every file; of an EXR, which holds the time of day, only its pixels."""
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
