"""`python -m scenes repeats`: independent renders of one view."""

from pathlib import Path

import numpy as np
import pytest

from scenes.__main__ import main


def test_renders_are_independent_and_a_stream_gives_the_same_again(tmp_path: Path) -> None:
    def renders(folder: str, stream: str) -> np.ndarray:
        (tmp_path / folder).mkdir()
        sizes = ["--resolution", "12", "--spp", "4", "--count", "3", "--variant", "scalar_rgb"]
        assert main(["repeats", str(tmp_path / folder), "materials", "--stream", stream, *sizes]) == 0
        result: np.ndarray = np.load(tmp_path / folder / "materials.npy")
        return result

    first, again, other = renders("a", "gate"), renders("b", "gate"), renders("c", "renewal")
    assert first.shape == (3, 12, 12, 4)
    assert np.array_equal(first, again)
    assert not np.array_equal(first[0], first[1])
    assert not any(np.array_equal(one, two) for one in first for two in other)
    assert first.mean() == pytest.approx(other.mean(), rel=0.1)
