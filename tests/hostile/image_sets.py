"""Images as people really have them, and as bad luck leaves them: ways to spoil a folder, and what must be said."""

import json
import os
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenes.view_sets.images import write_png
from tests.harness.ball import write_ball

SIZE = 24
Spoil = Callable[[Path], Any]
ACCEPTED = ""
"""What is said of a folder that is read all the same."""


def listing(folder: Path, split: str = "train") -> Path:
    return folder / f"transforms_{split}.json"


def text(change: Callable[[bytes], bytes]) -> Spoil:
    return lambda folder: listing(folder).write_bytes(change(listing(folder).read_bytes()))


def edit(change: Callable[[dict[str, Any]], Any], *splits: str) -> Spoil:
    def spoil(folder: Path) -> None:
        for split in splits or ("train", "test"):
            data = json.loads(listing(folder, split).read_text(encoding="utf-8"))
            change(data)
            listing(folder, split).write_text(json.dumps(data), encoding="utf-8")

    return spoil


def frame(**values: Any) -> Spoil:
    return edit(lambda data: data["frames"][1].update(values), "train")


def poses(change: Callable[[np.ndarray], Any]) -> Spoil:
    def each(data: dict[str, Any]) -> None:
        for one in data["frames"]:
            one["transform_matrix"] = np.asarray(change(np.array(one["transform_matrix"]))).tolist()

    return edit(each)


def one_image(make: bytes | Callable[[Path], Any]) -> Spoil:
    def spoil(folder: Path) -> None:
        file = folder / "train/r_1.png"
        file.unlink()
        file.write_bytes(make) if isinstance(make, bytes) else make(file)

    return spoil


def every_image(make: Callable[[Path], Any]) -> Spoil:
    return lambda folder: [make(file) for file in sorted(folder.glob("*/*.png"))]


def png(width: int, height: int, depth: int, kind: int, rows: bytes, further: bytes = b"") -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0)
    parts = chunk(b"IHDR", header) + further + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def rows(*pixel: int) -> bytes:
    return (b"\0" + bytes(pixel) * SIZE) * SIZE


GREY = png(SIZE, SIZE, 8, 0, rows(90))
GREY_WITH_ALPHA = png(SIZE, SIZE, 8, 4, rows(90, 200))
PALETTE = png(SIZE, SIZE, 8, 3, rows(1), chunk(b"PLTE", bytes(range(12))) + chunk(b"tRNS", bytes((0, 255))))
DEEP = png(SIZE, SIZE, 16, 6, rows(*[100] * 8))
BOMB = png(60_000, 60_000, 8, 6, bytes(100))


def covered(alpha: float) -> Callable[[Path], None]:
    return lambda file: write_png(file, np.array([0.5, 0.4, 0.3, alpha]) * np.ones((SIZE, SIZE, 4)))


def moved(factor: float) -> Spoil:
    return poses(lambda pose: pose * np.where(np.arange(16).reshape(4, 4) % 4 == 3, [[factor]] * 3 + [[1.0]], 1.0))


def turned(matrix: np.ndarray) -> Spoil:
    return poses(lambda pose: pose @ matrix)


def upper(file: Path) -> None:
    file.rename(file.with_suffix(".PNG"))


def same_photos_twice(folder: Path) -> None:
    for file in (folder / "train").glob("*.png"):
        shutil.copy(file, folder / "test" / file.name)
    listing(folder, "test").write_text(listing(folder).read_text(encoding="utf-8").replace("./train", "./test"))


def replaced_by(make: Callable[[Path], Any]) -> Spoil:
    def spoil(folder: Path) -> None:
        listing(folder).unlink()
        make(listing(folder))

    return spoil


