"""Pictures of others: found, matched, read as they are meant, and scored as closed forms say."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.command.main import main
from harness.records.scored_pictures import read_scores
from harness.training.scoring.misread import likely_mistake
from harness.training.scoring.others import score_pictures
from harness.verdicts.tables.result_table import read_table
from scenes.files.errors import InputError
from scenes.view_sets.formats.rendered_pictures import of_views, pictures_in
from scenes.view_sets.images import write_png
from scenes.view_sets.pixels import decode_srgb, over_white
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball
from tests.harness.shell import refused

VIEWS = 11
OFFSET = 10 / 255
"""The offset of every channel: 20 log10(255 / 10) = 28.13 dB where nothing is clipped."""


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball") / "ball", train=3, test=VIEWS)


@pytest.fixture(scope="module")
def truths(ball: Path) -> list[np.ndarray]:
    return list(read_view_set(ball, splits=("test",)).test.rgba)


def darker(truth: np.ndarray) -> np.ndarray:
    """Over white, the ball's own colours are at least 0.025: the offset stays within what a PNG holds."""
    return np.maximum(over_white(truth) - OFFSET, 0.0)


def write(folder: Path, pictures: list[np.ndarray], name: str = "r_{}.png") -> Path:
    folder.mkdir(parents=True)
    for number, picture in enumerate(pictures):
        write_png(folder / name.format(number), picture)
    return folder


@pytest.mark.parametrize(
    ("inside", "name"),
    [
        ("", "r_{}.png"),  # instant-ngp
        ("test/ours_30000/renders", "{:05d}.png"),  # 3D Gaussian Splatting
        ("test/rgb", "r_{}.tif"),  # nerfstudio
        ("color", "r_{}.png"),  # nerfbaselines
        ("testset_200000", "{:03d}.png"),  # NeRF's own code
        ("", "eval_img_{}.png"),  # not padded: 10 comes after 9
    ],
)
def test_folders_of_each_program(tmp_path: Path, ball: Path, truths: list[np.ndarray], inside: str, name: str) -> None:
    write(tmp_path / "own" / inside, [darker(truth) for truth in truths], name)
    for other in ("test/ours_30000/gt", "train/ours_30000/renders", "gt-rgb"):
        if inside:
            write(tmp_path / "own" / other, [over_white(truth) for truth in truths], name)
    row = score_pictures(tmp_path / "own", ball, "theirs")
    errors = [np.mean((np.round(darker(t) * 255) / 255 - over_white(t)) ** 2) for t in truths]
    assert row.psnr == pytest.approx(float(np.mean(-10 * np.log10(errors))), abs=1e-4)
    assert row.psnr == pytest.approx(-20 * np.log10(OFFSET), abs=0.05)
    assert [view.view for view in row.views] == [f"test/r_{number}" for number in range(VIEWS)]
    assert row.scene == "ball"
    assert row.depth_rmse is None
    assert row.opacity_iou is None


def test_a_straight_alpha_is_put_over_white_and_large_pictures_are_averaged(
    tmp_path: Path, ball: Path, truths: list[np.ndarray]
) -> None:
    twice = [np.repeat(np.repeat(truth, 2, axis=0), 2, axis=1) for truth in truths]
    row = score_pictures(write(tmp_path / "large", twice), ball, "theirs", resolution=24, as_they_are=True)
    assert row.psnr > 50.0  # alpha and colour are rounded to 8 bits, and over white once more


@pytest.mark.parametrize("opaque_first", [False, True])
def test_a_picture_without_alpha_among_those_with_it_is_over_white_already(
    tmp_path: Path, ball: Path, truths: list[np.ndarray], opaque_first: bool
) -> None:
    pictures = [np.dstack((0.9 * truth[..., :3], truth[..., 3:])) for truth in truths]
    mixed = [over_white(one) if (number % 2 == 0) == opaque_first else one for number, one in enumerate(pictures)]
    expected = score_pictures(write(tmp_path / "all", pictures), ball, "theirs", as_they_are=True)
    row = score_pictures(write(tmp_path / "mixed", mixed), ball, "theirs")
    assert row.psnr == pytest.approx(expected.psnr, abs=0.05)  # other colours are rounded to 8 bits


MISTAKES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "rendered over black": lambda truth: truth[..., :3] * truth[..., 3:],
    "premultiplied": lambda truth: np.concatenate([truth[..., :3] * truth[..., 3:], truth[..., 3:]], axis=-1),
    "linear light": lambda truth: decode_srgb(over_white(truth)),
    "blue, green, red": lambda truth: over_white(truth)[..., ::-1],
    "upside down": lambda truth: over_white(truth)[::-1],
    "mirrored": lambda truth: over_white(truth)[:, ::-1],
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_usual_mistake_is_said_not_scored(tmp_path: Path, ball: Path, truths: list[np.ndarray], mistake: str) -> None:
    folder = write(tmp_path / "theirs", [MISTAKES[mistake](truth) for truth in truths])
    with pytest.raises(InputError, match=f"seem to be {mistake}.*--as-they-are"):
        score_pictures(folder, ball, "theirs")
    row = score_pictures(folder, ball, "theirs", as_they_are=True)
    assert row.psnr < 31.0
    assert row.made["as_they_are"]


