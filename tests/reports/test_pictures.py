"""Views beside the truth, and maps of the error."""

import base64
import io

import matplotlib.image
import numpy as np
import pytest

from reports.error_maps import absolute_error, delta_e, delta_e_map, smaller
from reports.load import read_records
from reports.pictures import data_uri, read, seed_shown, side_for, views
from tests.reports.fake_run import write_fake_run

BLACK, WHITE = np.zeros((2, 3, 3)), np.ones((2, 3, 3))


def pixels(uri: str) -> np.ndarray:
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(uri.split(",", 1)[1])), format="png")


def test_equal_pictures_have_no_error():
    assert absolute_error(WHITE, WHITE).max() == 0
    assert delta_e(WHITE, WHITE).max() == pytest.approx(0, abs=1e-9)


def test_absolute_error_is_amplified_and_clipped():
    assert absolute_error(BLACK, BLACK + 0.1) == pytest.approx(BLACK + 0.4)
    assert absolute_error(BLACK, WHITE).max() == 1


def test_black_to_white_is_a_hundred_in_ciede2000():
    assert delta_e(BLACK, WHITE) == pytest.approx(np.full((2, 3), 100.0), abs=0.01)


def test_the_map_of_differences_grows_brighter():
    sums = [delta_e_map(np.full((1, 1), value)).sum() for value in (0.0, 5.0, 10.0, 20.0)]
    assert sums == sorted(sums)
    assert delta_e_map(np.full((1, 1), 20.0)) == pytest.approx(delta_e_map(np.full((1, 1), 90.0)))


def test_smaller_averages_whole_blocks():
    picture = np.arange(16, dtype=float).reshape(4, 4, 1).repeat(3, -1)
    assert smaller(picture, 2)[..., 0].tolist() == [[2.5, 4.5], [10.5, 12.5]]
    assert smaller(picture, 4) is not picture
    assert np.array_equal(smaller(picture, 9), picture)


def test_a_data_uri_holds_the_picture():
    picture = np.linspace(0, 1, 24).reshape(2, 4, 3)
    assert pixels(data_uri(picture))[..., :3] == pytest.approx(picture, abs=0.5 / 255)


def test_views_of_a_run(pictured):
    shown = views(read_records(pictured))
    assert [(view.scene, view.view, view.seed, view.first) for view in shown] == [
        ("chair", "r_12", 0, True),
        ("chair", "r_87", 0, False),
        ("drums", "r_12", 0, True),
        ("drums", "r_87", 0, False),
    ]
    assert [one.method for one in shown[0].methods] == ["nerf", "nerf_matched", "qnerf"]
    assert pixels(shown[0].truth).shape[:2] == (32, 32)
    assert "mean ΔE₀₀" in shown[0].methods[0].caption


def test_a_diverged_method_says_so_where_its_picture_would_be(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1)
    lost = views(read_records(out))[0].methods[2]
    assert (lost.render, lost.failed, lost.caption) == (None, True, "not finite at step 412: density_head.weight")


def test_missing_and_broken_pictures_are_no_error(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), with_diverged=False)
    folder = out / "records" / "images"
    (folder / "chair.nerf.0.r_12.png").unlink()
    (folder / "chair.qnerf.0.r_12.png").write_bytes(b"\x89PNG, but not for long")
    (folder / "chair.r_87.truth.png").unlink()
    first, second = views(read_records(out))
    assert [one.render is None for one in first.methods] == [True, False, True]
    assert first.methods[0].caption == "no picture was kept"
    assert second.truth is None
    assert second.methods[0].caption == "no ground truth of this size"


@pytest.mark.parametrize("path", ["../../secret.png", "/etc/passwd", "images"])
def test_pictures_outside_of_the_records_are_not_read(tmp_path, path):
    matplotlib.image.imsave(tmp_path / "secret.png", WHITE)
    (tmp_path / "out" / "records" / "images").mkdir(parents=True)
    assert read(tmp_path / "out" / "records", path) is None


def test_a_run_without_pictures_has_no_views(records):
    assert views(records) == []
    assert seed_shown(records, "chair") is None


def test_many_pictures_are_made_smaller():
    assert side_for(10) == 400
    assert side_for(8 * 2 * 13) < 160
    assert side_for(8 * 2 * 13) ** 2 * 8 * 2 * 13 * 2.6 < 9_000_000
    assert side_for(10**9) == 64
