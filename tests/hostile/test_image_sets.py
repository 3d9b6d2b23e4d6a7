"""Realistic image sets are read, or refused in a sentence that names the file, the value and the remedy.

`tests/scenes/view_sets` tests the content of listings, `tests/harness/bad_view_sets.py` invalid sets of the Blender
format; here are the other encodings, kinds of files, images and lenses.
"""

import json
import os
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenes.files.errors import InputError
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball
from tests.scenes.captures import Edit, edit

SIZE = 24
Spoil = Callable[[Path], Any]
LISTING, TEST_LISTING, IMAGE = "transforms_train.json", "transforms_test.json", "train/r_1.png"


def text(change: Callable[[bytes], bytes]) -> Spoil:
    return lambda folder: (folder / LISTING).write_bytes(change((folder / LISTING).read_bytes()))


def edited(change: Edit, file: str = TEST_LISTING) -> Spoil:
    return lambda folder: edit(folder, change, file)


def replaced(name: str, make: Callable[[Path], Any]) -> Spoil:
    return lambda folder: ((folder / name).unlink(), make(folder / name))


def every_image(make: Callable[[Path], Any]) -> Spoil:
    return lambda folder: [make(file) for file in sorted(folder.glob("*/*.png"))]


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def png(side: int, depth: int, kind: int, pixel: bytes, further: bytes = b"") -> bytes:
    header, rows = struct.pack(">IIBBBBB", side, side, depth, kind, 0, 0, 0), (b"\0" + pixel * side) * side
    parts = chunk(b"IHDR", header) + further + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


GREY = png(SIZE, 8, 0, bytes([90]))
GREY_WITH_ALPHA = png(SIZE, 8, 4, bytes([90, 200]))
PALETTE = png(SIZE, 8, 3, b"\1", chunk(b"PLTE", bytes(range(12))) + chunk(b"tRNS", bytes((0, 255))))
DEEP = png(SIZE, 16, 6, bytes([100] * 8))
ONE_PIXEL = png(1, 8, 6, b"\1\2\3\4")


def moved(pose: list[list[float]]) -> list[list[float]]:
    return (np.array(pose) * np.where(np.arange(16).reshape(4, 4) % 4 == 3, [[1e30]] * 3 + [[1.0]], 1.0)).tolist()


def nerfstudio(change: Edit = lambda data: None, **frame: Any) -> Spoil:
    """Write one listing in the format of nerfstudio; `frame` changes its first frame."""

    def spoil(folder: Path) -> None:
        both = [json.loads((folder / name).read_text(encoding="utf-8")) for name in (LISTING, TEST_LISTING)]
        focal = 0.5 * SIZE / np.tan(0.5 * both[0]["camera_angle_x"])
        lens = {"k1": 0, "k2": 0, "cx": SIZE / 2, "cy": SIZE / 2, "fl_x": focal, "fl_y": focal, "w": SIZE, "h": SIZE}
        frames = [view | {"file_path": f"{view['file_path']}.png"} for data in both for view in data["frames"]]
        data = {"camera_model": "OPENCV", **lens, "frames": [frames[0] | frame, *frames[1:]]}
        for name in (LISTING, TEST_LISTING):
            (folder / name).unlink()
        change(data)
        (folder / "transforms.json").write_text(json.dumps(data), encoding="utf-8")

    return spoil


def lens(**values: Any) -> Spoil:
    return nerfstudio(lambda data: data.update(values))


