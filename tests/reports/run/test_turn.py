"""The turn around a scene: its strips, their size, and the slider."""

import base64
import io

import matplotlib.image
import numpy as np
import pytest

from harness.records.pictures import Turn, read_renders, read_turn, write_renders
from reports.data.load import read_records
from reports.run import turn
from reports.run.run_page import write_page
from reports.run.turn import rounds
from tests.reports.browsing import opened, until
from tests.reports.fake_run import write_fake_run


def pixels(uri: str) -> np.ndarray:
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(uri.split(",", 1)[1])), format="jpeg")


@pytest.fixture
def out(tmp_path):
    return write_fake_run(tmp_path / "run", ("chair",), seeds=1, with_diverged=False)


def test_the_truth_comes_first_and_each_strip_holds_all_views(out):
    (shown,) = rounds(read_records(out))
    assert (shown.scene, shown.views) == ("chair", 2)
    assert [strip.method for strip in shown.strips] == [None, "nerf", "nerf_matched", "qnerf"]
    saved = read_turn(out / "records" / "pictures" / "chair.nerf.0.safetensors", "renders")
    drawn = pixels(shown.strips[1].image)
    assert drawn.shape == np.concatenate(saved.frames, axis=1).shape
    assert np.abs(drawn.astype(float) - np.concatenate(saved.frames, axis=1)).mean() < 8


def test_a_method_of_other_views_or_with_a_damaged_file_is_left_out(out):
    folder = out / "records" / "pictures"
    (folder / "chair.nerf.0.safetensors").write_bytes(b"no pictures")
    other = folder / "chair.qnerf.0.safetensors"
    write_renders(other, read_renders(other), Turn(["a", "b"], np.zeros((2, 4, 4, 3), dtype=np.uint8)))
    (shown,) = rounds(read_records(out))
    assert [strip.method for strip in shown.strips] == [None, "nerf_matched"]
    assert shown.missing == ["nerf", "qnerf"]
    (folder / "chair.safetensors").unlink()
    assert rounds(read_records(out)) == []


def test_a_large_run_has_small_pictures(out, monkeypatch):
    monkeypatch.setattr(turn, "BUDGET_BYTES", 1)
    monkeypatch.setattr(turn, "SIDES", (100, 8))
    (shown,) = rounds(read_records(out))
    assert max(pixels(shown.strips[0].image).shape[:2]) <= 16


TURNED = """[...document.querySelectorAll('#turn .frame')].every(frame => {{
    const [strip, seen] = [frame.firstElementChild, frame].map(node => node.getBoundingClientRect());
    return seen.width > 50 && Math.abs(seen.left - strip.left - {} * seen.width) < 1;
}})"""
"""Whether all frames show this view."""


@pytest.mark.slow
def test_one_slider_turns_all_strips_and_the_address_holds_the_place(browser, tmp_path):
    file = tmp_path / "report.html"
    write_page(read_records(write_fake_run(tmp_path / "run", seeds=1, with_diverged=False)), file)
    # an address with a hash would be reported as a request
    view, noise = opened(browser, file.as_uri(), viewport={"width": 1280, "height": 900})
    view.evaluate("location.hash = 'at=pictures&turn.view=1'")
    view.evaluate("document.querySelector('#turn').closest('details').open = true")
    until(view, TURNED.format(1))
    view.locator("#turn input").fill("0")
    until(view, TURNED.format(0))
    until(view, "!location.hash.includes('turn.view')")
    view.locator("#turn button").click()
    until(view, TURNED.format(1))
    assert [line for line in noise if not line.startswith("blob:")] == []
