"""`transforms_*.json` of other programs: what is read, and what is refused with one clear message."""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.formats.transforms import LARGEST_FILE, read_transforms, write_transforms
from scenes.view_sets.images import write_png
from scenes.view_sets.viewpoints import all_poses

POSES = all_poses("test")[:3]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "lego"
    (root / "train").mkdir(parents=True)
    for number in range(3):
        write_png(root / "train" / f"r_{number}.png", np.full((4, 4, 4), 0.5))
    (tmp_path / "outside.png").write_bytes((root / "train" / "r_0.png").read_bytes())
    write_transforms(root / "transforms_train.json", 0.69, [f"./train/r_{n}" for n in range(3)], POSES)
    return root


def edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    file = folder / "transforms_train.json"
    data = json.loads(file.read_text())
    change(data)
    file.write_text(json.dumps(data))


def test_what_is_written_is_read(folder: Path) -> None:
    frames = read_transforms(folder, "train")
    assert frames.fov_x_radians == 0.69
    assert np.array_equal(frames.camera_to_world, POSES)
    assert [file.name for file in frames.files] == ["r_0.png", "r_1.png", "r_2.png"]
    # the format is that of the field
    data = json.loads((folder / "transforms_train.json").read_text())
    assert set(data) == {"camera_angle_x", "frames"}
    assert set(data["frames"][0]) == {"file_path", "rotation", "transform_matrix"}
    assert data["frames"][1]["file_path"] == "./train/r_1"
    assert np.shape(data["frames"][0]["transform_matrix"]) == (4, 4)


@pytest.mark.parametrize("path", ["train/r_0", "./train/r_0.png", "train//r_0.png", "train\\r_0"])
def test_paths_with_and_without_suffix(folder: Path, path: str) -> None:
    edit(folder, lambda data: data["frames"][0].update(file_path=path))
    assert read_transforms(folder, "train").files[0] == (folder / "train" / "r_0.png").resolve()


def test_a_byte_order_mark_and_unknown_keys_do_no_harm(folder: Path) -> None:
    edit(
        folder,
        lambda data: (data.update(aabb_scale=1, w=4, h=4, cx=2.0, cy=2.0), data["frames"][0].update(sharpness=3)),
    )
    file = folder / "transforms_train.json"
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert len(read_transforms(folder, "train").files) == 3


def test_a_lens_that_is_said_to_be_ours_is_ours(folder: Path) -> None:
    angle = json.loads((folder / "transforms_train.json").read_text())["camera_angle_x"]
    focal = 2.0 / math.tan(angle / 2)
    height = 2 * math.atan(1.5 / focal)
    lens = {"w": 4, "h": 3, "fl_x": focal, "fl_y": focal, "cx": 2, "cy": 1.5, "camera_angle_y": height, "k1": None}
    more = {"distortion_params": [0.0] * 6, "is_orthographic": False, "camera_model": None, "p1": 0, "cx": None}
    edit(folder, lambda data: data.update({**lens, **more}))
    assert read_transforms(folder, "train").fov_x_radians == angle


def matrix_with(row: int, column: int, value: Any) -> list[list[Any]]:
    matrix = copy.deepcopy(POSES[0].tolist())
    matrix[row][column] = value
    return matrix