MISSING, NOT_JSON = "transforms_train.json: missing", "transforms_train.json: not valid JSON"
NO_IMAGE, NOT_READ = "restore it or drop the frame", "not an image that can be read"
READ: dict[str, Spoil] = {
    "endings in capitals": every_image(lambda file: file.rename(file.with_suffix(".PNG"))),
    "lines of Windows": text(lambda old: old.replace(b"\n", b"\r\n")),
    "one image of 16 bits": replaced(IMAGE, lambda file: file.write_bytes(DEEP)),
    "grey with alpha": every_image(lambda file: file.write_bytes(GREY_WITH_ALPHA)),
    "a palette with alpha": every_image(lambda file: file.write_bytes(PALETTE)),
    "bytes behind the image": every_image(lambda file: file.write_bytes(file.read_bytes() + b"x" * 99)),
    "JPEG that is named PNG": lambda folder: [
        nerfstudio()(folder),
        every_image(lambda file: Image.open(file).convert("RGB").save(file, "JPEG"))(folder),
    ],
    "without a centre": nerfstudio(lambda data: [data.pop(name) for name in ("cx", "cy")]),
    "without a model": nerfstudio(lambda data: data.pop("camera_model")),
    "with depth maps": nerfstudio(depth_file_path="depth/0.png"),
    "a focal length twice": lens(camera_angle_x=0.6911112),
    "a frame that says it again": nerfstudio(w=SIZE, h=SIZE),
}
REFUSED: dict[str, tuple[Spoil, str]] = {
    "UTF-16": (text(lambda old: old.decode().encode("utf-16")), NOT_JSON),
    "Latin-1": (text(lambda old: old.replace(b"r_1", b"r_\xe9")), NOT_JSON),
    "a listing that is a folder": (replaced(LISTING, Path.mkdir), MISSING),
    "a listing that is a pipe": (replaced(LISTING, os.mkfifo), MISSING),
    "a listing without an end": (replaced(LISTING, lambda file: file.symlink_to("/dev/zero")), MISSING),
    "an image that is a folder": (replaced(IMAGE, Path.mkdir), NO_IMAGE),
    "an image that is a pipe": (replaced(IMAGE, os.mkfifo), NO_IMAGE),
    "an image that is itself": (replaced(IMAGE, lambda file: file.symlink_to(file)), NO_IMAGE),
    "an image without an end": (replaced(IMAGE, lambda file: file.symlink_to("/dev/zero")), NO_IMAGE),
    "a pointer of Git LFS": (replaced(IMAGE, lambda file: file.write_bytes(b"version https://git-lfs\n")), NOT_READ),
    "one pixel": (replaced(IMAGE, lambda file: file.write_bytes(ONE_PIXEL)), "1 × 1 pixels, but views before it"),
    "one grey image": (replaced(IMAGE, lambda file: file.write_bytes(GREY)), "1 channels, no alpha"),
    "a hair's breadth": (edited(lambda data: data.update(camera_angle_x=1e-9), LISTING), "the field of view is 5.7"),
    "two lenses": (edited(lambda data: data.update(camera_angle_x=0.3)), "angle differs between the splits"),
    "light years away": (
        edited(lambda data: [view.update(transform_matrix=moved(view["transform_matrix"])) for view in data["frames"]]),
        "Expected `float` < 1e+30",
    ),
    "a training photo as a test": (lambda folder: shutil.copy(folder / LISTING, folder / TEST_LISTING),
                                   "is a training and a test view"),
    "a focal length as text": (lens(fl_x="30 px"), "got `str` - at `$.fl_x`"),
    "a frame's own focal length": (nerfstudio(fl_x=90.0), "fl_x is 90.0, and 33.3"),
    "a frame's own size": (nerfstudio(w=12, h=12), "w is 12.0, and 24.0 for all frames"),
    "a centre outside": (lens(cx=500), "cx 500, cy 12 is far from the middle of 24 × 24 pixels; size, focal length"),
    "the size of the originals": (lens(w=96, h=96), "cx 12, cy 12 is far from the middle of 96 × 96 pixels"),
    "the lens of the originals": (lens(cx=48, cy=48, fl_x=133.2, fl_y=133.2), "far from the middle of 24 × 24"),
    "a focal length in widths": (lens(w=100, h=100, cx=50, cy=50, fl_x=1.2, fl_y=1.2), "focal length in pixels"),
    "a size in widths": (lens(w=0.3), "frame 0: w is 0.3 and h 24.0; give the size in pixels"),
    "the size of other images": (lens(w=2 * SIZE), "24 × 24 pixels, its camera has 48 × 24"),
    "a name from right to left": (nerfstudio(file_path="train/\u202e0_r.png"), "no image"),
    "a split of nothing": (lens(train_filenames=["x.png"], test_filenames=["train/r_0.png"]), NO_IMAGE),
}  # fmt: skip


@pytest.mark.parametrize("name", READ)
def test_a_set_that_is_read(name: str, tmp_path: Path) -> None:
    READ[name](write_ball(tmp_path / "set"))
    views = read_view_set(tmp_path / "set")
    assert [len(split.rgba[0]) for split in (views.train, views.test)] == [SIZE, SIZE]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", REFUSED)
def test_a_set_that_is_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    spoil, message = REFUSED[name]
    spoil(write_ball(tmp_path / "set"))
    with pytest.raises(InputError) as refused:
        read_view_set(tmp_path / "set")
    assert message in str(refused.value)
    assert str(tmp_path / "set") in str(refused.value)
