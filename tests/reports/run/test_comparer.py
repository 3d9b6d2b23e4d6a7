"""The picture comparer in a real browser: its pictures and numbers, zoom and pan, its address, and its keys."""

import json
import re

import numpy as np
import pytest

from harness.records.pictures import Render, Truth
from harness.training.scoring import metrics
from reports.data.load import Records, read_records
from reports.data.saved_pictures import kept
from reports.run.pictures import picture_data
from reports.run.run_page import write_page
from scenes.view_sets.pixels import decode_srgb
from tests.reports.browsing import address_of, opened, until
from tests.reports.comparing import (
    SIDE,
    asked,
    bytes_of,
    cells,
    ready,
    settle,
    settle_address,
    shown,
    write_comparer_page,
)
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow

FOCUSED = """(() => {
    const node = document.activeElement, style = getComputedStyle(node);
    return [node.ariaLabel || node.textContent, style.outlineStyle !== 'none' && style.outlineWidth !== '0px'];
})()"""
HOSTILE = ("<img src=x onerror=alert(1)>", "</script><b>", "truth")
METHODS = ("nerf", "nerf_matched", "qnerf")


@pytest.fixture(scope="module")
def records(tmp_path_factory) -> Records:
    """Two scenes × two views × two seeds; the truth of mic is brighter than white."""
    out = tmp_path_factory.mktemp("comparer") / "run"
    return read_records(write_fake_run(out, ("lego", "mic"), seeds=2, size=SIDE, hdr=("mic",)))


@pytest.fixture(scope="module")
def address(records, tmp_path_factory) -> str:
    made = picture_data(records)
    return write_comparer_page(tmp_path_factory.mktemp("page") / "page.html", made.data, made.inline).as_uri()


def pictures(records: Records, scene: str) -> tuple[Truth, dict[str, Render]]:
    """Return the truth of the first view, and the last render of each method."""
    saved = kept(records, scene)
    renders = {name: {(render.view, render.step): render for render in saved.renders[name, 0]} for name in METHODS}
    return saved.truth["r_12"], {name: own["r_12", 1600] for name, own in renders.items()}


def test_every_panel_shows_its_pictures_bytes_without_complaint(browser, address, records):
    view, noise = ready(browser, address)
    assert noise == []
    truth, last = pictures(records, "lego")
    colours = {"truth": truth.display, **{name: render.colour for name, render in last.items()}}
    for name, picture in colours.items():
        for column, row in ((0, 0), (20, 25), (47, 13)):
            assert shown(view, f"{name}-colour", column, row) == bytes_of(picture, column, row), name
    first, second = (np.round(255 * np.clip(colours[name].astype(float), 0, 1)) for name in ("truth", "nerf"))
    error = np.mean(((first - second) / 255) ** 2)
    assert f"PSNR {-10 * np.log10(error):.2f} dB (record " in view.inner_text('[data-panel="nerf-colour"] .said')


def test_a_scene_brighter_than_white_has_the_numbers_of_the_data_and_maps_of_light(browser, address, records):
    choice = "at=pictures&scene=mic&compare.map=rel_mse+smape+hdr_flip&compare.pixel=24,23"
    view, noise = ready(browser, address, choice)
    assert noise == []
    truth, last = pictures(records, "mic")
    raw = bytes_of(last["qnerf"].colour, 24, 23)
    row = cells(view, "qnerf")
    assert row[0] == " ".join(map(str, raw))
    assert row[1] == " ".join(f"{value:.4f}" for value in decode_srgb(np.array(raw) / 255))
    assert float(row[2]) == pytest.approx(last["qnerf"].opacity[23, 24], abs=0.003)
    assert float(row[3]) == pytest.approx(last["qnerf"].depth[23, 24], abs=0.002)
    difference = (np.array(raw) - bytes_of(truth.display, 24, 23)) / 255
    assert [float(part.replace("−", "-")) for part in row[4].split()] == pytest.approx(difference, abs=6e-5)
    light = [float(part) for part in cells(view, "truth")[1].split()]
    assert max(light) > 1
    assert light == pytest.approx(truth.linear[23, 24].tolist(), rel=1e-3)
    drawn = decode_srgb(np.round(255 * np.clip(last["nerf"].colour.astype(np.float64), 0, 1)) / 255)
    said = view.inner_text('[data-panel="nerf-smape"] .said')
    mean = metrics.smape(drawn.astype(np.float32), truth.linear.astype(np.float32))
    assert float(re.search(r"mean (\d+\.\d+)", said)[1]) == pytest.approx(mean, rel=5e-3, abs=2e-4)
    view.get_by_role("combobox", name="Scene").select_option("lego")
    settle(view)
    assert view.locator('[data-name="rel_mse"]:visible').count() == 0
    assert view.locator('[data-panel="nerf-colour"]').count() == 1, "lego's light fits a display"


