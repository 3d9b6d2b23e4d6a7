"""What the picture comparer shows in a real browser: pictures, numbers, exposure, what is missing, what is saved."""

import re

import numpy as np
import pytest

from reports.data.kept_pictures import kept
from reports.data.load import read_records
from reports.run.run_page import write_page
from scenes.view_sets.pixels import decode_srgb
from tests.reports.comparer_page import Packed, ball, data_of, rendered, write_comparer_page
from tests.reports.comparer_view import SIDE, bytes_of, cells, ready, settle, shown

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("comparer") / "page.html"
    return write_comparer_page(path, data_of(packed, SIDE), packed).as_uri()


def test_every_panel_shows_its_pictures_bytes_without_complaint(browser, address):
    view, noise = ready(browser, address)
    assert noise == []
    truth = ball(SIDE, SIDE, 0)
    expected = {"truth": truth["display"]}
    for number, method in enumerate(("nerf", "nerf_matched", "qnerf")):
        expected[method] = rendered(truth, number, 0, 1600)["display"]
    for name, picture in expected.items():
        for column, row in ((0, 0), (20, 25), (47, 13)):
            assert shown(view, f"{name}-colour", column, row) == bytes_of(picture, column, row), name
    error = np.mean((np.round(255 * expected["nerf"]) / 255 - np.round(255 * truth["display"]) / 255) ** 2)
    assert f"PSNR {-10 * np.log10(error):.2f} dB (record " in view.inner_text('[data-panel="nerf-colour"] .said')


def test_the_numbers_of_a_pixel_are_those_of_the_data(browser, address):
    view, _ = ready(browser, address, "at=pictures&scene=mic&compare.pixel=16,17")
    truth = ball(SIDE, SIDE, 3, hdr=True)
    made = rendered(truth, 2, 0, 1600)
    raw = bytes_of(made["display"], 16, 17)
    row = cells(view, "qnerf")
    assert row[0] == " ".join(map(str, raw))
    assert row[1] == " ".join(f"{value:.4f}" for value in decode_srgb(np.array(raw) / 255))
    assert float(row[2]) == pytest.approx(made["opacity"][17, 16], abs=0.003)
    assert float(row[3]) == pytest.approx(made["depth"][17, 16], abs=0.001)
    difference = (np.array(raw) - bytes_of(truth["display"], 16, 17)) / 255
    assert [float(part.replace("−", "-")) for part in row[4].split()] == pytest.approx(difference, abs=6e-5)
    light = [float(part) for part in cells(view, "truth")[1].split()]
    assert max(light) > 5
    assert light == pytest.approx(truth["linear"][17, 16], rel=1e-3)


def test_the_signed_error_says_what_it_weighs_and_its_rmse_is_that_of_the_psnr(browser, address):
    view, _ = ready(browser, address, "at=pictures&compare.map=colour+signed&compare.pixel=20,25")
    title = "Signed error of luma (0.2126 R + 0.7152 G + 0.0722 B)"
    assert view.inner_text('.maplegend[data-map="signed"] b') == title
    assert view.inner_text(".probe thead th:last-child").split() == title.split()
    for method in ("nerf", "nerf_matched", "qnerf"):
        psnr, rmse = (
            float(re.search(rf"{name}[a-z ]* (\d+\.\d+)", view.inner_text(f'[data-panel="{method}-{shown}"] .said'))[1])
            for shown, name in (("colour", "PSNR"), ("signed", "RMSE"))
        )
        assert psnr == pytest.approx(-20 * np.log10(rmse), abs=0.005 + 20 / np.log(10) * 0.00005 / rmse), method


def test_pictures_beside_the_page_are_loaded_when_they_are_looked_at(browser, tmp_path):
    packed = Packed()
    data = data_of(packed, 16)
    (tmp_path / "report_pictures").mkdir()
    for scene in data["scenes"]:
        for place in [*(view["truth"] for view in scene["views"]), *scene["renders"]]:
            for ref in place.values():
                if isinstance(ref, dict):
                    ref["file"] = f"report_pictures/{scene['name']}.js"
    address = write_comparer_page(tmp_path / "page.html", data, Packed(), beside=True).as_uri()
    lines = ",".join(f'"{name}":"{text}"' for name, text in packed.texts.items())
    (tmp_path / "report_pictures" / "lego.js").write_text(f"reportPictures({{{lines}}});\n", encoding="utf-8")
    view, noise = ready(browser, address)
    made = rendered(ball(16, 16, 0), 2, 0, 1600)["display"]
    assert shown(view, "qnerf-colour", 8, 9, 16, 16) == bytes_of(made, 8, 9)
    assert noise == [address.replace("page.html", "report_pictures/lego.js")]
    view.get_by_role("combobox", name="Scene").select_option("mic")
    settle(view)
    reasons = view.locator(".why:visible").all_inner_texts()
    assert len(reasons) == 4
    assert reasons[0].endswith("the file report_pictures/mic.js beside the page cannot be read.")


def test_the_page_of_a_run_has_it(browser, pictured, tmp_path):
    records = read_records(pictured)
    write_page(records, tmp_path / "report.html")
    view, noise = ready(
        browser, (tmp_path / "report.html").as_uri(), "at=pictures&scene=chair&method=qnerf&seed=0&step=9999"
    )
    assert noise == []
    assert "No picture of step 9999 was kept; shown is the nearest, step 1600." in view.inner_text(".notes")
    assert view.locator("[data-chosen] .who").inner_text() == "qnerf"
    last = next(one for one in kept(records, "chair").renders["qnerf", 0] if one.step == 1600)
    height, width = last.colour.shape[:2]
    assert view.get_by_role("combobox", name="View").input_value() == last.view
    colour = np.clip(last.colour.astype(float), 0, 1)
    assert shown(view, "qnerf-colour", 13, 17, width, height) == bytes_of(colour, 13, 17)
    view.locator("#comparer .stage canvas").first.click(position={"x": 30, "y": 30})
    view.keyboard.press("f")
    settle(view)
    assert view.locator("#comparer .pane").count() == 1
    assert noise == []
