"""Exported view sets are read by the rules of other programs, and here: round trips."""

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.formats.export import export
from scenes.view_sets.formats.nerfstudio import write_nerfstudio
from scenes.view_sets.images import read_image, write_png
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import read_view_set
from scenes.view_sets.viewpoints import all_poses
from tests.scenes.captures import as_load_blender, capture


def as_nerfstudio(folder: Path, split: str) -> tuple[list[Path], np.ndarray, dict[str, float]]:
    """Images, poses and intrinsics as nerfstudio 1.1.5 finds them (`nerfstudio_dataparser.py`): frames sorted by path,
    all three lists of names required once there is one, paths with suffix, nothing assumed."""
    meta = json.loads((folder / "transforms.json").read_text())
    frames = sorted(meta["frames"], key=lambda frame: folder / frame["file_path"])
    files = [folder / frame["file_path"] for frame in frames]
    assert all(file.is_file() for file in files)
    names = {folder / name for name in meta[f"{split}_filenames"]}
    assert names <= set(files)
    chosen = [i for i, file in enumerate(files) if file in names]
    lens = {key: float(meta[key]) for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "p1", "p2")}
    assert meta["camera_model"] in ("OPENCV", "SIMPLE_PINHOLE", "PINHOLE")
    return [files[i] for i in chosen], np.array([frames[i]["transform_matrix"] for i in chosen]), lens


def test_nerfstudio_finds_views_and_lens(ball: Path, studio: Path) -> None:
    own = read_view_set(ball)
    for split, mine in (("train", own.train), ("test", own.test), ("val", own.test)):
        files, poses, lens = as_nerfstudio(studio, split)
        assert np.array_equal(poses, mine.camera_to_world)
        for file, rgba in zip(files, mine.rgba, strict=True):
            assert np.array_equal(read_image(file), rgba)
        assert lens["fl_x"] == lens["fl_y"] == pytest.approx(own.focal, rel=1e-14)
        assert (lens["cx"], lens["cy"], lens["w"], lens["h"]) == (6.0, 6.0, 12.0, 12.0)


def test_the_original_loader_finds_all_three_splits(ball: Path, tmp_path: Path) -> None:
    message = export(ball, "blender", tmp_path / "blender")
    assert any("no val views" in line for line in message)
    result = as_load_blender(tmp_path / "blender")
    for split, source in (("train", "train"), ("val", "test"), ("test", "test")):
        files, poses, angle = result[split]
        meta = json.loads((ball / f"transforms_{source}.json").read_text())
        assert np.array_equal(poses, [frame["transform_matrix"] for frame in meta["frames"]])
        assert angle == meta["camera_angle_x"]
        assert [file.read_bytes() for file in files] == [
            (ball / f"{frame['file_path']}.png").read_bytes() for frame in meta["frames"]
        ]


def test_through_nerfstudio_and_back(ball: Path, studio: Path) -> None:
    there, back = read_view_set(ball), read_view_set(studio)
    assert back.focal == pytest.approx(there.focal, rel=1e-12)
    assert (back.near, back.far, back.bounds.tolist()) == (there.near, there.far, there.bounds.tolist())
    assert back.val.names == ()
    assert back.notes == ()
    for one, other in ((there.train, back.train), (there.test, back.test)):
        assert one.names == other.names
        assert np.abs(one.camera_to_world - other.camera_to_world).max() <= 1e-12
        assert all(np.array_equal(a, b) for a, b in zip(one.rgba, other.rgba, strict=True))


def test_through_npz_and_back(ball: Path, tmp_path: Path) -> None:
    export(ball, "npz", tmp_path / "ball.npz")
    with np.load(tmp_path / "ball.npz", allow_pickle=False) as data:  # as the notebook does
        images, poses, focal = data["images"], data["poses"], data["focal"]
        assert images.dtype == np.float32
        assert images.shape == (6, 12, 12, 3)
        assert poses.shape == (6, 4, 4)
    there, back = read_view_set(ball), read_view_set(tmp_path / "ball.npz")
    assert float(focal) == pytest.approx(there.focal, rel=1e-12)
    assert back.focal == pytest.approx(there.focal, rel=1e-12)
    assert np.allclose(images[0], there.train.rgba[0][..., :3] * there.train.rgba[0][..., 3:], atol=1e-7)
    assert np.array_equal(back.bounds, there.bounds)
    for one, other in ((there.train, back.train), (there.test, back.test)):
        assert np.array_equal(one.camera_to_world, other.camera_to_world)
        for a, b in zip(one.rgba, other.rgba, strict=True):
            seen = a[..., 3] > 0  # over black, colour that nothing covers is lost
            assert np.array_equal(np.round(a[seen] * 255), np.round(b[seen] * 255))
            assert np.array_equal(a[..., 3], b[..., 3])
    export(tmp_path / "ball.npz", "blender", tmp_path / "again")
    assert np.array_equal(read_view_set(tmp_path / "again").test.camera_to_world, there.test.camera_to_world)


