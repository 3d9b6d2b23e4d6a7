"""One picture as one EXR file and back."""

import os
from pathlib import Path

import numpy as np
import pytest

from harness.playback.float_exr import Damaged, channel_names, digest_of, frozen, over_bytes, read_exr, write_exr
from scenes.view_sets.images import read_channels, read_image
from tests.harness.playback.drawn import drawn, same_bits


@pytest.mark.parametrize("shape", [(1, 1, 1), (5, 7, 5), (3, 2, 2), (100, 100, 5), (7, 600, 3), (2, 3, 4), (4, 5, 64)])
def test_a_picture_comes_back_bit_for_bit(tmp_path: Path, shape: tuple[int, int, int]) -> None:
    picture = drawn(1, *shape)
    write_exr(tmp_path / "a.exr", picture)
    found = read_exr(tmp_path / "a.exr")
    assert same_bits(found, picture)
    assert not found.flags.writeable


def test_any_other_reader_finds_the_same_picture(tmp_path: Path) -> None:
    picture = drawn(2)
    write_exr(tmp_path / "a.exr", picture)
    assert same_bits(read_image(tmp_path / "a.exr"), picture)
    assert sorted(read_channels(tmp_path / "a.exr")) == sorted("RGBAZ")


def test_a_file_that_claims_more_pixels_than_it_has_is_refused_unread(tmp_path: Path) -> None:
    import OpenImageIO as oiio

    for width, height, written in ((30000, 2000, False), (500, 500, True)):
        file = tmp_path / f"{width}.exr"
        spec = oiio.ImageSpec(width, height, 5, oiio.FLOAT)
        spec.attribute("compression", "zip")
        spec.channelnames = channel_names(5)
        target = oiio.ImageOutput.create(str(file))
        assert target.open(str(file), spec)
        if written:  # a whole file: nothing but its compression is wrong
            target.write_image(np.zeros((height, width, 5), dtype=np.float32))
        target.close()
        assert file.stat().st_size < 4 * width * height * 5
        with pytest.raises(Damaged, match=r"\(500, 500, 5\) in [0-9]+ bytes" if written else "header claims"):
            read_exr(file)


@pytest.mark.parametrize("tile", [(2**30, 5), (7, 2**28), (1, 1)])
def test_tiles_of_another_size_are_refused_before_memory_is_taken(tmp_path: Path, tile: tuple[int, int]) -> None:
    write_exr(tmp_path / "a.exr", drawn(1))
    data = (tmp_path / "a.exr").read_bytes()
    here = data.index(b"tiledesc") + len(b"tiledesc") + 5
    assert np.frombuffer(data[here : here + 8], dtype="<u4").tolist() == [7, 5]
    (tmp_path / "a.exr").write_bytes(data[:here] + np.array(tile, dtype="<u4").tobytes() + data[here + 8 :])
    with pytest.raises(Damaged):
        read_exr(tmp_path / "a.exr")


def test_what_is_no_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.exr")
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "link.exr").symlink_to(tmp_path / "pipe.exr")
    (tmp_path / "text.exr").write_text("no picture")
    (tmp_path / "empty.exr").touch()
    for name in ("pipe", "folder", "link", "text", "empty"):
        with pytest.raises(Damaged):
            read_exr(tmp_path / f"{name}.exr")
    with pytest.raises(FileNotFoundError):
        read_exr(tmp_path / "none.exr")


def test_a_frozen_picture_cannot_be_written_by_anybody() -> None:
    picture = drawn(3)
    kept = frozen(picture)
    picture[:] = 0.0
    assert same_bits(kept, drawn(3))
    with pytest.raises(ValueError, match="read-only"):
        kept[0, 0, 0] = 1.0
    view: object = kept[..., :3]
    while isinstance(view, np.ndarray):
        with pytest.raises(ValueError, match="WRITEABLE"):
            view.setflags(write=True)
        view = view.base
    assert isinstance(view, bytes)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_picture_that_is_not_finite_is_none(bad: float) -> None:
    picture = drawn(4)
    picture[2, 3, 1] = bad
    with pytest.raises(ValueError, match="1 of 175 values of a picture are not finite"):
        frozen(picture)


def test_the_digest_is_of_bits_and_shape() -> None:
    zero = np.zeros((2, 3, 1), dtype=np.float32)
    minus = zero.copy()
    minus[0, 0, 0] = -0.0
    digests = {digest_of(one) for one in (zero, minus, zero.reshape(3, 2, 1), zero.reshape(1, 2, 3))}
    assert len(digests) == 4
    assert digest_of(over_bytes(zero.tobytes(), zero.shape)) == digest_of(zero)
