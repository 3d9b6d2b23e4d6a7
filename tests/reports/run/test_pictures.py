"""The still pictures of views next to the truth."""

import base64
import io

import matplotlib.image
import numpy as np
import pytest

from reports.data.load import read_records
from reports.data.saved_pictures import kept
from reports.drawing.images import delta_e
from reports.run.pictures import picture_data, seed_shown, views
from tests.replacing import replace
from tests.reports.fake_run import fake_records


def pixels(uri: str) -> np.ndarray:
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(uri.split(",", 1)[1])), format="png")


def test_views_of_a_run(pictured):
    shown = views(read_records(pictured))
    assert [(view.scene, view.view, view.seed) for view in shown] == [("chair", "r_12", 0), ("drums", "r_12", 0)]
    assert [method.method for method in shown[0].methods] == ["nerf", "nerf_matched", "qnerf"]
    assert "mean ΔE₀₀" in shown[0].methods[0].caption
    assert delta_e(np.zeros((2, 3, 3)), np.ones((2, 3, 3))) == pytest.approx(np.full((2, 3), 100.0), abs=0.01)
    found = kept(read_records(pictured), "chair")
    assert pixels(shown[0].truth)[..., :3] == pytest.approx(found.truth["r_12"].display.astype(float), abs=0.6 / 255)
    last = found.renders["nerf", 0][-2]
    assert (last.view, last.step) == ("r_12", 1600)
    assert pixels(shown[0].methods[0].render)[..., :3] == pytest.approx(last.colour.clip(0, 1), abs=0.6 / 255)


def test_a_diverged_method_has_its_reason_in_place_of_a_picture(tmp_path):
    (shown,) = views(fake_records(tmp_path / "run", scenes=("chair",), seeds=1, pictures=True, with_diverged=True))
    lost = shown.methods[2]
    assert (lost.render, lost.failed, lost.caption) == (None, True, "not finite at step 412: density_head.weight")


@pytest.mark.parametrize("path", ["../../secret.safetensors", "/etc/passwd", "pictures"])
def test_pictures_outside_of_the_records_are_not_read(tmp_path, path):
    records = fake_records(tmp_path / "run", scenes=("chair",), seeds=1, pictures=True)
    (records.folder / "pictures/chair.nerf.0.safetensors").rename(tmp_path / "secret.safetensors")
    found = kept(replace(records, cells=[replace(cell, pictures=path) for cell in records.cells]), "chair")
    assert found.renders == {}
    assert set(found.missing) == {(method, 0) for method in records.methods}


def test_a_run_without_pictures_has_no_views(records):
    assert views(records) == []
    assert picture_data(records) is None
    assert seed_shown(records, "chair") is None