FRAME_DAMAGE: list[tuple[str, dict[str, Any], str]] = [
    ("no path", {"file_path": None}, "`null` .*file_path"),
    ("path of another type", {"file_path": 5}, "`int` .*file_path"),
    ("empty path", {"file_path": ""}, "file_path"),
    ("path with a zero", {"file_path": "a\0b"}, "file_path"),
    ("path upwards", {"file_path": "../outside"}, "leaves the folder"),
    ("path upwards, hidden", {"file_path": "train/../../outside.png"}, "leaves the folder"),
    ("path upwards, backslashes", {"file_path": "..\\outside.png"}, "leaves the folder"),
    ("absolute path", {"file_path": "/etc/passwd"}, "leaves the folder"),
    ("drive", {"file_path": "C:\\x.png"}, "leaves the folder"),
    ("link outside", {"file_path": "train/link"}, "link out of the folder"),
    ("path too long", {"file_path": "x" * 5000}, "file_path"),
    ("missing image", {"file_path": "./train/r_9"}, "no image"),
    ("folder as image", {"file_path": "./train"}, "no image"),
    ("twice the same", {"file_path": "./train/r_1"}, "list each image once"),
    ("no matrix", {"transform_matrix": None}, "`null` .*transform_matrix"),
    ("three rows", {"transform_matrix": POSES[0].tolist()[:3]}, "four rows"),
    ("ragged", {"transform_matrix": [*POSES[0].tolist()[:3], [0, 0, 1]]}, "four rows"),
    ("text in the matrix", {"transform_matrix": matrix_with(1, 2, "x")}, r"`str` .*transform_matrix\[1\]\[2\]"),
    ("truth in the matrix", {"transform_matrix": matrix_with(0, 0, True)}, "`bool` .*finite numbers"),
    ("huge integer", {"transform_matrix": matrix_with(0, 0, 10**400)}, "finite"),
    ("singular", {"transform_matrix": np.diag([0.0, 0, 0, 1]).tolist()}, "not a rotation"),
    ("scaled", {"transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}, "not a rotation"),
    ("mirrored", {"transform_matrix": np.diag([-1.0, 1, 1, 1]).tolist()}, "not a rotation"),
    ("projective", {"transform_matrix": matrix_with(3, 0, 1.0)}, "last row"),
]


@pytest.mark.parametrize(("change", "message"), [row[1:] for row in FRAME_DAMAGE], ids=[row[0] for row in FRAME_DAMAGE])
def test_bad_frames_are_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    (folder / "train" / "link.png").symlink_to(folder.parent / "outside.png")
    edit(folder, lambda data: data["frames"][0].update(change))
    with pytest.raises(InputError, match=message) as caught:
        read_transforms(folder, "train")
    assert "frame" in str(caught.value)
    assert "transforms_train.json" in str(caught.value)


HEAD_DAMAGE: list[tuple[str, dict[str, Any], str]] = [
    ("no angle", {"camera_angle_x": None}, "neither camera_angle_x nor fl_x"),
    ("angle of another type", {"camera_angle_x": "0.69"}, "`str` .*camera_angle_x"),
    ("angle zero", {"camera_angle_x": 0}, "between 0.0017 and π"),
    ("angle negative", {"camera_angle_x": -0.69}, "between 0.0017 and π"),
    ("angle in degrees", {"camera_angle_x": 39.6}, "radians"),
    ("angle of π", {"camera_angle_x": math.pi}, "between 0.0017 and π"),
    ("no frames", {"frames": None}, "`null` .*frames"),
    ("zero frames", {"frames": []}, "length >= 1 .*frames"),
    ("frames of another type", {"frames": {"a": 1}}, "`object` .*frames"),
    ("frame of another type", {"frames": [7]}, r"`int` .*frames\[0\]"),
    ("distortion", {"k1": 0.1}, "distortion"),
    ("off-centre", {"cx": 1.0, "w": 4}, "off the centre"),
    ("oblong pixels", {"fl_x": 100.0, "fl_y": 90.0}, "square"),
    ("oblong pixels by angle", {"camera_angle_y": 0.5, "w": 4, "h": 4}, "camera_angle_y.*square"),
    ("vertical angle without a size", {"camera_angle_y": 0.6911112070083618}, "camera_angle_y without w and h"),
    ("only a vertical focal length", {"fl_y": 90.0}, "fl_y without fl_x"),
    ("centre without a size", {"cx": 2.0}, "cx without w"),
    ("centre without a height", {"cy": 2.0, "w": 4}, "cy without h"),
    ("no width", {"cx": 2.0, "w": 0}, r"`float` > 1e-06 .*\.w`"),
    ("orthographic", {"is_orthographic": True}, "is_orthographic is True"),
    ("fish-eye", {"camera_model": "OPENCV_FISHEYE"}, "OPENCV_FISHEYE.*undistort"),
    ("distortion as a list", {"distortion_params": [0, 0.1, 0, 0]}, r"distortion_params\[1\] is 0.1.*undistort"),
    ("distortion of another type", {"distortion_params": 0.1}, "`float` .*distortion_params"),
    ("distortion of a high order", {"k6": 0.1}, "k6 is 0.1"),
]


@pytest.mark.parametrize(("change", "message"), [row[1:] for row in HEAD_DAMAGE], ids=[row[0] for row in HEAD_DAMAGE])
def test_bad_heads_are_refused(folder: Path, change: dict[str, Any], message: str) -> None:
    edit(folder, lambda data: data.update(change))
    with pytest.raises(InputError, match=message) as caught:
        read_transforms(folder, "train")
    assert "transforms_train.json" in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not valid JSON"),
        (b"{", "not valid JSON"),
        (b"\xff\xfe\x00", "not valid JSON"),
        (b"[]", "Expected `object`"),
        (b'{"camera_angle_x": NaN, "frames": []}', "NaN is not a number"),
        (b'{"camera_angle_x": Infinity, "frames": []}', "Infinity is not a number"),
        (b'{"camera_angle_x": 1e999, "frames": []}', "finite"),
        (b'{"camera_angle_x": ' + b"9" * 5000 + b', "frames": []}', "not valid JSON"),
        (b"[" * 200_000, "nested too deeply"),
        (b'{"camera_angle_x": 0.6, "camera_angle_x": 0.7, "frames": []}', "'camera_angle_x' is given twice"),
    ],
)
def test_bad_json_is_refused(folder: Path, content: bytes, message: str) -> None:
    (folder / "transforms_train.json").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_transforms(folder, "train")


def test_a_huge_file_is_not_read(folder: Path) -> None:
    with (folder / "transforms_train.json").open("wb") as handle:
        handle.truncate(LARGEST_FILE + 1)
    with pytest.raises(InputError, match="bytes"):
        read_transforms(folder, "train")
