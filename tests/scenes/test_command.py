"""`python -m scenes`."""

from pathlib import Path

import numpy as np
import pytest

from scenes.__main__ import main


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["render", "lego", "--train", "1000"], "1000 train views"),
        (["sheet", "/no/such/folder/x.png"], "x.png"),
        (["repeats", ".", "teapot"], "unknown scene 'teapot'"),
        (["repeats", ".", "materials", "--view", "200"], "view 200: choose 0 to 199"),
        (["repeats", ".", "materials", "--count", "0"], "count 0: must lie between 1 and"),
        (["repeats", ".", "materials", "--spp", "0"], "spp 0"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["render"], ["render", "lego", "--scene-file", "mine.py"]])
def test_render_takes_names_or_a_file(arguments: list[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(arguments)


def test_ctrl_c_is_one_line_and_exit_code_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scenes.__main__._render", stopped)
    assert main(["render", "lego"]) == 130
    assert capsys.readouterr().err == "scenes: interrupted; give the command again\n"


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
