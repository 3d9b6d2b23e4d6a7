"""Saved renders: bit-identical when read, byte-identical when written again, and refused if changed."""

import errno
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.records import pictures
from harness.records.pictures import Render, Truth, read_renders, write_renders, write_truth
from scenes.files.errors import DamagedRecord


def noise(*shape: int, seed: int = 0, scale: float = 1.0) -> np.ndarray:
    return pictures.half(scale * np.random.default_rng(seed).standard_normal(shape))


def renders(height: int = 3, width: int = 4) -> list[Render]:
    size = (height, width)
    return [
        Render(view, step, noise(*size, 3, seed=step), noise(*size, seed=step + 1), noise(*size, seed=step + 2))
        for step in (10, 200)
        for view in ("test/r_5", "test/φ <b>")
    ]


def truths() -> list[Truth]:
    light = noise(3, 4, 3, scale=3e4)
    light[0, 0] = pictures.half(np.array([1e9, -1e9, 6e-8]))
    return [
        Truth("test/r_5", noise(3, 4, 3), noise(3, 4), light, noise(3, 4)),
        Truth("test/r_9", noise(2, 1, 3), noise(2, 1)),
    ]


def bits(picture: Render | Truth) -> list[object]:
    return [
        (value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value
        for value in vars(picture).values()
    ]


def test_pictures_come_back_bit_for_bit(tmp_path: Path) -> None:
    write_renders(tmp_path / "new" / "a.safetensors", renders())
    back = read_renders(tmp_path / "new" / "a.safetensors")
    assert list(map(bits, back)) == list(map(bits, renders()))
    write_truth(tmp_path / "b.safetensors", truths())
    assert list(map(bits, pictures.read_truth(tmp_path / "b.safetensors"))) == list(map(bits, truths()))
    assert [render.step for render in pictures.last_of(back)] == [200, 200]
    assert {file.name for file in tmp_path.rglob("*.*")} == {"a.safetensors", "b.safetensors"}, "no other file is left"


def test_light_is_clipped_to_what_float16_holds_and_nan_is_refused() -> None:
    assert pictures.half(np.array([1e9, -np.inf, 1.0])).tolist() == [65504.0, -65504.0, 1.0]
    with pytest.raises(ValueError, match="NaN"):
        pictures.half(np.array([np.nan]))


def test_equal_pictures_make_equal_bytes_and_are_not_written_again(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    write_truth(one, truths())
    write_truth(other, truths())
    assert one.read_bytes() == other.read_bytes()
    before = one.stat().st_mtime_ns, one.stat().st_ino
    write_truth(one, truths())
    assert (one.stat().st_mtime_ns, one.stat().st_ino) == before
    one.write_bytes(b"\0" * one.stat().st_size)
    write_truth(one, truths())
    assert one.read_bytes() == other.read_bytes()


def test_every_byte_that_is_changed_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    small = [Render("v", 1, noise(1, 1, 3), noise(1, 1), noise(1, 1))]
    write_renders(path, small)
    written = path.read_bytes()
    kept = refused = 0
    for place in range(len(written)):
        for flip in (1, 255):
            path.write_bytes(written[:place] + bytes([written[place] ^ flip]) + written[place + 1 :])
            try:
                (read,) = read_renders(path)
            except DamagedRecord as error:
                refused += str(path) in str(error) and "--resume" in str(error)
            else:
                kept += 1
                assert bits(read) == bits(small[0])
    assert refused > 1.9 * len(written)
    assert kept < 0.1 * len(written)


@pytest.mark.parametrize("keep", [0, 7, 8, 100, -1])
def test_a_file_that_was_cut_is_refused(keep: int, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    write_renders(path, renders())
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(DamagedRecord, match="not the pictures of a run"):
        read_renders(path)


def test_what_is_missing_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DamagedRecord, match="missing") as caught:
        read_renders(tmp_path / "none")
    assert "delete" not in str(caught.value), "there is nothing to delete"
    with pytest.raises(DamagedRecord):
        read_renders(tmp_path)
    write_truth(tmp_path / "truth", truths())
    with pytest.raises(DamagedRecord, match="truth of schema 1, not renders"):
        read_renders(tmp_path / "truth")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda tensors, listing: tensors.pop("0000.depth"), "0000.depth"),
        (lambda tensors, listing: tensors.update(more=np.zeros(1, np.float16)), "does not know"),
        (lambda tensors, listing: tensors.update({"0000.depth": np.zeros((9, 9), np.float16)}), "depth of view"),
        (lambda tensors, listing: tensors.update({"0000.depth": np.zeros((3, 4), np.float32)}), "float32"),
        (lambda tensors, listing: tensors["0000.colour"].fill(np.nan), "not finite"),
        (lambda tensors, listing: listing["pictures"][0].update(view=3), r"\[0\]\.view"),
        (lambda tensors, listing: listing["pictures"][0].pop("step"), "step"),
        (lambda tensors, listing: listing["pictures"][0].update(parts=["colour"]), "parts"),
        (lambda tensors, listing: listing["pictures"][0].update(parts=3), r"\[0\]\.parts"),
        (lambda tensors, listing: listing.update(pictures={"a": 1}), "not the pictures of a run"),
        (lambda tensors, listing: listing.update(schema=2), "of schema 2"),
        (lambda tensors, listing: listing.pop("kind"), "kind"),
    ],
)
def test_a_listing_that_does_not_fit_is_refused(change: Callable, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    write_renders(path, renders())
    listing, tensors = pictures.unsealed("pictures", path.read_bytes())
    path.write_bytes(pictures.sealed("pictures", listing, tensors))
    assert len(read_renders(path)) == 4
    change(tensors, listing)
    path.write_bytes(pictures.sealed("pictures", listing, tensors))
    with pytest.raises(DamagedRecord, match=said):
        read_renders(path)


def test_a_file_over_the_bound_is_neither_written_nor_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.safetensors"
    write_renders(path, renders())
    monkeypatch.setattr(pictures, "LARGEST_BYTES", 500)
    with pytest.raises(DamagedRecord, match="larger than 500"):
        read_renders(path)
    with pytest.raises(OSError, match="fewer views") as caught:
        write_renders(tmp_path / "b", renders())
    assert caught.value.errno == errno.EFBIG
    assert not (tmp_path / "b").exists()
