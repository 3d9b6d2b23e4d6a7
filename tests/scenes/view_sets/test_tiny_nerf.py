"""The `.npz` of the tiny-NeRF notebook, and invalid files of that kind."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.view_set import read_view_set
from scenes.view_sets.viewpoints import all_poses
from tests.scenes.captures import flip


def tiny(file: Path, count: int = 12, **change: Any) -> Path:
    arrays = {
        "images": np.random.default_rng(1).uniform(size=(count, 6, 6, 3)).astype(np.float32),
        "poses": np.tile(all_poses("train")[:10], (11, 1, 1))[:count].astype(np.float32),
        "focal": np.array(8.3),
    }
    np.savez(file, **{name: value for name, value in {**arrays, **change}.items() if value is not None})
    return file


def test_the_notebook_s_file(tmp_path: Path) -> None:
    result = read_view_set(tiny(tmp_path / "tiny_nerf_data.npz", 106))
    images = np.load(tmp_path / "tiny_nerf_data.npz")["images"]
    assert (result.name, result.near, result.far) == ("tiny_nerf_data", 2.0, 6.0)
    assert len(result.train.names) == 100
    assert result.test.names == tuple(f"images/{i}" for i in range(100, 106))
    assert np.array_equal(result.test.rgba[1][..., :3], images[101])
    assert (result.test.rgba[1][..., 3] == 1).all()
    assert result.focal == pytest.approx(8.3, rel=1e-12)
    assert "no alpha" in " ".join(result.notes)
    assert result.bounds[1].max() > 1.5


def test_any_order_of_reading_and_compressed(tmp_path: Path) -> None:
    data = dict(np.load(tiny(tmp_path / "a.npz", 106)))
    np.savez_compressed(tmp_path / "b.npz", **data)
    result = read_view_set(tmp_path / "b.npz", counts={"train": 3}, splits=("test", "train"))
    for i, name in enumerate(result.train.names):
        assert np.array_equal(result.train.rgba[i][..., :3], data["images"][int(name.rpartition("/")[2])])


def header(shape: tuple[int, ...]) -> bytes:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return head.getvalue()


def holding(file: Path, images: bytes) -> None:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("images.npy", images)


def pickled(file: Path) -> None:
    np.savez(file, images=np.array([{"a": 1}], dtype=object), allow_pickle=True)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        # numpy reads a header with Python's tokenizer, which has other exceptions
        (lambda file: holding(file, header((12, 6, 6, 3)).replace(b"}  ", b"} )")), "images cannot be read"),
        # a kilobyte that says it holds a terabyte
        (lambda file: holding(file, header((100, 50_000, 50_000, 3)) + bytes(100_000)), "more than .* bytes"),
        (pickled, "images holds object"),
        (lambda file: file.write_bytes(tiny(file).read_bytes()[:2000]), "cannot be read"),
        (lambda file: flip(tiny(file), 1500), "images cannot be read"),
        (lambda file: file.write_text("hello"), "cannot be read"),
        (lambda file: tiny(file, focal=None), "no array 'focal'"),
        (lambda file: tiny(file, focal=np.array([1.0, 2.0])), "focal must be one"),
        (lambda file: tiny(file, focal=np.array(-1.0)), "focal must be one"),
        (lambda file: tiny(file, focal=np.array(0.01)), "focal 0.01: the field of view is 17.*in pixels"),
        (lambda file: tiny(file, focal=np.array(np.nan)), "focal holds NaN"),
        (lambda file: tiny(file, poses=np.zeros((12, 3, 4))), "poses is"),
        (lambda file: tiny(file, poses=np.zeros((12, 4, 4))), "pose 0"),
        (lambda file: tiny(file, images=np.zeros((12, 6, 6), dtype=np.float32)), "images is"),
        (lambda file: tiny(file, images=np.full((12, 6, 6, 3), 200.0)), "must lie in 0 … 1"),
        (lambda file: tiny(file, images=np.full((12, 6, 6, 3), np.nan)), "NaN"),
        (lambda file: tiny(file, 5), "too few"),
        (lambda file: tiny(file, i_train=np.arange(5), i_test=np.arange(4, 8)), "share views"),
        (lambda file: tiny(file, i_train=np.arange(5), i_test=np.array([99])), "i_test must name"),
        (lambda file: tiny(file, bounds=np.zeros(6)), "bounds"),
        (lambda file: tiny(file, alpha=np.zeros(3)), "alpha is"),
    ],
)
def test_an_invalid_tiny_file_is_refused(tmp_path: Path, make: Callable[[Path], Any], message: str) -> None:
    make(tmp_path / "bad.npz")
    with pytest.raises(InputError, match=message) as caught:
        read_view_set(tmp_path / "bad.npz")
    assert str(tmp_path / "bad.npz") in str(caught.value)