def nerfstudio(change: Callable[[dict[str, Any]], Any] = lambda data: None) -> Spoil:
    """The folder with one listing, as nerfstudio writes it."""

    def spoil(folder: Path) -> None:
        both = [json.loads(listing(folder, split).read_text(encoding="utf-8")) for split in ("train", "test")]
        focal = 0.5 * SIZE / np.tan(0.5 * both[0]["camera_angle_x"])
        lens = {"k1": 0, "k2": 0, "p1": 0, "p2": 0, "cx": SIZE / 2, "cy": SIZE / 2, "fl_x": focal, "fl_y": focal}
        frames = [one | {"file_path": f"{one['file_path']}.png"} for data in both for one in data["frames"]]
        data = {"camera_model": "OPENCV", "w": SIZE, "h": SIZE, **lens, "frames": frames}
        for split in ("train", "test"):
            listing(folder, split).unlink()
        change(data)
        (folder / "transforms.json").write_text(json.dumps(data), encoding="utf-8")

    return spoil


def lens(**values: Any) -> Spoil:
    return nerfstudio(lambda data: data.update(values))


def without(*names: str) -> Spoil:
    return nerfstudio(lambda data: [data.pop(name) for name in names])


def first_frame(**values: Any) -> Spoil:
    return nerfstudio(lambda data: data["frames"][0].update(values))


