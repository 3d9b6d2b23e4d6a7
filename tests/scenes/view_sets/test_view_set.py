"""Reading view sets: rendered here, and by other programs at any size."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scenes.files.errors import InputError
from scenes.view_sets.formats.transforms import write_transforms
from scenes.view_sets.images import read_channels, read_image, write_png
from scenes.view_sets.manifest import DamagedViewSet, note, salvaged, write_manifest
from scenes.view_sets.pixels import area_average, decode_srgb, over_white
from scenes.view_sets.view_set import ViewSet, read_view_set
from scenes.view_sets.viewpoints import FOV_X_RADIANS, all_poses, camera_to_world
from tests.scenes.captures import edit, flip


def test_round_trip(stored_once: Path) -> None:
    result = read_view_set(stored_once, geometry=("train", "val", "test"))
    assert (result.name, result.title, result.width, result.height) == ("tiny", "A ball on a floor", 16, 16)
    assert (result.near, result.far, result.fov_x_radians) == (2.0, 6.0, FOV_X_RADIANS)
    assert result.focal == pytest.approx(1111.11 * 16 / 800, abs=1e-3)
    assert result.bounds == pytest.approx(np.array([[-1.021, -1.021, -0.721], [1.021, 1.021, 0.621]]), abs=1e-5)
    for split in ("train", "val", "test"):
        views = getattr(result, split)
        poses = camera_to_world(split, count=len(views.names))  # type: ignore[arg-type]
        assert np.array_equal(views.camera_to_world, poses)
        assert views.rgba[0].dtype == np.float32
        assert views.rgba.shape == (len(poses), 16, 16, 4)
        assert views.depth.shape == views.rgba.shape[:3]
        assert views.normal.shape == (*views.rgba.shape[:3], 3)
        assert (views.noise_mse > 0).all()
        for name, rgba, depth in zip(views.names, views.rgba, views.depth, strict=True):
            png = read_image(stored_once / f"{name}.png")
            assert np.abs(over_white(png) - over_white(rgba)).max() < 1.01 / 255
            exr = read_channels(stored_once / f"{name}.exr")
            assert set(exr) == {*"RGBA", "Z", "N.X", "N.Y", "N.Z", "V.R", "V.G", "V.B", "V.A"}
            linear = np.stack([exr[c] for c in "RGB"], axis=-1)
            bright = (linear < exr["A"][..., None]) & (exr["A"][..., None] > 0)
            assert np.abs(decode_srgb(rgba[..., :3]) * exr["A"][..., None] - linear)[bright.squeeze()].max() < 1e-5
            assert np.array_equal(depth, exr["Z"])
            assert ((depth > 0) == (np.linalg.norm(views.normal[0], axis=-1) > 0)).mean() > 0.5
    assert result.rendered["counts"] == {"train": 3, "val": 1, "test": 2}
    assert result.rendered["variant"] == "scalar_rgb"
    assert {row["what"] for row in result.rendered["left_out"]} >= {"view-direction branch", "volumetric integrator"}


def test_a_smaller_size_is_the_mean_in_linear_light(stored_once: Path) -> None:
    small = read_view_set(stored_once, resolution=4)
    assert small.test.rgba.shape == (2, 4, 4, 4)
    assert small.focal == pytest.approx(1111.11 * 4 / 800, abs=1e-3)
    exr = read_channels(stored_once / "test/r_0.exr")
    linear = area_average(np.stack([exr[c] for c in "RGBA"], axis=-1), 4)
    shown = small.test.rgba[0]
    below = (linear[..., :3] < linear[..., 3:]) & (linear[..., 3:] > 0)
    error = np.abs(decode_srgb(shown[..., :3]) * shown[..., 3:] - linear[..., :3])
    assert error[below].max() < 1e-5
    assert small.test.noise_mse == pytest.approx(read_view_set(stored_once).test.noise_mse / 16)
    hit = small.test.depth[0] > 0
    assert 3.0 < small.test.depth[0][hit].min() < small.test.depth[0].max() < 6.0


def test_counts_take_subsets_spread_over_azimuth(stored_once: Path) -> None:
    result = read_view_set(stored_once, splits=("train", "test"), counts={"train": 2, "test": 1})
    assert len(result.train.names) == 2
    assert len(result.test.names) == 1
    assert result.val.rgba.shape == (0, 16, 16, 4)
    complete = read_view_set(stored_once, counts={"train": 999})
    assert len(complete.train.names) == 3
    assert (complete.train.depth, complete.test.depth is None) == (None, False)  # geometry only of the test views


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A folder like `nerf_synthetic/lego`: 40 × 40 RGBA PNGs, no EXR, no manifest, no val, extra test files."""
    root = tmp_path / "lego"
    for split, count in (("train", 5), ("test", 8)):
        (root / split).mkdir(parents=True)
        for number in range(count):
            random = np.random.default_rng(number)
            write_png(root / split / f"r_{number}.png", random.uniform(size=(40, 40, 4)))
        paths = [f"./{split}/r_{number}" for number in range(count)]
        write_transforms(root / f"transforms_{split}.json", FOV_X_RADIANS, paths, all_poses(split)[:count])
    write_png(root / "test" / "r_0_depth_0001.png", np.zeros((9, 9, 4)))
    return root


