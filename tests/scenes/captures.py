"""Captures as other programs write them, the original loader of the Blender format, and damage."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenes.view_sets.images import read_image, write_png

Edit = Callable[[dict[str, Any]], object]


def edit(folder: Path, change: Edit, name: str = "transforms.json") -> Path:
    file = folder / name
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))
    return folder


def flip(file: Path, place: int | None = None) -> None:
    """Change one bit of a file, in its middle unless the byte is given."""
    data = bytearray(file.read_bytes())
    data[len(data) // 2 if place is None else place] ^= 4
    file.write_bytes(data)


def capture(folder: Path, count: int, poses: np.ndarray, channels: int = 3, **more: Any) -> Path:
    """As `ns-process-data` writes it: RGB images, no splits, no region; 16 × 8 pixels."""
    (folder / "images").mkdir(parents=True)
    for i in range(count):
        write_png(folder / "images" / f"frame_{i:05d}.png", np.full((8, 16, channels), i / count))
    frames = [
        {"file_path": f"images/frame_{i:05d}.png", "transform_matrix": poses[i].tolist(), "colmap_im_id": i}
        for i in range(count)
    ]
    lens = {"w": 16, "h": 8, "fl_x": 20.0, "fl_y": 20.0, "cx": 8.0, "cy": 4.0, "k1": 0.0, "p2": 0}
    lens |= {"camera_model": "OPENCV"}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames[::-1], **more}))
    return folder


def as_load_blender(folder: Path) -> dict[str, tuple[list[Path], np.ndarray, float]]:
    """As `load_blender_data` of nerf-pytorch: every split there, with a view at least, `.png` added to each path."""
    result = {}
    for split in ("train", "val", "test"):
        meta = json.loads((folder / f"transforms_{split}.json").read_text())
        files = [folder / f"{frame['file_path']}.png" for frame in meta["frames"]]
        assert files
        assert all(read_image(file).shape[2] == 4 for file in files)
        result[split] = files, np.array([f["transform_matrix"] for f in meta["frames"]]), float(meta["camera_angle_x"])
    return result
