"""Ways to damage a view set in the Blender format, for each stage of reading it; `tests/scenes/view_sets` has all."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np


def _truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _all_poses(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        for file in folder.glob("transforms_*.json"):
            data = json.loads(file.read_text(encoding="utf-8"))
            for frame in data["frames"]:
                frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()
            file.write_text(json.dumps(data), encoding="utf-8")

    return spoil


SPOILT: dict[str, tuple[Callable[[Path], None], str]] = {
    "no poses": (lambda folder: (folder / "transforms_train.json").unlink(), "transforms_train.json"),
    "axes of OpenCV": (_all_poses(lambda pose: pose @ np.diag([1.0, -1.0, -1.0, 1.0])), "have OpenCV's axes"),
    "poses far away": (_all_poses(lambda pose: pose + 1e3 * np.eye(4, k=3)), "(--bounds)"),
    "missing image": (lambda folder: (folder / "train/r_2.png").unlink(), "r_2"),
    "truncated test image": (lambda folder: _truncate(folder / "test/r_0.png"), "truncated or damaged"),
    "a manifest of another version": (
        lambda folder: (folder / "view_set.json").write_text('{"format": "radiance-verdict view set", "schema": 99}'),
        "schema 99",
    ),
}
"""Map damage → the function that does it, and a part of the message."""
