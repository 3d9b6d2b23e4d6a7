"""Views beside the truth, as print shows them."""

import base64
import io

import matplotlib.image
import numpy as np
import pytest
from msgspec.structs import replace

from reports.data.kept_pictures import kept
from reports.data.load import read_records
from reports.drawing.images import delta_e
from reports.run.pictures import seed_shown, views
from tests.reports.fake_run import write_fake_run

BLACK, WHITE = np.zeros((2, 3, 3)), np.ones((2, 3, 3))


def pixels(uri: str) -> np.ndarray:
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(uri.split(",", 1)[1])), format="png")


def test_black_to_white_is_a_hundred_in_ciede2000():
    assert delta_e(BLACK, WHITE) == pytest.approx(np.full((2, 3), 100.0), abs=0.01)


def test_views_of_a_run(pictured):
    shown = views(read_records(pictured))
    assert [(view.scene, view.view, view.seed) for view in shown] == [("chair", "r_12", 0), ("drums", "r_12", 0)]
    assert [one.method for one in shown[0].methods] == ["nerf", "nerf_matched", "qnerf"]
    assert "mean ΔE₀₀" in shown[0].methods[0].caption
    found = kept(read_records(pictured), "chair")
    assert pixels(shown[0].truth)[..., :3] == pytest.approx(found.truth["r_12"].display.astype(float), abs=0.6 / 255)
    last = found.renders["nerf", 0][-2]
    assert (last.view, last.step) == ("r_12", 1600)
    assert pixels(shown[0].methods[0].render)[..., :3] == pytest.approx(last.colour.clip(0, 1), abs=0.6 / 255)


def test_a_diverged_method_says_so_where_its_picture_would_be(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1)
    lost = views(read_records(out))[0].methods[2]
    assert (lost.render, lost.failed, lost.caption) == (None, True, "not finite at step 412: density_head.weight")


def test_missing_and_broken_pictures_are_no_error(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), with_diverged=False)
    folder = out / "records" / "pictures"
    (folder / "chair.nerf.0.safetensors").unlink()
    (folder / "chair.qnerf.0.safetensors").write_bytes(b"no pictures")
    (first,) = views(read_records(out))
    assert [one.render is None for one in first.methods] == [True, False, True]
    assert first.methods[0].caption.endswith("chair.nerf.0.safetensors: missing")
    assert "not the pictures of a run" in first.methods[2].caption
    (folder / "chair.safetensors").unlink()
    (again,) = views(read_records(out))
    assert again.truth is None
    assert again.methods[1].caption == "no ground truth of this size"


@pytest.mark.parametrize("path", ["../../secret.safetensors", "/etc/passwd", "pictures"])
def test_pictures_outside_of_the_records_are_not_read(tmp_path, path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, with_diverged=False)
    records = read_records(out)
    (out / "records/pictures/chair.nerf.0.safetensors").rename(tmp_path / "secret.safetensors")
    records.cells[:] = [replace(cell, pictures=path) for cell in records.cells]
    found = kept(records, "chair")
    assert found.renders == {}
    assert set(found.missing) == {(method, 0) for method in records.methods}


def test_a_run_without_pictures_has_no_views(records):
    assert views(records) == []
    assert seed_shown(records, "chair") is None