def test_a_folder_of_the_field_is_read(foreign: Path) -> None:
    result = read_view_set(foreign)
    assert isinstance(result, ViewSet)
    assert (result.name, result.rendered, result.near, result.far) == ("lego", {}, 2.0, 6.0)
    assert result.bounds.tolist() == [[-1.5] * 3, [1.5] * 3]
    assert result.train.rgba.shape == (5, 40, 40, 4)
    assert result.val.names == ()
    assert result.test.depth is None
    assert result.test.noise_mse is None
    assert result.test.names == tuple(f"test/r_{n}" for n in range(8))
    assert np.array_equal(result.train.camera_to_world, all_poses("train")[:5])
    assert np.abs(result.train.rgba[2] * 255 - np.array(Image.open(foreign / "train/r_2.png"))).max() < 1e-3


@pytest.mark.parametrize(
    ("listed", "read", "said"),
    [
        ({"train": 12}, [11, 0, 1], "11 of 12 views, evenly spread, train"),
        ({"train": 5, "val": 0, "test": 3}, [5, 0, 3], ""),
        ({"train": 12, "val": 2}, [12, 0, 2], "the val views are the test views"),
        ({"train": 12, "val": 0, "test": 0}, [11, 0, 1], "11 of 12 views, evenly spread, train"),
    ],
)
def test_listings_that_are_empty_or_missing(tmp_path: Path, listed: dict[str, int], read: list[int], said: str) -> None:
    for split, count in listed.items():
        for number in range(count):
            write_png(tmp_path / f"{split}_{number}.png", np.full((4, 4, 4), 0.5))
        paths = [f"./{split}_{number}" for number in range(count)]
        poses = all_poses("test")[10 * len(split) :][:count]
        write_transforms(tmp_path / f"transforms_{split}.json", FOV_X_RADIANS, paths, poses)
    result = read_view_set(tmp_path)
    assert [len(split.names) for split in (result.train, result.val, result.test)] == read
    assert said in " ".join(result.notes)
    assert bool(said) == bool(result.notes)


def test_what_was_assumed_is_said_of_every_listing(foreign: Path) -> None:
    edit(foreign, lambda data: data["frames"][2].update(time=0.5), "transforms_test.json")
    assert read_view_set(foreign).notes == (
        "Frames have different times: they are read as one scene that does not move.",
    )


@pytest.mark.parametrize("size", [40, 20, 17, 1])
def test_at_any_size(foreign: Path, size: int) -> None:
    result = read_view_set(foreign, resolution=size, counts={"test": 3})
    assert result.test.rgba.shape == (3, size, size, 4)
    name = result.test.names[1]
    full = over_white(read_image(foreign / f"{name}.png"))
    assert np.abs(over_white(result.test.rgba[1]) - area_average(full, size)).max() < 1e-5
    assert result.focal == pytest.approx(1111.11 * size / 800, rel=1e-5)


