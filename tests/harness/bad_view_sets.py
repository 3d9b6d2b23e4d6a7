"""Ways to damage a view set in the Blender format; each takes a valid folder."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenes.view_sets.images import write_png


def _edit(folder: Path, change: Callable[[dict[str, Any]], Any], split: str = "train") -> None:
    file = folder / f"transforms_{split}.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    change(data)
    file.write_text(json.dumps(data), encoding="utf-8")  # NaN included, as Python writes it


def _frame(**values: Any) -> Callable[[Path], None]:
    return lambda folder: _edit(folder, lambda data: data["frames"][1].update(values))


def _truncate(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def _all_poses(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def spoil(data: dict[str, Any]) -> None:
        for frame in data["frames"]:
            frame["transform_matrix"] = change(np.array(frame["transform_matrix"])).tolist()

    def spoil_both(folder: Path) -> None:
        for split in ("train", "test"):
            _edit(folder, spoil, split)

    return spoil_both


SPOILT: dict[str, tuple[Callable[[Path], None], str]] = {
    "no poses": (lambda folder: (folder / "transforms_train.json").unlink(), "transforms_train.json"),
    "no test poses": (lambda folder: (folder / "transforms_test.json").unlink(), "transforms_test.json"),
    "axes of OpenCV": (_all_poses(lambda pose: pose @ np.diag([1.0, -1.0, -1.0, 1.0])), "have OpenCV's axes"),
    "poses far away": (_all_poses(lambda pose: pose + 1e3 * np.eye(4, k=3)), "(--bounds)"),
    "not JSON": (lambda folder: (folder / "transforms_train.json").write_text("{"), "not valid JSON"),
    "NaN matrix": (_frame(transform_matrix=[[float("nan")] * 4] * 4), "NaN"),
    "no frames": (lambda folder: _edit(folder, lambda data: data.update(frames=[])), "of length >= 1 - at `$.frames`"),
    "path out of the folder": (_frame(file_path="../../../etc/passwd"), "leaves the folder"),
    "missing image": (lambda folder: (folder / "train/r_2.png").unlink(), "r_2"),
    "truncated test image": (lambda folder: _truncate(folder / "test/r_0.png"), "truncated or damaged"),
    "no alpha": (lambda folder: write_png(folder / "train/r_2.png", np.full((24, 24, 3), 0.5)), "no alpha"),
    "another size": (lambda folder: write_png(folder / "train/r_2.png", np.full((20, 24, 4), 0.5)), "one size"),
    "a manifest of another version": (
        lambda folder: (folder / "view_set.json").write_text('{"format": "radiance-verdict view set", "schema": 99}'),
        "schema 99",
    ),
}
"""Map damage → the function that does it, and a part of the message."""
