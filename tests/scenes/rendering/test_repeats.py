"""`python -m scenes repeats`: independent renders of one view."""

from pathlib import Path

import numpy as np
import pytest

from scenes.__main__ import main


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("teapot", "unknown scene 'teapot'"),
        ("materials --view 200", "view 200: choose 0 to 199"),
        ("materials --count 0", "count 0: must lie between 1 and"),
        ("materials --spp 0", "spp 0"),
        ("materials --resolution 0", "resolution 0"),
    ],
)
def test_bad_input_is_one_line(options: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["repeats", str(tmp_path), *options.split(), "--variant", "scalar_rgb"]) == 2
    complaint = capsys.readouterr().err
    assert said in complaint
    assert complaint.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_renders_are_independent_and_a_stream_gives_the_same_again(tmp_path: Path) -> None:
    def renders(folder: str, stream: str) -> np.ndarray:
        (tmp_path / folder).mkdir()
        sizes = ["--resolution", "12", "--spp", "4", "--count", "3", "--variant", "scalar_rgb"]
        assert main(["repeats", str(tmp_path / folder), "materials", "--stream", stream, *sizes]) == 0
        found: np.ndarray = np.load(tmp_path / folder / "materials.npy")
        return found

    first, again, other = renders("a", "gate"), renders("b", "gate"), renders("c", "renewal")
    assert first.shape == (3, 12, 12, 4)
    assert np.array_equal(first, again)
    assert not np.array_equal(first[0], first[1])
    assert not any(np.array_equal(one, two) for one in first for two in other)
    assert first.mean() == pytest.approx(other.mean(), rel=0.1)