def test_test_views_of_another_size_are_refused(foreign: Path) -> None:
    """`tests/hostile` has more ways to damage such a folder."""
    for file in foreign.glob("test/r_?.png"):
        write_png(file, np.zeros((20, 20, 4)))
    with pytest.raises(InputError, match=r"lego/test/r_0\.png: 20 × 20 pixels"):
        read_view_set(foreign)


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        *(({"resolution": size}, "resolution") for size in (0, -5, 41)),
        ({"splits": ("train",), "counts": {"train": 0}}, "no view"),
        ({"counts": {"train": -1}}, "0 or more"),
    ],
)
def test_invalid_requests_are_refused(foreign: Path, request_: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_view_set(foreign, **request_)


def test_more_than_the_disk_has_room_for_is_refused(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=100_000))
    with pytest.raises(InputError, match=r"0 MiB are free.*make room"):
        read_view_set(foreign, scratch=foreign)
    assert read_view_set(foreign, resolution=10, scratch=foreign).width == 10


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *((lambda text, new=new: new, r"view_set\.json") for new in ("", "[]", "{}", '{"format": "something else"}')),
        (lambda text: text.replace('"near": 2.0', '"near": 1.0'), "checksum"),
    ],
)
def test_another_manifest_is_refused(view_set: Path, change: Callable[[str], str], message: str) -> None:
    file = view_set / "view_set.json"
    file.write_text(change(file.read_text()))
    with pytest.raises(InputError, match=message):
        read_view_set(view_set)


@pytest.mark.parametrize("name", ["train/r_0.exr", "transforms_test.json"])
@pytest.mark.parametrize("how", ["flip", "remove"])
def test_a_damaged_file_is_noticed(view_set: Path, name: str, how: str) -> None:
    flip(view_set / name) if how == "flip" else (view_set / name).unlink()
    with pytest.raises(InputError, match=name):
        read_view_set(view_set)


def test_repeated_views_are_reported(foreign: Path) -> None:
    assert read_view_set(foreign).repeated_views == ()
    train, test = (json.loads((foreign / f"transforms_{split}.json").read_text()) for split in ("train", "test"))
    train["frames"][1]["transform_matrix"] = train["frames"][0]["transform_matrix"]
    test["frames"][0]["transform_matrix"] = train["frames"][-1]["transform_matrix"]
    for split, data in (("train", train), ("test", test)):
        (foreign / f"transforms_{split}.json").write_text(json.dumps(data))
    repeated = [re.sub(r" \S+( has|$)", r"\1", message) for message in read_view_set(foreign).repeated_views]
    assert repeated == ["train: has the camera of train:", "test: has the camera of train:"]
    assert read_view_set(foreign, splits=("test",)).repeated_views == ()


def rewritten(view_set: Path, **changes: object) -> None:
    """Write the manifest with other facts and a correct checksum."""
    manifest = json.loads((view_set / "view_set.json").read_text())
    files = [view_set / name for name in manifest["files"]]
    own = ("checksum", "format", "schema", "files")
    write_manifest(view_set, {**{key: manifest[key] for key in manifest if key not in own}, **changes}, files)


def test_an_invalid_interval_of_distances_is_refused(view_set: Path) -> None:
    rewritten(view_set, near=6.0, far=2.0)
    with pytest.raises(InputError, match=r"near 6.0 and far 2.0"):
        read_view_set(view_set)


@pytest.mark.parametrize("key", ["empty_splits", "needs", "left_out", "views"])
def test_facts_that_are_null_are_refused(view_set: Path, key: str) -> None:
    rewritten(view_set, **{key: None})
    with pytest.raises(DamagedViewSet, match=rf"got `null` - at `\$\.{key}`: render"):
        read_view_set(view_set)


GOOD = {"noise_mse": 1e-6, "seconds": 0.5, "seen": True, "lit": False}


def donor(folder: Path, facts: dict[str, Any]) -> Path:
    (folder / "train").mkdir(parents=True)
    for suffix in ("png", "exr"):
        (folder / "train" / f"r_0.{suffix}").write_bytes(suffix.encode())
    note(folder, "an order", "train/r_0", facts)
    return folder


def test_views_in_the_journal_are_taken_with_their_files(tmp_path: Path) -> None:
    (tmp_path / "new").mkdir()
    result = salvaged(tmp_path / "new", [donor(tmp_path / "old", GOOD)], "an order", ["train/r_0"])
    assert result == {"train/r_0": GOOD}
    assert (tmp_path / "new" / "train" / "r_0.exr").read_bytes() == b"exr"


@pytest.mark.parametrize(
    "change",
    [*({"noise_mse": wrong} for wrong in (None, "0", True, 10**400)), {"seconds": "1"}, {"lit": 7}],
)
def test_invalid_facts_are_a_miss_though_their_digest_is_right(tmp_path: Path, change: dict[str, Any]) -> None:
    (tmp_path / "new").mkdir()
    assert salvaged(tmp_path / "new", [donor(tmp_path / "old", GOOD | change)], "an order", ["train/r_0"]) == {}
