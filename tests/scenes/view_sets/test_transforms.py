"""`transforms_*.json` of other programs: what is read, and what is refused with one clear message."""

import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.formats.lens import Lens, common_pinhole
from scenes.view_sets.formats.transforms import LARGEST_FILE, Listing, read_listing, read_transforms, write_transforms
from scenes.view_sets.images import write_png
from scenes.view_sets.viewpoints import all_poses
from tests.scenes import captures

POSES = all_poses("test")[:3]
edit = partial(captures.edit, name="transforms_train.json")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "lego"
    (root / "train").mkdir(parents=True)
    for number in range(3):
        write_png(root / "train" / f"r_{number}.png", np.full((4, 4, 4), 0.5))
    (tmp_path / "outside.png").write_bytes((root / "train" / "r_0.png").read_bytes())
    write_transforms(root / "transforms_train.json", 0.69, [f"./train/r_{n}" for n in range(3)], POSES)
    return root


def test_what_is_written_is_read(folder: Path) -> None:
    frames = read_transforms(folder, "train")
    assert frames.fov_x_radians == 0.69
    assert np.array_equal(frames.camera_to_world, POSES)
    assert [file.name for file in frames.files] == ["r_0.png", "r_1.png", "r_2.png"]
    # the format is that of the field; `test_export.py` reads it as others do
    data = json.loads((folder / "transforms_train.json").read_text())
    assert set(data["frames"][0]) == {"file_path", "rotation", "transform_matrix"}


@pytest.mark.parametrize(
    "path",
    [
        "train/r_0", "./train/r_0.png", "train//r_0.png", "train\\r_0", "train/R_0.PNG", "{folder}/train/r_0",
        "./train/../train/r_0.png", "train/r_0.jpg", "train/R_0.JPG", "images/train/r_0.png", "./images/train/r_0.jpg",
    ],
)  # fmt: skip
def test_paths_with_and_without_suffix(folder: Path, path: str) -> None:
    edit(folder, lambda data: data["frames"][0].update(file_path=path.format(folder=folder.resolve())))
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
    assert read_transforms(folder, "train").fov_x_radians == pytest.approx(angle, rel=1e-14)


def listing(folder: Path, **head: Any) -> Listing:
    edit(folder, lambda data: data.update(head))
    return read_listing(folder / "transforms_train.json")


def test_a_lens_may_be_distorted_off_centre_and_oblong(folder: Path) -> None:
    head = {"camera_angle_x": None, "w": 400, "h": 400, "fl_x": 500.0, "fl_y": 505.0, "cx": 203.0, "cy": 198.0}
    read = listing(folder, **head, k1=0.1, k2=-0.2, p1=0.01, p2=0.02)
    (lens,) = set(read.lenses.values())
    assert lens == Lens(400, 400, 500.0, 505.0, 203.0, 198.0, (0.1, -0.2, 0.0, 0.0), (), (0.01, 0.02))
    assert read.pinhole == common_pinhole([lens], "here")
    assert "pictures are resampled to one pinhole" in read.notes[0]
    assert len(read.notes) == 1
    flat = dict.fromkeys(("k1", "k2", "p1", "p2"))
    # nerfstudio's list, and what its OPENCV and FULL_OPENCV do with k4
    (lens,) = set(listing(folder, **flat, distortion_params=[0.1, 0.2, 0.3, 0.4, 0.01, 0.02]).lenses.values())
    assert lens is not None
    assert (lens.radial, lens.divisor, lens.tangential) == ((0.1, 0.2, 0.3, 0.4), (), (0.01, 0.02))
    full = {"camera_model": "FULL_OPENCV", "k4": 0.4, "k6": 0.6, "distortion_params": None}
    (lens,) = set(listing(folder, **full).lenses.values())
    assert lens is not None
    assert (lens.radial, lens.divisor) == ((), (0.4, 0.0, 0.6))
    flat |= {"camera_model": None, "k4": None, "k6": None}
    assert all(lens and lens.is_fisheye for lens in listing(folder, **flat, is_fisheye=True).lenses.values())


def test_an_axis_far_from_the_middle_is_named(folder: Path) -> None:
    """As of a lens of pictures half as large; a fourth as large is refused (`tests/hostile`)."""
    read = listing(folder, w=800, h=600, fl_x=500.0, cx=203.0, cy=152.0, camera_angle_x=None)
    assert read.notes[1].startswith(
        "The axis at cx 203, cy 152 is far from the middle of 800 × 600 pixels; size, focal"
    )


def test_sizes_that_are_not_given_are_those_of_the_pictures(folder: Path) -> None:
    read = listing(folder, fl_x=2.0 / math.tan(0.345), cx=2.0)
    assert read.pinhole == Lens.pinhole(4, 4, pytest.approx(2.0 / math.tan(0.345)))
    assert read.notes == []


def test_focal_lengths_decide_over_the_angles_that_add_ons_write(folder: Path) -> None:
    """Blender's angles: that of the longer side as x, that of the sensor's height as y."""
    lens = {"w": 600, "h": 800, "fl_x": 900.0, "fl_y": 900.0}
    of_longer, of_sensor = 2 * math.atan(400 / 900), 2 * math.atan(266 / 900)
    read = listing(folder, **lens, camera_angle_x=of_longer, camera_angle_y=of_sensor)
    assert read.frames.fov_x_radians == pytest.approx(2 * math.atan(300 / 900), rel=1e-12)
    assert [note.partition(" is ")[0] for note in read.notes] == ["camera_angle_x", "camera_angle_y"]
    with pytest.raises(InputError, match=r"camera_angle_x is 0\.5, and fl_x and w say 0\.6435"):
        listing(folder, camera_angle_x=0.5)
    # a pixel at the edge is no contradiction
    assert listing(folder, camera_angle_x=2 * math.atan(300.9 / 900)).notes[0].startswith("camera_angle_y")