def test_one_odd_view_and_copies_of_the_truth_are_named(truths: list[np.ndarray]) -> None:
    pictures = [darker(truth) for truth in truths]
    assert likely_mistake(pictures, truths) is None
    pictures[1] = darker(truths[1])[::-1]
    said = likely_mistake(pictures, truths) or ""
    assert said.startswith(f"of 1 of {VIEWS} views, such as view 1, seem to be upside down")
    copies = [np.round(over_white(truth) * 255) / 255 for truth in truths]
    assert "copies of the truth" in (likely_mistake(copies, truths) or "")


@pytest.mark.parametrize("turn", [1, 5])
def test_another_order_is_named(truths: list[np.ndarray], turn: int) -> None:
    moved = [over_white(truths[(view + turn) % VIEWS]) for view in range(VIEWS)]
    said = likely_mistake(moved, truths)
    assert said is not None
    assert f"view 0 shows view {turn}" in said


@pytest.mark.parametrize(
    "picture",
    [
        lambda white: np.full_like(white, 0.5),
        np.ones_like,
        lambda white: white * 0.6 + 0.4,  # a density that is too thin
        lambda white: np.clip(white + np.random.default_rng(1).normal(0.0, 0.2, white.shape), 0.0, 1.0),
    ],
    ids=["grey", "nothing", "faint", "noise"],
)
def test_a_bad_method_is_not_taken_for_a_mistake(truths: list[np.ndarray], picture: Callable[..., np.ndarray]) -> None:
    assert likely_mistake([picture(over_white(truth)) for truth in truths], truths) is None


def test_pictures_that_do_not_fit_are_refused(tmp_path: Path, ball: Path, truths: list[np.ndarray]) -> None:
    pictures = [darker(truth) for truth in truths]
    good = write(tmp_path / "good", pictures)

    def broken(change: Callable[[Path], object]) -> Path:
        folder = tmp_path / "broken"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(good, folder)
        change(folder)
        return folder

    for change, said in (
        (lambda folder: (folder / "r_3.png").unlink(), "10 pictures for 11 test views, and none is called r_3"),
        (lambda folder: write_png(folder / "r_3.png", pictures[3][:-2]), "r_3.png: 24 × 22 pixels"),
        (lambda folder: write_png(folder / "r_3.png", pictures[3][:, :-1]), "r_3.png: 23 pixels wide"),
        (lambda folder: (folder / "r_3.png").write_bytes(b"no"), "r_3.png: not an image"),
        (lambda folder: shutil.copy(folder / "r_3.png", folder / "r_3.tif"), "two pictures called r_3"),
        (lambda folder: write_png(folder / "r_3.png", pictures[3][..., :2]), "r_3.png: has 2 channels"),
    ):
        with pytest.raises(InputError, match=said):
            score_pictures(broken(change), ball, "theirs")
    two = tmp_path / "two"
    for step in ("ours_7000", "ours_30000"):
        write(two / "test" / step / "renders", pictures[:1])
    with pytest.raises(InputError, match="test/ours_30000/renders, test/ours_7000/renders; name one folder"):
        pictures_in(two)


def test_views_of_one_name_are_not_confused() -> None:
    files = [Path(f"r_{number}.png") for number in range(2)]
    with pytest.raises(InputError, match="names repeat, such as r_0"):
        of_views(files, ["left/r_0", "right/r_0"])


def test_the_command_keeps_a_table_that_judge_reads(
    tmp_path: Path, ball: Path, truths: list[np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, table = write(tmp_path / "theirs", [darker(truth) for truth in truths]), tmp_path / "scores.json"
    for method, scene, seconds in (("a", "ball", "5"), ("a", "b", "6"), ("b", "ball", "7"), ("b", "b", "8")):
        call = [
            *("score", str(folder), "--view-set", str(ball), "--method", method, "--scene", scene),
            *("--seconds", seconds, "--to", str(table)),
        ]
        assert main(call) == 0
    assert main(call) == 0  # once more: in place of what was there
    assert "PSNR 28.1" in capsys.readouterr().out
    assert len(read_scores(table).cells) == 4
    read = read_table([table])
    assert (read.metric, read.methods, read.scenes) == ("psnr", ["a", "b"], ["ball", "b"])
    assert read.seconds == [5.5, 7.5]
    wrong = [folder, "--view-set", ball, "--method"]
    assert "--method ''" in refused(capsys, *wrong, "", command="score")
    table.write_text(json.dumps({"cells": 1}))
    assert "scores.json" in refused(capsys, *wrong, "a", "--to", table, command="score")
