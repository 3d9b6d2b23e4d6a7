"""A run is resumed only with the view set that its finished cells were trained on."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.records.cells import write_cell
from harness.records.pictures import read_truth
from harness.training.cell_training import finished_on, view_set_facts
from harness.training.saved_renders import drop_truth, keep_truth
from scenes.files.errors import InputError
from scenes.view_sets.images import read_image, write_png
from scenes.view_sets.view_set import ViewSet, read_view_set
from tests.harness.cells import diverged
from tests.replacing import replace

KEY = ("ball", "nerf", 0)


@pytest.fixture
def own(ball_folder: Path, tmp_path: Path) -> Path:
    """A user's folder that may be changed."""
    return Path(shutil.copytree(ball_folder, tmp_path / "own"))


def one_pixel(folder: Path) -> None:
    image = read_image(folder / "train/r_3.png")
    image[0, 0] = 1.0 - image[0, 0]
    write_png(folder / "train/r_3.png", image)


def swapped(folder: Path) -> None:
    first, second = (folder / f"train/r_{number}.png" for number in (0, 1))
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)


def a_camera(folder: Path) -> None:
    file = folder / "transforms_test.json"
    x = repr(float(read_view_set(folder).test.camera_to_world[0, 0, 3]))
    assert x in file.read_text()
    file.write_text(file.read_text().replace(x, repr(float(x) + 1e-3)))


@pytest.mark.parametrize("change", [one_pixel, swapped, a_camera])
def test_a_changed_folder_has_another_content(own: Path, change: Callable[[Path], None]) -> None:
    before = read_view_set(own).content
    assert before is not None
    assert read_view_set(own).content == before
    (own / "notes.txt").write_text("not of the view set")
    assert read_view_set(own).content == before
    change(own)
    assert read_view_set(own).content != before


def finished(out: Path, views: ViewSet, **settings: object) -> int:
    """Record a cell, and count those that count as finished on these views."""
    write_cell(out, replace(diverged(*KEY), settings=settings))
    return finished_on(out, [KEY], views)


def test_a_folder_may_be_moved_and_last_bits_may_differ(ball: ViewSet, tmp_path: Path) -> None:
    assert finished_on(tmp_path, [KEY], ball) == 0
    moved = replace(ball, path=tmp_path / "elsewhere", bounds=np.nextafter(ball.bounds, 9.0))
    assert finished(tmp_path, moved, view_set=view_set_facts(ball)) == 1


def test_what_an_earlier_version_did_not_record_is_no_difference(ball: ViewSet, tmp_path: Path) -> None:
    known = {name: value for name, value in view_set_facts(ball).items() if name not in ("content", "near", "far")}
    assert finished(tmp_path, ball, view_set=known) == finished(tmp_path, ball) == 1


@pytest.mark.parametrize(
    ("recorded", "said"),
    [
        (
            {"content": lambda digest: digest[::-1]},
            r"ball: not the view set that ball\.nerf\.0 .*\(content was .*…, is",
        ),
        ({"width": lambda width: width // 2, "focal": lambda focal: focal / 2}, r"\(width was 12, is 24; focal was"),
        ({"far": lambda far: far * (1 + 1.1e-6)}, r"\(far was"),
        ({"width": str}, r"\(width was"),
    ],
)
def test_a_cell_of_other_views_is_refused_by_what_differs(
    ball: ViewSet, tmp_path: Path, recorded: dict[str, Callable[[Any], object]], said: str
) -> None:
    facts = view_set_facts(ball)
    facts |= {name: change(facts[name]) for name, change in recorded.items()}
    with pytest.raises(InputError, match=said):
        finished(tmp_path, ball, view_set=facts)


def test_a_sound_truth_is_never_replaced_by_that_of_other_views(own: Path, tmp_path: Path) -> None:
    file = tmp_path / "records/pictures/ball.safetensors"
    keep_truth(tmp_path, "ball", read_view_set(own), 1)
    before = file.read_bytes()
    keep_truth(tmp_path, "ball", read_view_set(own), 1)
    write_png(own / "test/r_1.png", np.ones((24, 24, 4)))
    with pytest.raises(InputError, match=r"own: not the views of .*ball\.safetensors; restore"):
        keep_truth(tmp_path, "ball", read_view_set(own), 1)
    assert file.read_bytes() == before
    file.write_bytes(before[:-1])
    keep_truth(tmp_path, "ball", read_view_set(own), 1)
    assert read_truth(file)[0].display.min() == 1.0, "a damaged one is"
    drop_truth(tmp_path, "ball")
    assert not file.exists()