def test_every_frame_may_have_a_lens(folder: Path) -> None:
    def change(data: dict[str, Any]) -> None:
        for number, frame in enumerate(data["frames"]):
            frame.update(w=40 + number, h=40, fl_x=60.0 + number, cx=20.0 + number / 2, cy=20.0, time=number / 2)
        del data["camera_angle_x"]

    edit(folder, change)
    read = listing(folder)
    lenses = [lens for lens in read.lenses.values() if lens is not None]
    assert [(lens.width, lens.fx) for lens in lenses] == [(40, 60.0), (41, 61.0), (42, 62.0)]
    assert read.pinhole == common_pinhole(lenses, "here")
    assert any("one scene that does not move" in note for note in read.notes)
    alone = {**dict.fromkeys(("w", "h", "fl_x", "cx", "cy")), "camera_angle_x": 0.64}
    edit(folder, lambda data: data["frames"][1].update(alone))
    with pytest.raises(InputError, match="frame 1 has no fl_x, as others have"):
        listing(folder)


def test_another_last_number_of_a_matrix_is_undone(folder: Path) -> None:
    edit(folder, lambda data: data["frames"][0].update(transform_matrix=matrix_with(3, 3, 0.0012)))
    scaled = (0.0012 * POSES[1]).tolist()
    edit(folder, lambda data: data["frames"][1].update(transform_matrix=scaled))
    read = listing(folder)
    np.testing.assert_allclose(read.frames.camera_to_world, POSES, atol=1e-12)
    assert any("2 of 3 camera matrices have a last number other than 1" in note for note in read.notes)


def matrix_with(row: int, column: int, value: Any) -> list[list[Any]]:
    matrix: list[list[Any]] = POSES[0].tolist()
    matrix[row][column] = value
    return matrix


IN_A_FRAME: dict[str, tuple[dict[str, Any], str]] = {
    "no path": ({"file_path": None}, "`null` .*file_path"),
    "path with a zero": ({"file_path": "a\0b"}, "file_path"),
    "path upwards": ({"file_path": "../outside"}, "leaves the folder"),
    "path upwards, hidden": ({"file_path": "train/../../outside.png"}, "leaves the folder"),
    "path upwards, backslashes": ({"file_path": "..\\outside.png"}, "leaves the folder"),
    "absolute path": ({"file_path": "/etc/passwd"}, "leaves the folder"),
    "drive": ({"file_path": "C:\\x.png"}, "leaves the folder"),
    "link outside": ({"file_path": "train/link"}, "link out of the folder"),
    "path too long": ({"file_path": "x" * 5000}, "file_path"),
    "twice the same": ({"file_path": "./train/r_1"}, "list each image once"),
    "two rows": ({"transform_matrix": POSES[0].tolist()[:2]}, "four rows"),
    "ragged": ({"transform_matrix": [*POSES[0].tolist()[:3], [0, 0, 1]]}, "four rows"),
    "text in the matrix": ({"transform_matrix": matrix_with(1, 2, "x")}, r"`str` .*transform_matrix\[1\]\[2\]"),
    "truth in the matrix": ({"transform_matrix": matrix_with(0, 0, True)}, "`bool` .*finite numbers"),
    "huge integer": ({"transform_matrix": matrix_with(0, 0, 10**400)}, "finite"),
}
"""`test_viewpoints.py` and case C1 have matrices and angles that are none, `tests/hostile` other images and lenses."""
AT_THE_TOP: dict[str, tuple[dict[str, Any], str]] = {
    "no angle": ({"camera_angle_x": None}, "neither camera_angle_x nor fl_x"),
    "angle in degrees": ({"camera_angle_x": 39.6}, "radians"),
    "zero frames": ({"frames": []}, "length >= 1 .*frames"),
    "two angles": ({"camera_angle_y": 0.5, "w": 40, "h": 40}, "camera_angle_y is 0.5, and of square pixels it is 0.69"),
    "only a vertical focal length": ({"fl_y": 90.0}, "fl_y without fl_x"),
    "no width": ({"cx": 2.0, "w": 0}, r"`float` > 1e-06 .*\.w`"),
    "orthographic": ({"is_orthographic": True}, "is_orthographic is True"),
    "a panorama": ({"camera_model": "EQUIRECTANGULAR"}, "EQUIRECTANGULAR.*undistort"),
    "two distortions": ({"k1": 0.1, "distortion_params": [0.2]}, "k1 is 0.1, and 0.2 in distortion_params"),
    "a long list": ({"distortion_params": [0.0] * 6 + [0.1]}, "distortion_params has 7 numbers"),
    "a mask": ({"mask_path": "mask.png"}, "mask_path.*alpha"),
    "distortion of a high order": ({"k6": 0.1}, "k6 is 0.1"),
}


@pytest.mark.parametrize("name", [*IN_A_FRAME, *AT_THE_TOP])
def test_bad_values_are_refused(folder: Path, name: str) -> None:
    change, message = (IN_A_FRAME | AT_THE_TOP)[name]
    (folder / "train" / "link.png").symlink_to(folder.parent / "outside.png")
    edit(folder, lambda data: (data["frames"][0] if name in IN_A_FRAME else data).update(change))
    with pytest.raises(InputError, match=message) as caught:
        read_transforms(folder, "train")
    assert "transforms_train.json" in str(caught.value)
    assert "frame" in str(caught.value) or name in AT_THE_TOP


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "not valid JSON"),
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