UNREADABLE, TOO_FEW = "not an image that can be read", "too few to hold any out for testing"
NOT_JSON, NO_IMAGE = "transforms_train.json: not valid JSON", "restore it or drop the frame"
NOT_A_ROTATION = "its camera matrix is not a rotation and a translation"
SETS: dict[str, tuple[Spoil, str]] = {
    # a listing as text
    "a byte order mark": (text(lambda old: b"\xef\xbb\xbf" + old), ACCEPTED),
    "lines of Windows": (text(lambda old: old.replace(b"\n", b"\r\n")), ACCEPTED),
    "UTF-16": (text(lambda old: old.decode().encode("utf-16")), NOT_JSON),
    "a comma too many": (text(lambda old: old.rstrip()[:-1] + b",}"), NOT_JSON),
    "a comment": (text(lambda old: b"// from Blender\n" + old), NOT_JSON),
    "two documents": (text(lambda old: old + old), NOT_JSON),
    "nothing": (text(lambda old: b""), NOT_JSON),
    "zeros": (text(lambda old: bytes(100)), NOT_JSON),
    "Latin-1": (text(lambda old: old.replace(b"r_1", b"r_\xe9")), NOT_JSON),
    "an integer of 5000 digits": (text(lambda old: b'{"version": ' + b"9" * 5000 + b"," + old.lstrip()[1:]), NOT_JSON),
    "a hundred thousand brackets": (text(lambda old: b"[" * 100_000 + b"]" * 100_000), "nested too deeply"),
    "an infinite number": (text(lambda old: old.replace(b"0.6911112", b"1e400", 1)), "transforms_train.json: "),
    "a key twice": (text(lambda old: b'{"camera_angle_x": 0.5,' + old.lstrip()[1:]), "is given twice"),
    "a folder": (replaced_by(Path.mkdir), "transforms_train.json: missing"),
    "a pipe": (replaced_by(os.mkfifo), "transforms_train.json: missing"),
    "an endless device": (replaced_by(lambda file: file.symlink_to("/dev/zero")), "transforms_train.json: missing"),
    "frames by name": (edit(lambda data: data.update(frames={"0": data["frames"][0]})), "got `object` - at `$.frames`"),
    "numbers as text": (poses(lambda pose: pose.astype(str)), "Expected `float`, got `str`"),
    # paths
    "a path that is a number": (frame(file_path=3), "got `int` - at `$.frames[1].file_path`"),
    "an empty path": (frame(file_path=""), "file_path is ''; it must be a path inside"),
    "the folder itself": (frame(file_path="."), NO_IMAGE),
    "a path with a zero byte": (frame(file_path="./train/r_\x001"), "it must be a path inside"),
    "a path of 5000 letters": (frame(file_path="./train/" + "r" * 5000), "cannot be followed"),
    "a path as in an address": (frame(file_path="./train/r%5F1"), NO_IMAGE),
    "paths of Windows": (
        edit(lambda data: [one.update(file_path=one["file_path"].replace("/", "\\")) for one in data["frames"]]),
        ACCEPTED,
    ),
    "paths with their ending": (
        edit(lambda data: [one.update(file_path=one["file_path"] + ".png") for one in data["frames"]]),
        ACCEPTED,
    ),
    "endings in capitals": (every_image(upper), NO_IMAGE),
    # images
    "an image that is a folder": (one_image(Path.mkdir), NO_IMAGE),
    "an image that is a pipe": (one_image(os.mkfifo), NO_IMAGE),
    "an image that is itself": (one_image(lambda file: file.symlink_to(file)), NO_IMAGE),
    "an image that is endless": (one_image(lambda file: file.symlink_to("/dev/zero")), NO_IMAGE),
    "a link to nowhere": (one_image(lambda file: file.symlink_to("nowhere")), NO_IMAGE),
    "a link out of the folder": (
        one_image(lambda file: file.symlink_to("/etc/hostname")),
        "is a link out of the folder",
    ),
    "a page instead of an image": (one_image(b"<!doctype html><title>404</title>"), UNREADABLE),
    "a pointer of Git LFS": (
        one_image(b"version https://git-lfs.github.com/spec/v1\n"),
        "not an image that can be read",
    ),
    "14 GB in 69 bytes": (one_image(BOMB), UNREADABLE),
    "no pixels": (one_image(png(0, 10, 8, 6, b"")), UNREADABLE),
    "one pixel": (one_image(png(1, 1, 8, 6, b"\0\1\2\3\4")), "1 × 1 pixels, but views before it have 24 × 24"),
    "one grey image": (one_image(GREY), "1 channels, no alpha"),
    "one image of 16 bits": (one_image(DEEP), ACCEPTED),
    "grey with alpha": (every_image(lambda file: file.write_bytes(GREY_WITH_ALPHA)), ACCEPTED),
    "a palette with alpha": (every_image(lambda file: file.write_bytes(PALETTE)), ACCEPTED),
    "bytes behind the image": (every_image(lambda file: file.write_bytes(file.read_bytes() + b"x" * 99)), ACCEPTED),
    "an empty folder": (every_image(Path.unlink), NO_IMAGE),
    # cameras
    "no field of view": (edit(lambda data: data.update(camera_angle_x=0)), "the field of view is 0°"),
    "a field of view in degrees": (edit(lambda data: data.update(camera_angle_x=39.6)), "the field of view is 2268"),
    "a field of view of 180°": (edit(lambda data: data.update(camera_angle_x=np.pi)), "the field of view is 180°"),
    "a negative one": (edit(lambda data: data.update(camera_angle_x=-0.7)), "the field of view is -40.1"),
    "a hair's breadth": (edit(lambda data: data.update(camera_angle_x=1e-9)), "the field of view is 5.7"),
    "a field of view as text": (
        edit(lambda data: data.update(camera_angle_x="0.69")),
        "got `str` - at `$.camera_angle_x`",
    ),
    "a field of view that is true": (edit(lambda data: data.update(camera_angle_x=True)), "got `bool`"),
    "two lenses": (
        edit(lambda data: data.update(camera_angle_x=0.3), "test"),
        "camera_angle_x differs between the splits",
    ),
    "rows for columns": (poses(lambda pose: pose.T), "it must be 0 0 0 1"),
    "three rows": (poses(lambda pose: pose[:3]), "of length 4, got 3"),
    "sixteen numbers": (poses(np.ravel), "of length 4, got 16"),
    "millimetres in the rotation": (turned(np.diag([1e3, 1e3, 1e3, 1.0])), NOT_A_ROTATION),
    "a mirror": (turned(np.diag([-1.0, 1.0, 1.0, 1.0])), f"{NOT_A_ROTATION} (off by"),
    "a shear": (turned(np.eye(4) + 0.3 * np.eye(4, k=1) * [1, 1, 0, 0]), NOT_A_ROTATION),
    "a scale in the corner": (poses(lambda pose: pose + np.diag([0, 0, 0, 1.0])), "it must be 0 0 0 1"),
    "light years away": (moved(1e30), "Expected `float` < 1e+30"),
    # views
    "a training photo as a test": (
        lambda folder: listing(folder, "test").write_text(listing(folder).read_text(encoding="utf-8")),
        "is a training and a test view",
    ),
    "no test frames": (edit(lambda data: data.update(frames=[]), "test"), "of length >= 1 - at `$.frames`"),
    # one listing for all
    "as nerfstudio has it": (nerfstudio(), ACCEPTED),
    "without a centre": (without("cx", "cy"), ACCEPTED),
    "without a model": (without("camera_model"), ACCEPTED),
    "with depth maps": (first_frame(depth_file_path="depth/0.png"), ACCEPTED),
    "no focal length": (without("fl_x", "fl_y"), "neither camera_angle_x nor fl_x is given"),
    "no width": (without("w"), "without w"),
    "a focal length of 0": (lens(fl_x=0), "Expected `float` > 1e-06 - at `$.fl_x`"),
    "a negative focal length": (lens(fl_x=-30.0), "Expected `float` > 1e-06 - at `$.fl_x`"),
    "a focal length as text": (lens(fl_x="30"), "got `str` - at `$.fl_x`"),
    "two focal lengths": (lens(camera_angle_x=2.0), "camera_angle_x is 2, and fl_x and w say 0.691"),
    "one that says it twice": (lens(camera_angle_x=0.6911112), ACCEPTED),
    "a frame's own focal length": (first_frame(fl_x=90.0), "fl_x is 90.0, and 33.3"),
    "a frame's own size": (first_frame(w=12, h=12), "w is 12.0, and 24.0 for the whole file"),
    "a frame that says it again": (first_frame(w=SIZE, h=SIZE), ACCEPTED),
    "pixels that are no squares": (lens(fl_y=5.0), "pixels must be square"),
    "a centre outside": (lens(cx=500), "off-centre lenses are not supported"),
    "the size of other images": (lens(w=2 * SIZE), "off-centre lenses are not supported"),
    "no width at all": (lens(w=0), "at `$.w`"),
    "a curved lens": (lens(k1=0.2), "k1 is 0.2; lens distortion is not supported"),
    "a fisheye": (lens(camera_model="OPENCV_FISHEYE"), "undistort the images to a pinhole"),
    "a panorama": (lens(camera_model="EQUIRECTANGULAR"), "undistort the images to a pinhole"),
    "a model that is a number": (lens(camera_model=3), "got `int` - at `$.camera_model`"),
    "masks": (first_frame(mask_path="masks/0.png"), "save the mask as the image's alpha channel"),
    "a matrix by name": (first_frame(transform_matrix="identity"), "got `str` - at `$.frames[0].transform_matrix`"),
    "a name from right to left": (first_frame(file_path="train/\u202e0_r.png"), "no image"),
    "one frame": (
        nerfstudio(lambda data: data.update(frames=data["frames"][:1])),
        "too few to hold any out for testing",
    ),
    "no frames": (lens(frames=[]), "of length >= 1 - at `$.frames`"),
    "a split of nothing": (lens(train_filenames=["x.png"], test_filenames=["train/r_0.png"]), NO_IMAGE),
    "a split in both": (
        lens(train_filenames=["train/r_0.png"], test_filenames=["train/r_0.png"]),
        "is a training and a test view",
    ),
}
"""What it is → how to make it of a whole folder, and what must be said of it."""


def made(folder: Path, name: str) -> Path:
    write_ball(folder)
    SETS[name][0](folder)
    return folder
