"""`transforms.json` of other programs: splits, alpha, the derived region, refusals."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.images import write_png
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import read_view_set
from scenes.view_sets.viewpoints import all_poses
from tests.scenes.captures import Edit, capture, edit


def test_a_capture_without_splits_alpha_and_region(tmp_path: Path) -> None:
    poses = all_poses("train")[:21]
    result = read_view_set(capture(tmp_path / "desk", 21, poses))
    # nerfstudio's default: ceil(0.9 n) by linspace over the sorted names, the rest is evaluated on
    trained = np.linspace(0, 20, 19, dtype=int)
    assert result.train.names == tuple(f"images/frame_{i:05d}" for i in trained)
    assert result.test.names == tuple(f"images/frame_{i:05d}" for i in range(21) if i not in trained)
    assert np.array_equal(result.test.camera_to_world, poses[[i for i in range(21) if i not in trained]])
    assert all((rgba[..., 3] == 1).all() for rgba in result.train.rgba)
    assert result.focal == pytest.approx(20.0, rel=1e-12)
    message = " ".join(result.notes)
    for words in ("19 of 21 views", "without alpha", "derived from the cameras"):
        assert words in message


@pytest.mark.parametrize(("channels", "message"), [(3, "has alpha, but the first"), (4, "has no alpha, but the first")])
def test_alpha_in_only_some_views_is_refused(tmp_path: Path, channels: int, message: str) -> None:
    folder = capture(tmp_path / "desk", 12, all_poses("train")[:12], channels)
    write_png(folder / "images/frame_00004.png", np.full((8, 16, 7 - channels), 0.5))
    with pytest.raises(InputError, match=f"frame_00004.png: {message}"):
        read_view_set(folder)


def test_the_derived_region_holds_every_ray_and_is_the_same_for_every_split(tmp_path: Path) -> None:
    poses = all_poses("train")[:21].copy()
    poses[:, :3, 3] = 10 * poses[:, :3, 3] + [100.0, 50, -20]
    folder = capture(tmp_path / "far", 21, poses)
    result, tested = read_view_set(folder), read_view_set(folder, splits=("test",), counts={"test": 1})
    assert np.array_equal(result.bounds, tested.bounds)
    assert (result.near, result.far) == (tested.near, tested.far)
    assert np.allclose(result.bounds.mean(axis=0), [100, 50, -20], atol=1e-6)
    half = (result.bounds[1] - result.bounds[0]) / 2
    # the corner ray passes the centre at 40.311 · sin of its angle
    assert half == pytest.approx(np.full(3, 40.3112887 * math.sin(math.atan(math.hypot(0.4, 0.2)))), rel=1e-6)
    away = np.linalg.norm(poses[:, :3, 3] - [100, 50, -20], axis=1)
    assert result.near <= (away - half.max()).min()
    assert result.far >= away.max()


@pytest.mark.parametrize(
    ("turn", "message"),
    [
        (lambda poses: np.repeat(poses[:1], 10, axis=0), "--bounds"),
        (lambda poses: poses @ np.diag([-1.0, 1, -1, 1]), "look away"),
    ],
)
def test_cameras_that_look_at_nothing_in_common(
    tmp_path: Path, turn: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    folder = capture(tmp_path / "walk", 10, turn(all_poses("train")[:10]))
    with pytest.raises(InputError, match=message):
        read_view_set(folder)
    result = read_view_set(folder, region=Region((-5, -5, -5, 5, 5, 5), 0.1, 20))
    assert (result.near, result.far, result.bounds.tolist()) == (0.1, 20, [[-5] * 3, [5] * 3])
    assert read_view_set(folder, region=Region((-1, -1, -1, 1, 1, 1))).far > 4


def test_the_user_s_region_overrides_the_file(studio: Path, ball: Path) -> None:
    for folder in (studio, ball):
        result = read_view_set(folder, region=Region((-1, -2, -3, 1, 2, 3), far=9.0))
        assert (result.near, result.far, result.bounds.tolist()) == (2.0, 9.0, [[-1, -2, -3], [1, 2, 3]])


@pytest.mark.parametrize(
    "region",
    [
        ((0, 0, 0, 1, 1, 0), None, None),
        ((0, 0, 0), None, None),
        ((0, 0, 0, 1, 1, 1e-6), None, None),
        ((-1e300, 0, 0, 1, 1, 1), None, None),
        ((*[math.nan] * 3, 1, 1, 1), None, None),
        (None, -1, None),
        (None, 3, 2),
        (None, 1e-300, 1.0),
        (None, 1.0, 1e300),
        (None, None, math.inf),
    ],
)
def test_an_invalid_region_is_refused(region: tuple[Any, Any, Any]) -> None:
    with pytest.raises(InputError, match=r"bounds|near"):
        Region(*region)


def test_val_views_are_the_test_views_where_there_are_no_others(tmp_path: Path) -> None:
    names = [f"images/frame_{i:05d}.png" for i in range(10)]
    splits = {"train_filenames": names[:7], "val_filenames": names[7:]}
    result = read_view_set(capture(tmp_path / "a", 10, all_poses("train")[:10], **splits))
    assert len(result.train.names) == 7
    assert sorted(result.test.names) == [f"images/frame_{i:05d}" for i in (7, 8, 9)]
    assert any("val views are the test views" in note for note in result.notes)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.update(camera_model=["OPENCV"]), "camera_model"),
        (lambda data: data["frames"][1].update(mask_path="masks/1.png"), "mask_path.*alpha"),
        (lambda data: data.update(train_filenames="train/r_0.png"), "`str` .*train_filenames"),
        (lambda data: data.update(test_filenames=[], val_filenames=[]), "test_filenames is missing or empty"),
        (
            lambda data: [data.pop(f"{split}_filenames") for split in ("train", "val", "test")],
            "6 views without splits.*list train_filenames",
        ),
        (lambda data: data["view_region"].update(near=7.0), "near 7.0 and far"),
        (lambda data: data["view_region"].update(bounds=[1, 2]), "bounds"),
    ],
)
def test_invalid_data_is_refused(studio: Path, change: Edit, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read_view_set(edit(studio, change))
    assert str(studio) in str(caught.value)
    assert "\n" not in str(caught.value)