def test_our_own_rendered_sets_come_with_both(view_set: Path) -> None:
    before = read_view_set(view_set)
    (view_set / "view_set.json").unlink()
    for listing in view_set.glob("transforms_*.json"):
        listing.unlink()
    result = read_view_set(view_set)
    assert np.array_equal(result.train.camera_to_world, before.train.camera_to_world)
    assert result.val.names == before.val.names
    assert np.array_equal(result.bounds, before.bounds)
    assert result.focal == pytest.approx(before.focal, rel=1e-12)


def test_what_is_no_view_set_and_no_place_to_export_to(tmp_path: Path, ball: Path) -> None:
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(InputError, match="not a view set"):
        read_view_set(tmp_path / "a.txt")
    with pytest.raises(InputError, match=r"ends in \.npz"):
        export(ball, "npz", tmp_path / "a.tiny")
    with pytest.raises(InputError, match="cannot be written"):
        export(ball, "blender", tmp_path / "a.txt" / "b")


@pytest.mark.parametrize(("form", "name"), [("nerfstudio", "new"), ("blender", "new"), ("npz", "new.npz")])
def test_a_set_that_is_damaged_leaves_nothing_behind(view_set: Path, tmp_path: Path, form: str, name: str) -> None:
    (tmp_path / "out").mkdir()
    shutil.copy(view_set / "test/r_0.png", view_set / "test/r_1.png")  # a valid image, but of another view
    with pytest.raises(InputError, match=r"test/r_1\.png.*checksum"):
        export(view_set, form, tmp_path / "out" / name)
    (view_set / "view_set.json").unlink()
    (view_set / "test/r_1.png").write_bytes(b"\x89PNG of nothing")
    with pytest.raises(InputError, match=r"test/r_1\.png"):
        export(view_set, form, tmp_path / "out" / name)
    write_png(view_set / "test/r_1.png", np.ones((3, 3, 4), dtype=np.float32))
    with pytest.raises(InputError, match="not 16 × 16 pixels"):
        export(view_set, form, tmp_path / "out" / name)
    assert list((tmp_path / "out").iterdir()) == []


def test_opaque_images_get_an_alpha_when_they_are_exported(tmp_path: Path) -> None:
    export(capture(tmp_path / "desk", 10, all_poses("train")[:10]), "blender", tmp_path / "out")
    files, poses, angle = as_load_blender(tmp_path / "out")["train"]
    assert (read_image(files[3])[..., 3] == 1).all()
    assert angle == pytest.approx(2 * math.atan(16 / 40), rel=1e-14)
    assert len(poses) == 9


def test_a_lens_is_undone_when_its_pictures_are_exported(tmp_path: Path) -> None:
    folder = capture(tmp_path / "desk", 10, all_poses("train")[:10], channels=4, k1=-0.2)
    export(folder, "nerfstudio", tmp_path / "out")
    before, after = read_view_set(folder), read_view_set(tmp_path / "out")
    assert after.focal == pytest.approx(before.focal, rel=1e-12)
    assert after.focal < 19.9, "a barrel sees more"
    np.testing.assert_allclose(list(after.test.rgba), list(before.test.rgba), atol=0.5 / 255 + 1e-6)


def test_instant_ngp_s_box_holds_everything(tmp_path: Path) -> None:
    for reach, scale in ((1.5, 1), (1.6, 2), (20.0, 16), (1e4, 128)):
        region = Region((-reach, -1, -1, 1, 1, 1), 1.0, 2.0)
        write_nerfstudio(tmp_path / "t.json", {"train": (["a"], np.eye(4)[None])}, (4, 4), 3.0, region)
        assert json.loads((tmp_path / "t.json").read_text())["aabb_scale"] == scale
