"""What a user paints, as attention."""

from pathlib import Path

import numpy as np
import pytest

from baselines.numerics.attention.regions import Regions
from harness.viewer.attended import Attention, attention_map, read_mask, spread
from scenes.files.errors import InputError
from scenes.view_sets.images import write_channels, write_png

REGIONS = Regions(12, 20, 4)


def nothing() -> np.ndarray:
    raise AssertionError("nobody asked for an error")


def test_a_mask_is_stretched_over_the_picture() -> None:
    mask = np.random.default_rng(0).random((6, 10))
    repeated = mask.repeat(2, axis=0).repeat(2, axis=1)
    np.testing.assert_allclose(spread(mask, 12, 20), repeated, atol=1e-12)
    np.testing.assert_allclose(spread(repeated, 6, 10), mask, atol=1e-12)
    found = attention_map(Attention("mask"), REGIONS, 10.0, np.zeros((12, 20, 3)), nothing, mask)
    np.testing.assert_allclose(found, repeated.reshape(3, 4, 5, 4).mean(axis=(1, 3)).reshape(-1), atol=1e-12)


def test_bright_pixels_are_read(tmp_path: Path) -> None:
    painted = np.zeros((4, 6, 4), np.float32)
    painted[..., 3] = 1.0
    painted[1, 2] = (1.0, 1.0, 1.0, 1.0)
    painted[2, 3] = (0.6, 0.0, 0.0, 1.0)
    painted[3, 3] = (1.0, 1.0, 1.0, 0.0)  # bright, and not seen
    write_png(tmp_path / "mask.png", painted)
    found = read_mask(tmp_path / "mask.png")
    assert (found[1, 2], found[2, 3]) == (1.0, pytest.approx(0.2, abs=1e-3))
    assert np.count_nonzero(found) == 2


def test_what_is_no_mask_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mask.png"
    with pytest.raises(InputError, match=r"--mask .*mask.png: this image is missing"):
        read_mask(file)
    file.write_bytes(b"not an image")
    with pytest.raises(InputError, match=r"--mask .*mask.png: not an image"):
        read_mask(file)
    write_png(file, np.zeros((2, 2, 4), np.float32))
    with pytest.raises(InputError, match="black all over"):
        read_mask(file)
    for value in (float("nan"), -1.0):
        write_channels(tmp_path / "mask.exr", {"Y": np.full((2, 2), value, np.float32)})
        with pytest.raises(InputError, match="not finite or below 0"):
            read_mask(tmp_path / "mask.exr")
