"""The Python API: the examples of docs/api.md run, and each function agrees with its command."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import radiance_verdict as rv
from harness.verdicts.judging.judgement import judge
from harness.verdicts.tables.result_table import read_table
from scenes.files.digest import file_digest
from scenes.view_sets.images import write_png
from tests.harness.ball import write_ball
from tests.harness.shell import ROOT

TABLE = ROOT / "docs" / "examples" / "own-seeds.csv"


@pytest.fixture
def images(tmp_path: Path) -> Path:
    return write_ball(tmp_path / "my_images")


def test_the_examples_run(images: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(images.parent)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "api.md").read_text(encoding="utf-8"), re.S):
        exec(block, names)
    assert (images.parent / "out" / "mine" / "judgement.html").is_file()
    judged = rv.judge([{**row, "seed": 0} for row in _rows()], baseline="nerf")
    assert judged.given.pairs[0].difference == pytest.approx(0.9)


def _rows() -> list[dict[str, object]]:
    scores = {"mine": (31.9, 27.2, 33.8), "nerf": (31.0, 26.1, 33.1)}
    return [{"scene": i, "method": name, "psnr": psnr} for name, all_ in scores.items() for i, psnr in enumerate(all_)]


def test_a_file_its_rows_and_its_data_frame_are_judged_alike() -> None:
    frame = pd.read_csv(TABLE)
    expected = judge(read_table([TABLE]), None, "nerf")
    for table in (TABLE, [str(TABLE)], frame, frame.set_index(["scene", "method"]), frame.to_dict("records")):
        assert rv.judge(table, baseline="nerf").given == expected.given
    wide = rv.judge(frame.pivot_table("psnr", "method", "scene"), metric="psnr", baseline="nerf").given
    means = {place.method: place.mean for place in expected.given.places}
    assert {place.method: place.mean for place in wide.places} == pytest.approx(means)
    assert rv.judge(TABLE, baseline="nerf").digests == {str(TABLE): file_digest(TABLE)}


def test_a_missing_value_of_a_data_frame_is_a_missing_result_and_nan_in_a_row_is_refused() -> None:
    frame = pd.DataFrame(_rows())
    frame.loc[4, "psnr"] = math.nan
    assert rv.judge(frame).missing == ["nerf, 1"]
    with pytest.raises(rv.InputError, match="the given table, row 5: psnr is nan"):
        rv.judge(frame.to_dict("records"))


def test_arrays_are_scored_as_the_same_pictures_in_files(images: Path, tmp_path: Path) -> None:
    truth = rv.view_set(images).test.rgba
    pictures = [np.round(255 * 0.9 * image).astype(np.uint8) for image in truth]
    (tmp_path / "renders").mkdir()
    for view, picture in enumerate(pictures):
        write_png(tmp_path / "renders" / f"r_{view}.png", picture / np.float32(255))
    of_files = rv.score(tmp_path / "renders", images, "mine")
    for arrays in (pictures, np.stack(pictures), [picture / np.float32(255) for picture in pictures]):
        scores = rv.score(arrays, images, "mine")
        for name in ("psnr", "ssim", "flip", "delta_e"):
            assert getattr(scores, name) == pytest.approx(getattr(of_files, name), rel=1e-5)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda pictures: pictures[:-1], r"test views are \(3, 24, 24\) .*, the pictures \(2, 24, 24\)"),
        (lambda pictures: 255.0 * pictures, "picture 0: has values from 0 to 24.; give uint8, or floats from 0 to 1"),
        (lambda pictures: pictures * np.nan, "picture 0: has values from nan to nan"),
        (lambda pictures: pictures[..., 0], r"pictures of shape \(24, 24\)"),
        (lambda pictures: [], r"pictures of shape \(\)"),
        (lambda pictures: [*pictures[:2], pictures[2, :-1]], r"picture 2: has the shape \(23, 24, 3\)"),
    ],
)
def test_arrays_that_are_no_pictures_of_the_views_are_refused(spoil, words: str, images: Path) -> None:
    pictures = np.stack([image[..., :3] for image in rv.view_set(images).test.rgba])
    with pytest.raises(rv.InputError, match=words):
        rv.score(spoil(pictures), images, "mine", as_they_are=True)


def test_a_recorded_row_replaces_that_of_its_cell_and_the_table_is_judged(tmp_path: Path) -> None:
    table = tmp_path / "results.json"
    for method, lead in (("mine", 1.0), ("nerf", 0.0)):
        for scene in ("lego", "drums"):
            for seed in (0, 1):
                rv.record(table, scene=scene, method=method, seed=seed, psnr=30.0 + lead + 0.1 * seed)
    before = table.read_text()
    rv.record(table, scene="drums", method="nerf", seed=1, psnr=30.1)
    assert table.read_text() == before
    rv.record(table, scene="drums", method="nerf", seed=1, psnr=None)
    judged = rv.judge(table, baseline="nerf")
    assert (judged.given.pairs[0].difference, judged.results) == (pytest.approx(1.0, abs=0.06), 7)
    with pytest.raises(rv.InputError, match="psnr of lego, mine, seed 0, is nan; give None"):
        rv.record(table, scene="lego", method="mine", psnr=math.nan)
    (tmp_path / "other.json").write_text('{"a": 1}')
    with pytest.raises(rv.InputError, match=r"other\.json: is not a list of rows; name another file"):
        rv.record(tmp_path / "other.json", scene="lego", method="mine", psnr=30.0)
