"""Listings as other programs document or write them, each with the rays that its own conventions give."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.formats.transforms import read_listing
from scenes.view_sets.images import display_image, display_levels, pictures, write_png
from scenes.view_sets.view_set import check_listed, read_view_set
from scenes.view_sets.viewpoints import all_poses
from tests.scenes.view_sets.test_captures import write_colmap, write_llff

WIDTH, HEIGHT, FOCAL = 36, 24, 40.0
POSES = all_poses("test")[:3]
ANGLES = {"camera_angle_x": 2 * math.atan(0.5 * WIDTH / FOCAL), "camera_angle_y": 2 * math.atan(0.5 * HEIGHT / FOCAL)}
LENS = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
STRAIGHT = dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2"), 0.0)
Document = dict[str, Any]


def frames(path: str = "images/{}.png", more: Callable[[int], Document] = lambda number: {}) -> list[Document]:
    return [
        {"file_path": path.format(number), "transform_matrix": pose.tolist(), **more(number)}
        for number, pose in enumerate(POSES)
    ]


def matrices(change: Callable[[np.ndarray], np.ndarray]) -> list[Document]:
    return [{**frame, "transform_matrix": change(pose).tolist()} for frame, pose in zip(frames(), POSES, strict=True)]


WRITTEN: dict[str, Document] = {
    "NeRF's synthetic scenes": {"camera_angle_x": ANGLES["camera_angle_x"],
                                "frames": frames("./images/{}", lambda k: {"rotation": 0.0126})},
    "BlenderNeRF": {**ANGLES, **LENS, **STRAIGHT, "is_fisheye": False, "aabb_scale": 4, "frames": frames()},
    "BlenderNeRF on Windows": {**ANGLES, **LENS, "frames": frames("images\\{}.png")},
    "BlenderNeRF, height of the sensor": {
        **LENS, "camera_angle_x": 2 * math.atan(0.75 * HEIGHT / FOCAL), "camera_angle_y": ANGLES["camera_angle_y"],
        "frames": frames()},
    "Blender, an angle of five digits": {"camera_angle_x": round(ANGLES["camera_angle_x"], 5), "frames": frames()},
    "Blender, a camera with a scale": {**LENS, "frames": matrices(lambda pose: pose @ np.diag([0.5, 0.5, 0.5, 1.0]))},
    "instant-ngp": {**ANGLES, **LENS, **STRAIGHT, "scale": 1.0, "offset": [0.5, 0.5, 0.5], "aabb_scale": 16,
                    "frames": frames("./images/{}.png", lambda k: {"sharpness": 90.5})},
    "instant-ngp, a lens per camera": {"frames": frames(more=lambda k: {**ANGLES, **LENS, **STRAIGHT})},
    "instant-ngp, three rows": {**LENS, "frames": matrices(lambda pose: pose[:3])},
    "nerfcapture": {**LENS, "fl_x": 1.004 * FOCAL, "fl_y": 1.004 * FOCAL, "integer_depth_scale": 0.001,
                    "frames": frames(more=lambda k: {**LENS, "depth_path": "x.png"})},
    "record3d": {**LENS, "camera_angle_x": ANGLES["camera_angle_x"], "scale": 0.5, "frames": frames()},
    "nerfstudio": {**LENS, **STRAIGHT, "camera_model": "OPENCV", "applied_transform": np.eye(4)[:3].tolist(),
                   "ply_file_path": "sparse_pc.ply", "frames": frames(more=lambda k: {"colmap_im_id": k + 1})},
    "nerfstudio, a lens per frame": {"camera_model": "OPENCV", "frames": frames(more=lambda k: {**LENS, **STRAIGHT})},
    "RealityCapture": {"camera_model": "OPENCV", "frames": frames(
        more=lambda k: {**LENS, **{key: "0.0" for key in STRAIGHT}})},
    "Polycam": {"camera_model": "OPENCV", "orientation_override": "none", "frames": frames(
        more=lambda k: {**LENS, "depth_file_path": "d.png", "blur_score": 3.1, "timestamp": 5})},
    "Metashape": {**LENS, **STRAIGHT, "camera_model": "OPENCV", "b1": 0.0, "b2": 0.0, "frames": frames()},
    "D-NeRF": {"camera_angle_x": ANGLES["camera_angle_x"], "frames": frames(more=lambda k: {"time": k / 2})},
    "times as text": {**LENS, "frames": frames(more=lambda k: {"time": str(k / 2)})},
    "only smaller copies": {**LENS, "frames": frames("images/small{}.png")},
    "absolute paths": {**LENS, "frames": frames("ROOT/images/{}.png")},
    "capitals": {**LENS, "frames": frames("images/{}.PNG")},
    "keys that are null": {**LENS, "camera_angle_x": None, "k1": None, "frames": frames()},
    "matrices of six digits": {**LENS, "frames": matrices(lambda pose: np.round(pose, 6))},
    "a last number of 2": {**LENS, "frames": matrices(lambda pose: 2.0 * pose)},
}  # fmt: skip


def write(folder: Path, document: Document) -> Path:
    named = [frame["file_path"] for frame in document["frames"]]
    place = folder / ("images_4" if "small" in named[0] else "images")
    place.mkdir(parents=True)
    for number, path in enumerate(named):
        write_png(place / (Path(path).name if "small" in path else f"{number}.png"), np.full((HEIGHT, WIDTH, 4), 0.5))
    file = folder / "transforms.json"
    file.write_text(json.dumps(document).replace("ROOT", folder.as_posix()), encoding="utf-8")
    return file


def directions(focal: float, poses: np.ndarray) -> np.ndarray:
    """Return the rays [poses, corners, 3] through corners and middle of a picture, by the conventions of OpenGL."""
    u, v = (np.array(places) for places in ((0, WIDTH, 0, WIDTH, WIDTH / 2), (0, 0, HEIGHT, HEIGHT, HEIGHT / 2)))
    local = np.stack([(u - WIDTH / 2) / focal, -(v - HEIGHT / 2) / focal, -np.ones(5)], axis=-1)
    rays = local @ np.swapaxes(poses[:, :3, :3], 1, 2)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


@pytest.mark.parametrize("program", WRITTEN)
def test_rays_are_those_of_the_program_that_wrote_the_listing(program: str, tmp_path: Path) -> None:
    read = read_listing(write(tmp_path / "scene", WRITTEN[program])).frames
    focal = 0.5 * WIDTH / math.tan(0.5 * read.fov_x_radians)
    off = np.linalg.norm(directions(focal, read.camera_to_world) - directions(FOCAL, POSES), axis=-1)
    # the angle of five digits and the matrices of six are off by their rounding
    assert np.degrees(off).max() < (1e-5 if "digits" not in program else 4e-4)
    np.testing.assert_allclose(read.camera_to_world[:, :3, 3], POSES[:, :3, 3], atol=1e-6)
    assert len({*read.files}) == len(POSES)


def test_lenses_of_frames_decide_only_if_every_frame_has_one(tmp_path: Path) -> None:
    file = write(tmp_path / "scene", WRITTEN["nerfcapture"])
    assert "cx" not in (notes := " ".join(read_listing(file).notes))
    assert "fl_x fl_y: given for all frames and for each frame; those of the frames decide." in notes
    document = json.loads(file.read_text())
    del document["frames"][1]["fl_x"]
    file.write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"frame 0: fl_x is 40.0, and 40.16 for all frames; keep one of them"):
        read_listing(file)


def test_names_whose_accents_are_encoded_in_another_way_are_one(tmp_path: Path) -> None:
    file = write(tmp_path / "scene", {**LENS, "frames": frames("images/Bild {}.png")})
    for number in range(3):
        (file.parent / "images" / f"{number}.png").rename(file.parent / "images" / f"Bild a\u0308{number}.png")
    file.write_text(json.dumps({**LENS, "frames": frames("images/Bild ä{}.png")}))
    assert len(read_listing(file).frames.files) == 3


def test_pictures_have_the_order_of_their_names_whatever_links_lead_to(tmp_path: Path) -> None:
    (tmp_path / "raw").mkdir()
    (tmp_path / "images").mkdir()
    for name, target in (("a.png", "2.png"), ("b.png", "1.png")):
        write_png(tmp_path / "raw" / target, np.zeros((2, 2, 4)))
        (tmp_path / "images" / name).symlink_to(tmp_path / "raw" / target)
    assert [file.name for file in pictures(tmp_path / "images")] == ["2.png", "1.png"]


@pytest.mark.parametrize("make", [write_colmap, write_llff])
def test_pictures_on_another_disk_are_read(make: Callable[[Path], Path], tmp_path: Path) -> None:
    folder = make(tmp_path / "here" / "scene")
    (tmp_path / "disk").mkdir()
    (folder / "images").rename(tmp_path / "disk" / "photographs")
    (folder / "images").symlink_to(tmp_path / "disk" / "photographs")
    assert all(name.startswith("photographs/") for name in read_view_set(folder).train.names)


def test_a_listing_reached_by_a_link_may_name_its_pictures_by_that_link(tmp_path: Path) -> None:
    write(tmp_path / "scene", {**LENS, "frames": frames(f"{tmp_path.as_posix()}/link/images/{{}}.png")})
    (tmp_path / "link").symlink_to(tmp_path / "scene")
    assert len(read_listing(tmp_path / "link" / "transforms.json").frames.files) == 3


@pytest.mark.parametrize("is_times_alpha", [False, True])
def test_colour_times_alpha_of_a_tiff_is_divided_by_alpha(is_times_alpha: bool, tmp_path: Path) -> None:
    pixels = np.array([[[0.6, 0.3, 0.9, 0.5], [0.0, 0.0, 0.0, 0.0]]], dtype=np.float32)
    stored = pixels * np.where([True, True, True, False], pixels[..., 3:], 1.0) if is_times_alpha else pixels
    spec = oiio.ImageSpec(2, 1, 4, oiio.UINT16)
    spec.attribute("oiio:UnassociatedAlpha", 0 if is_times_alpha else 1)
    out = oiio.ImageOutput.create(str(tmp_path / "a.tif"))
    assert out.open(str(tmp_path / "a.tif"), spec)
    assert out.write_image(stored.astype(np.float32))
    out.close()
    np.testing.assert_allclose(display_image(tmp_path / "a.tif"), pixels, atol=1e-4)
    np.testing.assert_allclose(display_levels(tmp_path / "a.tif", 4) / 65535, pixels, atol=1e-4)


def test_splits_of_nearly_equal_lenses_are_one_and_others_are_told_the_way_out(tmp_path: Path) -> None:
    for split, angle in (("train", 0.69111), ("test", 0.6911112)):
        write(tmp_path / "scene" / split, WRITTEN["nerfstudio"])
        document = {"camera_angle_x": angle, "frames": frames(f"./{split}/images/{{}}")}
        (tmp_path / "scene" / f"transforms_{split}.json").write_text(json.dumps(document))
    assert len(read_view_set(tmp_path / "scene").train.names) == 3
    document["camera_angle_x"] = 0.7
    (tmp_path / "scene" / "transforms_test.json").write_text(json.dumps(document))
    for read in (read_view_set, check_listed):  # the latter for --dry-run
        with pytest.raises(InputError, match=r"train 0.69111, test 0.7 rad.*list all views in one transforms.json"):
            read(tmp_path / "scene")
