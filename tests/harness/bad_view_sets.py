"""Ways to spoil a view set in the Blender format; each takes a folder that is whole."""

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


def _matrix(value: Any) -> Callable[[Path], None]:
    return lambda folder: _edit(folder, lambda data: data["frames"][1].update(transform_matrix=value))


def _path(value: Any) -> Callable[[Path], None]:
    return lambda folder: _edit(folder, lambda data: data["frames"][1].update(file_path=value))


def _first_matrix_entry(value: float) -> Callable[[Path], None]:
    def spoil(data: dict[str, Any]) -> None:
        data["frames"][1]["transform_matrix"][0][0] = value

    return lambda folder: _edit(folder, spoil)


def _image(name: str, content: bytes | np.ndarray | None) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        file = folder / name
        if content is None:
            file.unlink()
        elif isinstance(content, bytes):
            file.write_bytes(content)
        else:
            write_png(file, content)

    return spoil


def _truncate(folder: Path) -> None:
    file = folder / "train" / "r_2.png"
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
    "not an object": (
        lambda folder: (folder / "transforms_train.json").write_text("[]"),
        "Expected `object`, got `array`",
    ),
    "NaN matrix": (_first_matrix_entry(float("nan")), "NaN"),
    "singular matrix": (_matrix([[0, 0, 0, 0]] * 3 + [[0, 0, 0, 1]]), "r_1"),
    "short matrix": (_matrix([[1, 0, 0, 0]]), "of length 4, got 1 - at `$.frames[1].transform_matrix`"),
    "no matrix": (_matrix(None), "got `null` - at `$.frames[1].transform_matrix`"),
    "no angle": (lambda folder: _edit(folder, lambda data: data.pop("camera_angle_x")), "camera_angle_x"),
    "no frames": (lambda folder: _edit(folder, lambda data: data.update(frames=[])), "of length >= 1 - at `$.frames`"),
    "path out of the folder": (_path("../../../etc/passwd"), "leaves the folder"),
    "absolute path": (_path("/etc/passwd"), "leaves the folder"),
    "the same image twice": (_path("./train/r_0"), "list each image once"),
    "missing image": (_image("train/r_2.png", None), "r_2"),
    "empty image": (_image("train/r_2.png", b""), "empty"),
    "no image": (_image("train/r_2.png", b"hello, I am a text"), "r_2.png"),
    "truncated image": (_truncate, "truncated or damaged"),
    "truncated test image": (
        lambda folder: (folder / "test" / "r_0.png").write_bytes((folder / "test" / "r_0.png").read_bytes()[:90]),
        "truncated or damaged",
    ),
    "no alpha": (_image("train/r_2.png", np.full((24, 24, 3), 0.5)), "no alpha"),
    "another size": (_image("train/r_2.png", np.full((20, 24, 4), 0.5)), "one size"),
    "a manifest of another version": (
        lambda folder: (folder / "view_set.json").write_text('{"format": "radiance-verdict view set", "schema": 99}'),
        "schema 99",
    ),
}
"""What is wrong → how to do it, and what the message must say."""
