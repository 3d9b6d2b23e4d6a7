"""COLMAP and LLFF folders: poses are unchanged, distortion is undone, and invalid captures are refused."""

import math
import re
import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from scenes.files.errors import InputError
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.formats.lens import MODELS, Lens, as_pinhole, common_pinhole
from scenes.view_sets.formats.transforms import DISTORTION
from scenes.view_sets.images import write_png
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import ViewSet, read_view_set
from tests.harness.ball import FOV_X_RADIANS, ball_view, pose

UNKNOWN = ("RAD_TAN_THIN_PRISM_FISHEYE",)
WIDTH, HEIGHT, COUNT = 24, 24, 17
FOCAL = 0.5 * WIDTH / math.tan(0.5 * FOV_X_RADIANS)
POSES = np.array([pose(0.8 * number, 0.2 + 0.05 * number) for number in range(COUNT)])
PINHOLE = ("SIMPLE_PINHOLE", (FOCAL, WIDTH / 2, HEIGHT / 2))
ON_BALL = np.random.default_rng(0).normal(size=(200, 3))
ON_BALL /= np.linalg.norm(ON_BALL, axis=1, keepdims=True)


def write_colmap(
    folder: Path, camera: tuple[str, tuple[float, ...]] = PINHOLE, points: np.ndarray = ON_BALL, binary: bool = True,
    alpha: bool = True, image: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Path:  # fmt: skip
    """Write the files of COLMAP's `model_converter`; names are not in the order of the poses' ids."""
    sparse = folder / "sparse" / "0"
    sparse.mkdir(parents=True)
    (folder / "images").mkdir()
    rows = []
    for number, matrix in enumerate(POSES):
        pixels = ball_view(matrix, WIDTH) if image is None else image(matrix)
        write_png(folder / "images" / f"v {number:02d}.png", pixels if alpha else pixels[..., :3])
        rotation = (matrix[:3, :3] @ np.diag([1.0, -1.0, -1.0])).T
        x, y, z, w = Rotation.from_matrix(rotation).as_quat()
        rows.append((number + 1, (w, x, y, z, *(-rotation @ matrix[:3, 3])), f"v {number:02d}.png"))
    rows.reverse()
    model, numbers = camera
    if binary:
        known = {name: number for number, (name, _) in MODELS.items()} | dict.fromkeys(UNKNOWN, 11)
        lens = struct.pack(f"<iiQQ{len(numbers)}d", 7, known[model], WIDTH, HEIGHT, *numbers)
        (sparse / "cameras.bin").write_bytes(struct.pack("<Q", 1) + lens)
        images = b"".join(
            struct.pack("<i7di", number, *numbers, 7) + name.encode() + b"\0" + struct.pack("<Q", 2) + bytes(48)
            for number, numbers, name in rows
        )
        (sparse / "images.bin").write_bytes(struct.pack("<Q", COUNT) + images)
        tracks = b"".join(struct.pack("<Q3d3BdQ", i, *x, 1, 2, 3, 0.5, 2) + bytes(16) for i, x in enumerate(points))
        (sparse / "points3D.bin").write_bytes(struct.pack("<Q", len(points)) + tracks)
        return folder
    (sparse / "cameras.txt").write_text(f"# one\n7 {model} {WIDTH} {HEIGHT} {' '.join(map(repr, numbers))}\n")
    # an image without points has an empty line
    lines = [f"{number} {' '.join(map(repr, map(float, numbers)))} 7 {name}\n\n" for number, numbers, name in rows]
    (sparse / "images.txt").write_text("# two lines each\n" + "".join(lines))
    text = [f"{i} {x[0]!r} {x[1]!r} {x[2]!r} 1 2 3 0.5 1 1\n" for i, x in enumerate(points.tolist())]
    (sparse / "points3D.txt").write_text("".join(text))
    return folder


def write_llff(folder: Path, near: float = 2.0, far: float = 6.0) -> Path:
    (folder / "images").mkdir(parents=True)
    rows = []
    for number, matrix in enumerate(POSES):
        write_png(folder / "images" / f"v{number:02d}.png", ball_view(matrix, WIDTH)[..., :3])
        right, up, back, at = matrix[:3].T
        rows.append([*np.stack([-up, right, back, at, [HEIGHT, WIDTH, FOCAL]], axis=1).ravel(), near, far])
    np.save(folder / "poses_bounds.npy", np.array(rows))
    return folder


@pytest.mark.parametrize("binary", [True, False])
def test_a_reconstruction_is_read_as_it_was_written(tmp_path: Path, binary: bool) -> None:
    views = read_view_set(write_colmap(tmp_path / "c", binary=binary))
    assert views.test.names == ("images/v 00", "images/v 08", "images/v 16")
    assert len(views.train.names) == COUNT - 3
    np.testing.assert_allclose(views.test.camera_to_world, POSES[::8], atol=1e-12)
    np.testing.assert_allclose(views.train.camera_to_world[:7], POSES[1:8], atol=1e-12)
    assert views.fov_x_radians == pytest.approx(FOV_X_RADIANS, abs=1e-12)
    np.testing.assert_allclose(views.test.rgba[1], ball_view(POSES[8], WIDTH), atol=0.5 / 255 + 1e-6)
    assert (views.bounds[0] < -1.0).all()
    assert any("Every eighth view by name, 3 of 17" in note for note in views.notes)


LENSES = {
    "PINHOLE": (22.0, 25.0, 10.5, 13.25),
    "SIMPLE_RADIAL": (24.0, 12.0, 12.0, -0.15),
    "RADIAL": (24.0, 12.5, 11.0, 0.2, -0.3),
    "OPENCV": (24.0, 25.0, 11.5, 12.5, -0.1, 0.05, 0.01, -0.02),
    "FULL_OPENCV": (24.0, 25.0, 12.0, 12.5, 0.3, -0.2, 0.01, -0.01, 0.05, 0.4, -0.1, 0.02),
    "OPENCV_FISHEYE": (18.0, 18.5, 12.0, 11.5, 0.05, -0.04, 0.02, -0.01),
    "SIMPLE_RADIAL_FISHEYE": (20.0, 12.0, 12.0, -0.1),
    "RADIAL_FISHEYE": (20.0, 11.0, 12.0, 0.1, -0.05),
    "FOV": (24.0, 23.0, 12.25, 11.75, 0.9),
    "THIN_PRISM_FISHEYE": (20.0, 20.5, 12.0, 11.5, 0.05, -0.03, 0.01, -0.02, 0.02, -0.01, 0.02, -0.03),
}


def ideal(model: str, values: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the direction that each pixel of a lens sees, by fixed-point iteration of COLMAP's and OpenCV's formulas;
    FOV has a closed form.
    """
    k1, k2, k3, k4, k5, k6, p1, p2, *_ = (values.get(name, 0.0) for name in DISTORTION)
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    u = (column - values["cx"]) / values.get("fx", values.get("f", 0.0))
    v = (row - values["cy"]) / values.get("fy", values.get("f", 0.0))
    if omega := values.get("omega"):
        radius = np.hypot(u, v)
        longer = np.tan(radius * omega) / (2 * radius * np.tan(omega / 2))
        return longer * u, longer * v
    x, y = u.copy(), v.copy()  # of a fisheye, the angle from the axis times the direction in the picture
    for _ in range(300):
        r2 = x**2 + y**2
        if model.endswith("FISHEYE"):
            factor = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3 + k4 * r2**4
        else:
            factor = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
        x, y = (
            (u - 2 * p1 * x * y - p2 * (r2 + 2 * x**2) - values.get("sx1", 0.0) * r2) / factor,
            (v - 2 * p2 * x * y - p1 * (r2 + 2 * y**2) - values.get("sy1", 0.0) * r2) / factor,
        )
    longer = np.tan(np.hypot(x, y)) / np.hypot(x, y) if model.endswith("FISHEYE") else 1.0
    return longer * x, longer * y


def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return colours that are linear in the tangents of directions, so that every pinhole shows the same plane."""
    return np.stack([0.5 + 0.4 * x, 0.5 + 0.4 * y, np.full_like(x, 0.25), np.ones_like(x)], axis=-1)


def plane_of(views: ViewSet) -> np.ndarray:
    column, row = np.meshgrid(np.arange(views.width) + 0.5, np.arange(views.height) + 0.5)
    return plane((column - views.width / 2) / views.focal, (row - views.height / 2) / views.focal)


@pytest.mark.parametrize("model", LENSES)
def test_distortion_is_undone(tmp_path: Path, model: str) -> None:
    names = next(names for name, names in MODELS.values() if name == model)
    values = dict(zip(names, LENSES[model], strict=True))
    picture = plane(*ideal(model, values))
    views = read_view_set(write_colmap(tmp_path / "c", (model, LENSES[model]), image=lambda matrix: picture))
    note = next(note for note in views.notes if note.startswith("Distortion, off-centre axes"))
    inner = slice(1, -1)
    off = np.abs(views.test.rgba[0] - plane_of(views))[inner, inner]
    assert off.max() < 4 / 255  # two roundings to 8 bits, and lines that are nearly straight between pixels
    lens, pinhole = Lens.of(model, WIDTH, HEIGHT, values), Lens.pinhole(WIDTH, HEIGHT, views.focal)
    assert lens.holds(pinhole)
    assert not lens.holds(Lens.pinhole(WIDTH, HEIGHT, 0.99 * views.focal))
    column, row = lens.seen_at(*ideal(model, values))
    np.testing.assert_allclose(column, np.arange(WIDTH) + 0.5 + 0 * row, atol=1e-9)
    assert f"which shows {100 * lens.kept(pinhole):.0f} %" in note
    assert 0.4 < lens.kept(pinhole) < 1.0


def test_lenses_of_several_sizes_and_focal_lengths_share_one_pinhole() -> None:
    """The widest that all hold: by the closed form of pinholes, per axis and lens."""
    lenses = [Lens.pinhole(40, 30, 50.0), Lens(30, 40, 40.0, 44.0, 15.0, 21.0), Lens.pinhole(60, 60, 70.0)]
    pinhole = common_pinhole(lenses, "here")
    assert (pinhole.width, pinhole.height) == (30, 30)
    sides = ((min(one.cx, one.width - one.cx) / one.fx, min(one.cy, one.height - one.cy) / one.fy) for one in lenses)
    assert pinhole.fx == pytest.approx(15.0 / min(map(min, sides)), rel=1e-12)
    for lens in lenses:
        column, row = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
        picture = plane((column - lens.cx) / lens.fx, (row - lens.cy) / lens.fy)
        seen = as_pinhole(picture.astype(np.float32), lens, pinhole)
        column, row = np.meshgrid(np.arange(30) + 0.5, np.arange(30) + 0.5)
        np.testing.assert_allclose(seen, plane((column - 15) / pinhole.fx, (row - 15) / pinhole.fx), atol=1e-6)
    assert common_pinhole([Lens.pinhole(80, 60, 100.0), Lens.pinhole(40, 30, 50.0)], "here").fx == pytest.approx(50.0)


def test_a_pinhole_is_not_resampled() -> None:
    lens = Lens.pinhole(WIDTH, HEIGHT, 30.0)
    assert common_pinhole([lens, lens], "here") == lens
    noise = np.random.default_rng(1).random((HEIGHT, WIDTH, 4)).astype(np.float32)
    assert as_pinhole(noise, lens, lens) is noise
    assert lens.scaled(48, 48).fx == 60.0
    # pixels counted from the middle of the first one
    assert Lens.of("PINHOLE", 8, 6, {"fx": 9.0, "fy": 9.0, "cx": 3.5, "cy": 2.5}) == Lens.pinhole(8, 6, 9.0)
    assert Lens.of("PINHOLE", 8, 6, {"fx": 9.0, "fy": 9.0, "cx": 3.5, "cy": 3.0}).cx == 3.5


def test_llff_is_read_as_it_was_written(tmp_path: Path) -> None:
    views = read_view_set(write_llff(tmp_path / "l"))
    np.testing.assert_allclose(views.test.camera_to_world, POSES[::8], atol=1e-12)
    assert views.fov_x_radians == pytest.approx(FOV_X_RADIANS, abs=1e-12)
    assert any("without alpha" in note for note in views.notes)
    assert views.test.rgba[0][..., 3].min() == 1.0


FAR_AWAY = np.concatenate([ON_BALL, 300.0 * ON_BALL])


@pytest.mark.parametrize("make", [lambda folder: write_colmap(folder, points=FAR_AWAY, alpha=False),
                                  lambda folder: write_llff(folder, 1.0, 90.0)])  # fmt: skip
def test_an_unbounded_scene_is_refused_unless_bounds_are_given(tmp_path: Path, make: Callable[[Path], Path]) -> None:
    folder = make(tmp_path / "c")
    with pytest.raises(InputError, match=r"unbounded scene, which no box holds.*--bounds"):
        read_view_set(folder)
    box = (*[-1.1] * 3, *[1.1] * 3)
    np.testing.assert_array_equal(read_view_set(folder, region=Region(box)).bounds.ravel(), box)


def test_far_points_have_no_effect_with_alpha(tmp_path: Path) -> None:
    views = read_view_set(write_colmap(tmp_path / "c", points=FAR_AWAY))
    assert 1.0 < np.abs(views.bounds).max() < 2.0


def test_without_alpha_bounds_are_those_of_the_points(tmp_path: Path) -> None:
    views = read_view_set(write_colmap(tmp_path / "c", alpha=False))
    assert any("Bounds are those of the reconstructed points" in note for note in views.notes)
    assert 1.0 < np.abs(views.bounds).max() < 1.2


def broken(folder: Path, name: str, change: Callable[[str], str]) -> None:
    file = folder / "sparse" / "0" / name
    file.write_text(change(file.read_text()))


REFUSED: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no images": (lambda f: shutil.rmtree(f / "images"), "images: no such folder"),
    "an image lacks": (lambda f: (f / "images" / "v 03.png").unlink(), "v 03.png"),
    "no pose": (lambda f: broken(f, "images.txt", lambda text: "# none\n"), "lists no image"),
    "twice": (lambda f: broken(f, "images.txt", lambda text: text.replace("v 04", "v 03")), "'v 03.png' twice"),
    "no such camera": (lambda f: broken(f, "cameras.txt", lambda text: text.replace("7 S", "8 S")), "has camera 7"),
    "no rotation": (
        lambda f: broken(f, "images.txt", lambda text: "1 0 0 0 0 0 0 0 7 v 00.png\n\n"),
        r"images.txt: the pose of 'v 00.png' is",
    ),
    "out of the folder": (
        lambda f: broken(f, "images.txt", lambda text: text.replace("v 03.png", "../v 03.png")),
        "leaves the folder",
    ),
    "a word": (lambda f: broken(f, "cameras.txt", lambda text: text.replace(" 24", " wide", 1)), "line 2, .*damaged"),
    "part of a pixel": (lambda f: broken(f, "cameras.txt", lambda text: text.replace(" 24", " 24.5", 1)), "damaged"),
    "no points": (lambda f: broken(f, "points3D.txt", lambda text: "1 nan 0 0\n"), "points3D.txt: a point is NaN"),
    "a folding lens": (
        lambda f: broken(f, "cameras.txt", lambda text: "7 SIMPLE_RADIAL 24 24 30.0 12.0 12.0 -900.0\n"),
        "no pinhole fits into a lens of 24 × 24 pixels, focal length 30, distortion -900; correct it or undistort",
    ),
    "another shape": (
        lambda f: write_png(f / "images" / "v 03.png", np.zeros((12, 24, 4))),
        r"v 03.png: 24 × 12 pixels, its camera has 24 × 24",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_invalid_data_is_refused(tmp_path: Path, case: str) -> None:
    change, message = REFUSED[case]
    folder = write_colmap(tmp_path / "c", binary=False)
    change(folder)
    with pytest.raises(InputError, match=message):
        read_view_set(folder)


AS_OTHERS_WRITE: dict[str, Callable[[Path], object]] = {
    "no line for an image without points": lambda f: broken(
        f, "images.txt", lambda text: "".join(line for line in text.splitlines(True) if line.strip())
    ),
    "points of every image": lambda f: broken(
        f, "images.txt", lambda text: text.replace(".png\n\n", ".png\n10.5 11.25 3 7 8.5 -1\n")
    ),
    "a byte order mark": lambda f: broken(f, "cameras.txt", lambda text: "\ufeff" + text),
    "hidden files": lambda f: (f / "images" / ".DS_Store").write_bytes(b"x"),
    "names with the folder": lambda f: broken(f, "images.txt", lambda text: text.replace("v 0", "images/v 0")),
    "names of the photographs": lambda f: broken(f, "images.txt", lambda text: text.replace(".png", ".JPG")),
    "another number of the model": lambda f: (f / "sparse" / "0").rename(f / "sparse" / "1"),
    "sizes with a point": lambda f: broken(f, "cameras.txt", lambda text: text.replace(" 24 24 ", " 24.0 24.0 ")),
    "smaller copies only": lambda f: (f / "images").rename(f / "images_4").with_name("images_8").mkdir(),
    "rounded to three decimals": lambda f: broken(f, "images.txt", lambda text: re.sub(r"(\.\d{3})\d+", r"\1", text)),
}


@pytest.mark.parametrize("case", AS_OTHERS_WRITE)
def test_what_other_programs_write_is_read(tmp_path: Path, case: str) -> None:
    folder = write_colmap(tmp_path / "c", binary=False)
    AS_OTHERS_WRITE[case](folder)
    views = read_view_set(folder)
    assert [len(split.names) for split in (views.train, views.test)] == [COUNT - 3, 3]
    atol = 2e-2 if "rounded" in case else 1e-12
    np.testing.assert_allclose(views.test.camera_to_world, POSES[::8], atol=atol)
    rotation = views.test.camera_to_world[:, :3, :3]
    np.testing.assert_allclose(np.swapaxes(rotation, 1, 2) @ rotation, np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    assert ("images_4 is read" in " ".join(views.notes)) == (case == "smaller copies only")


def test_pixels_are_those_that_are_stored_whatever_a_viewer_turns(tmp_path: Path) -> None:
    folder = write_colmap(tmp_path / "c", alpha=False)
    before = read_view_set(folder).test.rgba[0]
    exif = Image.Exif()
    exif[0x0112] = 3
    for number in (0, 3):
        file = folder / "images" / f"v {number:02d}.png"
        Image.open(file).copy().save(file, exif=exif)
    views = read_view_set(folder)
    np.testing.assert_array_equal(views.test.rgba[0], before)
    assert any("2 of 17 pictures have an EXIF orientation (v 00.png: 3)" in note for note in views.notes)
    exif[0x0112] = 6
    Image.new("RGB", (12, 24)).save(folder / "images" / "v 03.png", exif=exif)
    with pytest.raises(InputError, match=r"v 03\.png: 12 × 24 pixels, its camera has 24 × 24; a viewer turns it"):
        read_view_set(folder)


def test_llff_counts_pictures_alone(tmp_path: Path) -> None:
    folder = write_llff(tmp_path / "l")
    for name in (".DS_Store", "Thumbs.db", "._v00.png"):
        (folder / "images" / name).write_bytes(b"x")
    (folder / "images" / "v03.png").rename(folder / "images" / "v03.PNG")
    assert len(read_view_set(folder).train.names) == COUNT - 3


@pytest.mark.parametrize(("binary", "said"), [(False, "RAD_TAN_THIN_PRISM_FISHEYE"), (True, "11")])
def test_other_lenses_are_refused_by_name(tmp_path: Path, binary: bool, said: str) -> None:
    folder = write_colmap(tmp_path / "c", (UNKNOWN[0], (1.0,) * 16), binary=binary)
    with pytest.raises(InputError, match=f"'{said}'.*image_undistorter"):
        source_of(folder)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_file_that_is_cut_off_is_refused_wherever_it_is_cut(tmp_path: Path, name: str) -> None:
    file = write_colmap(tmp_path / "c") / "sparse" / "0" / name
    complete = file.read_bytes()
    for length in (0, 4, 8, 20, len(complete) // 2, len(complete) - 50, len(complete) - 1):
        file.write_bytes(complete[: max(0, length)])
        with pytest.raises(InputError, match="damaged or cut off"):
            source_of(tmp_path / "c")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (np.zeros((3, 16)), "it must be finite numbers"),
        (np.full((COUNT, 17), np.nan), "it must be finite numbers"),
        (np.ones((2, 17)), "17 images, poses_bounds.npy 2 poses"),
        (np.array([{"a": 1}]), "cannot be read"),
        (None, "an archive of several arrays"),
    ],
)
def test_other_arrays_are_refused(tmp_path: Path, rows: np.ndarray | None, message: str) -> None:
    folder = write_llff(tmp_path / "l")
    if rows is None:
        np.savez(folder / "poses.npz", rows=np.zeros((COUNT, 17)))
        (folder / "poses.npz").replace(folder / "poses_bounds.npy")
    else:
        np.save(folder / "poses_bounds.npy", rows)
    with pytest.raises(InputError, match=message):
        read_view_set(folder)