def test_pictures_in_files_are_loaded_when_they_are_shown(browser, records, tmp_path):
    made = picture_data(records, budget=1000)
    address = write_comparer_page(tmp_path / "page.html", made.data, made.inline, beside=True).as_uri()
    (tmp_path / "report_pictures").mkdir()
    (tmp_path / "report_pictures/0_lego.js").write_text(made.files["report_pictures/0_lego.js"], encoding="utf-8")
    view, noise = ready(browser, address)
    assert shown(view, "qnerf-colour", 8, 9) == bytes_of(pictures(records, "lego")[1]["qnerf"].colour, 8, 9)
    assert noise == [address.replace("page.html", "report_pictures/0_lego.js")]
    view.get_by_role("combobox", name="Scene").select_option("mic")
    settle(view)
    reasons = view.locator(".why:visible").all_inner_texts()
    assert len(reasons) == 4
    assert reasons[0].endswith("the file report_pictures/1_mic.js beside the page cannot be read.")


@pytest.fixture(scope="module")
def report(pictured, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(read_records(pictured), path)
    return path.as_uri()


def test_the_pictures_of_the_runs_behind_a_figure_are_shown(browser, report, pictured):
    view, noise = opened(browser, f"{report}#runs.open=1&scene=drums&method=nerf&seed=1")
    noise.remove(report)
    until(view, "document.querySelectorAll('#runs canvas[data-drawn]').length === 2")
    drums = kept(read_records(pictured), "drums")
    seen = view.evaluate("""[...document.querySelectorAll('#runs canvas')].map(canvas =>
        [...canvas.getContext('2d').getImageData(13, 17, 1, 1).data].slice(0, 3))""")
    last = drums.renders["nerf", 1][0]
    expected = [bytes_of(picture, 13, 17) for picture in (drums.truth["r_12"].display, last.colour)]
    assert (last.view, seen) == ("r_12", expected)
    assert view.locator("#runs .thumbnail small").all_inner_texts() == ["ground truth", "step 1600"]
    view.get_by_role("button", name="compare the pictures").click()
    until(view, "location.hash.includes('at=pictures')")
    assert noise == []


def test_the_page_of_a_run_has_it(browser, report, pictured):
    view, noise = ready(browser, report, "at=pictures&scene=chair&method=qnerf&seed=0&step=9999")
    assert noise == []
    assert "No picture of step 9999 was kept; shown is the nearest, step 1600." in view.inner_text(".notes")
    assert view.locator("[data-chosen] .who").inner_text() == "qnerf"
    last = next(render for render in kept(read_records(pictured), "chair").renders["qnerf", 0] if render.step == 1600)
    height, width = last.colour.shape[:2]
    assert view.get_by_role("combobox", name="View").input_value() == last.view
    assert shown(view, "qnerf-colour", 13, 17, width, height) == bytes_of(last.colour, 13, 17)
    view.locator("#comparer .stage canvas").first.click(position={"x": 30, "y": 30})
    view.keyboard.press("f")
    settle(view)
    assert view.locator("#comparer .pane").count() == 1
    assert noise == []


def test_zoom_and_pan_are_locked_over_all_panels(browser, address):
    view, _ = ready(browser, address, "at=pictures&compare.map=colour+delta_e")
    boxes = [canvas.bounding_box() for canvas in view.locator(".stage canvas").all()]
    assert len(boxes) == 8
    view.mouse.click(boxes[0]["x"] + 50, boxes[0]["y"] + 60)
    view.mouse.wheel(0, -600)
    settle(view)
    view.mouse.down()
    view.mouse.move(boxes[0]["x"] + 90, boxes[0]["y"] + 95, steps=4)
    view.mouse.up()
    settle_address(view)
    times, width = 2**2.5, boxes[0]["width"]
    assert float(asked(view, "compare.zoom")) == pytest.approx(times, abs=0.001)
    # The clicked pixel stays under the wheel and follows the drag, so that it is now 90 from the left.
    assert float(asked(view, "compare.x")) == pytest.approx(50 / width + (width / 2 - 90) / (width * times), abs=1e-3)
    assert not view.evaluate("document.querySelector('.probe').scrollLeft")
    pixels = []
    for box in (canvas.bounding_box() for canvas in view.locator(".stage canvas").all()):
        view.mouse.move(box["x"] + 90, box["y"] + 95)
        settle(view)
        pixels.append(view.inner_text(".probe thead th:first-child"))
    assert len(set(pixels)) == 1
    assert pixels[0] != "pixel 19, 20"
    column, row = map(int, pixels[0].removeprefix("pixel ").split(","))
    assert asked(view, "compare.pixel") == f"{column},{row}", "the clicked pixel is where the drag moved it"
    view.locator(".stage canvas").first.dblclick()
    settle_address(view)
    assert asked(view, "compare.zoom") is None


def test_an_address_restores_everything(browser, address):
    view, _ = ready(browser, address)
    view.get_by_role("combobox", name="Scene").select_option("mic")
    view.get_by_role("combobox", name="View").select_option("r_87")
    view.get_by_role("button", name="Difference").click()
    view.get_by_role("combobox", name="A", exact=True).select_option("qnerf")
    view.get_by_role("combobox", name="B", exact=True).select_option("nerf")
    view.get_by_role("button", name="FLIP", exact=True).click(modifiers=["Shift"])
    view.locator(".stage canvas").first.click(position={"x": 100, "y": 90})
    for key in ("+", "+", "e", ","):
        view.keyboard.press(key)
        settle(view)
    settle_address(view)
    assert asked(view, "compare.zoom") is not None
    again, _ = ready(browser, *address_of(view).split("#"))
    pictures = "[...document.querySelectorAll('.stage canvas')].map(canvas => canvas.toDataURL())"
    texts = (f"document.querySelector('{place}').innerText" for place in (".probe", ".controls"))
    for state in (pictures, *texts):
        assert again.evaluate(state) == view.evaluate(state)
    assert again.evaluate(pictures)[0] != again.evaluate(pictures)[1]
    assert again.inner_text(".probe thead").count("A against B") == 2


@pytest.fixture(scope="module")
def hostile(records, tmp_path_factory) -> str:
    made = picture_data(records)
    text = json.dumps(made.data)
    for name, other in zip((*METHODS, "lego"), (*HOSTILE, "__proto__ & Söhne"), strict=True):
        text = text.replace(json.dumps(name), json.dumps(other))
    data = {**json.loads(text), "left_out": ["<script>alert(3)</script> was left out."]}
    return write_comparer_page(tmp_path_factory.mktemp("hostile") / "page.html", data, made.inline).as_uri()


def test_names_are_text_and_never_markup(browser, hostile):
    view, noise = ready(browser, hostile, "at=pictures&compare.mode=wipe&compare.a=method+truth")
    assert view.locator("figcaption .who").all_inner_texts()[0] == "truth"
    view.locator(".stage").focus()
    view.keyboard.press("s")
    settle(view)
    assert view.locator("figcaption .who").all_inner_texts() == ["ground truth", *HOSTILE]
    assert view.locator("#comparer :is(img, svg, script, figcaption b)").count() == 0
    assert "<script>alert(3)</script> was left out." in view.inner_text(".notes")
    assert noise == []


def test_every_control_has_a_name_and_is_reached_by_keys_and_the_signed_error_states_its_weights(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.mode=wipe&compare.map=signed")
    nameless = """[...document.querySelectorAll('#comparer :is(button, select, input, canvas, [role])')]
        .filter(e => !(e.ariaLabel || e.labels?.length || e.textContent.trim() || e.role === 'status'))"""
    assert view.evaluate(f"{nameless}.map(node => node.outerHTML)") == []
    title = "Signed error of luma (0.2126 R + 0.7152 G + 0.0722 B)"
    assert view.inner_text('.maplegend[data-map="signed"] b') == title
    assert view.inner_text(".probe thead th:last-child").split() == title.split()
    view.evaluate("document.activeElement.blur()")
    reached = []
    for _ in range(60):
        view.keyboard.press("Tab")
        reached.append(view.evaluate(FOCUSED))
        if reached[-1][0] == "Numbers of a pixel":
            break
    wanted = {"Scene", "Wipe", "A", "Signed error", "Checkpoint", "Exposure", "Range of colours"}
    assert wanted | {"Where A ends and B begins"} <= {name for name, _ in reached}
    assert [name for name, seen in reached if not seen] == []
    view.keyboard.press("?")
    assert view.get_by_role("dialog").is_visible()
    assert noise == []
