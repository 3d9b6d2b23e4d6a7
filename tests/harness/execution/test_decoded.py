"""Images of the user are decoded once a run, and nothing of that is left behind."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenes.view_sets import view_set
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.images import write_png
from scenes.view_sets.source import Source
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball
from tests.harness.trained_runs import train_run


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """The number of times that each image is decoded."""
    times: Counter[str] = Counter()

    def counted(folder: Path) -> Source:
        source = source_of(folder)

        def pixels(file: Path, width: int | None) -> np.ndarray:
            times[str(file)] += 1
            return source.pixels(file, width)

        return replace(source, pixels=pixels)

    monkeypatch.setattr(view_set, "source_of", counted)
    return times


def test_a_run_decodes_each_image_once(tmp_path: Path, decoded: Counter[str]) -> None:
    out = train_run(tmp_path, ["nerf"], steps=2)
    assert (len(decoded), set(decoded.values())) == (8, {1})
    assert [file.name for file in out.iterdir() if file.name.startswith(".scratch")] == []


def test_an_image_that_changed_is_decoded_again(tmp_path: Path, decoded: Counter[str]) -> None:
    ball, kept = write_ball(tmp_path / "ball", size=16, train=3, test=1), tmp_path / "kept"
    kept.mkdir()
    first = read_view_set(ball, 8, decoded=kept)
    again = read_view_set(ball, 8, decoded=kept)
    assert first.content == again.content
    before = decoded.total()
    write_png(ball / "train" / "r_0.png", np.zeros((16, 16, 4), dtype=np.float32))
    changed = read_view_set(ball, 8, decoded=kept)
    assert decoded.total() == before + 1
    assert changed.content != first.content
    assert not changed.train.rgba[0].any()
    assert read_view_set(ball, 8, decoded=tmp_path / "none").content == changed.content, "a node without the folder"
