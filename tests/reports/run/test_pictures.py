"""The pictures of a run: the data of the comparer, still views next to the truth, and the turn around a scene."""

import base64
import html
import io
import json
import re
import zlib
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from harness.records.pictures import Turn, read_renders, read_turn, write_renders
from reports.data import packing
from reports.data.load import Records, read_records
from reports.data.saved_pictures import kept
from reports.drawing.images import delta_e
from reports.run import turn
from reports.run.pictures import FOLDER, IMPORTANCE, picture_data, seed_shown, views
from reports.run.run_page import page, write_page
from reports.run.turn import rounds
from tests.replacing import replace
from tests.reports.browsing import opened, until
from tests.reports.fake_run import fake_records


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Records:
    """Return a run whose drums are brighter than white."""
    out = tmp_path_factory.mktemp("data") / "run"
    return fake_records(out, size=12, hdr=("drums",), pictures=True, with_diverged=True)


@pytest.fixture
def single(tmp_path: Path) -> Records:
    """Return a run of a scene and a seed."""
    return fake_records(tmp_path / "run", scenes=("chair",), seeds=1, pictures=True)


def pixels(uri: str) -> np.ndarray:
    kind, _, text = uri.removeprefix("data:image/").partition(";base64,")
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(text)), format=kind)


def decoded(ref: dict[str, Any], text: str, width: int, height: int) -> np.ndarray:
    """Decode as the interface of the page states it, to [height, width, channels]: a plane per byte, the highest first,
    each byte less its left neighbour, or less the one above in the first column.
    """
    raw = np.frombuffer(zlib.decompress(base64.b64decode(text, validate=True)), dtype=np.uint8)
    planes = raw.reshape(ref["channels"], ref["bits"] // 8, height, width).astype(int)
    planes[..., 0] = planes[..., 0].cumsum(-1)
    planes = planes.cumsum(-1) % 256
    levels = planes[:, 0] if ref["bits"] == 8 else 256 * planes[:, 0] + planes[:, 1]
    values = ref["low"] + levels / (2 ** ref["bits"] - 1) * (ref["high"] - ref["low"])
    return np.moveaxis(np.exp(values) - 1e-4 if ref.get("log") else values, 0, -1)


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (7, 4)])
def test_what_the_script_decodes_is_what_was_packed(size: tuple[int, int]) -> None:
    height, width = size
    colour = np.random.default_rng(3).random((height, width, 3)) * 1.2 - 0.1
    depth = np.linspace(0.0, 6.0, height * width).reshape(height, width)  # from nothing hit to the farthest
    packed = packing.display(colour)
    assert (packed.ref["channels"], packed.ref["bits"]) == (3, 8)
    assert decoded(packed.ref, packed.text, width, height) == pytest.approx(colour.clip(0, 1), abs=0.5 / 255 + 1e-9)
    packed = packing.depth(depth, 6.0)
    assert (packed.ref["channels"], packed.ref["bits"], packed.ref["low"]) == (1, 16, 0.0)
    assert decoded(packed.ref, packed.text, width, height)[..., 0] == pytest.approx(depth, abs=0.5 * 6.0 / 4095 + 1e-9)


def test_light_is_within_a_thousandth_from_black_to_the_largest_half() -> None:
    light = np.concatenate([[0.0, 65504.0], np.geomspace(1e-6, 65504.0, 298)]).reshape(10, 10, 3)
    packed = packing.light(light)
    assert packed.ref["log"] is True
    assert (np.abs(decoded(packed.ref, packed.text, 10, 10) - light) / (light + 1e-4)).max() < 0.7e-3
    flat = packing.light(np.full((2, 2, 3), 0.25))
    assert decoded(flat.ref, flat.text, 2, 2) == pytest.approx(np.full((2, 2, 3), 0.25))


def test_equal_pictures_share_an_id() -> None:
    one, same, other = (packing.display(np.full((2, 2), value)) for value in (0.2, 0.2, 0.9))
    assert one.id == same.id != other.id
    assert re.fullmatch(r"px[0-9a-f]{12}", one.id)


def test_every_saved_picture_is_in_a_small_page(small: Records) -> None:
    made = picture_data(small)
    data = made.data

    def shown(ref: dict[str, Any]) -> np.ndarray:
        return decoded(ref, made.inline[ref["id"]], 12, 12)

    assert (data["left_out"], data["beside"], made.files) == ([], "", {})
    assert (data["methods"], data["variables"]["qnerf"]) == (small.methods, "--qnerf")
    for scene in data["scenes"]:
        own = kept(small, scene["name"])
        assert [view["name"] for view in scene["views"]] == list(own.truth)
        assert len(scene["renders"]) == sum(map(len, own.renders.values()))
        for view in scene["views"]:
            truth = own.truth[view["name"]]
            assert view["hdr"] == (scene["name"] == "drums")
            assert shown(view["truth"]["display"]) == pytest.approx(truth.display.astype(float), abs=0.51 / 255)
            assert (linear := view["truth"]["linear"]) is None or view["hdr"]
            if view["hdr"]:
                assert shown(linear) == pytest.approx(truth.linear.astype(float), rel=1e-3, abs=1e-6)
        for row in scene["renders"]:
            name = scene["views"][row["view"]]["name"]
            renders = own.renders[row["method"], row["seed"]]
            (render,) = (render for render in renders if (render.view, render.step) == (name, row["step"]))
            assert shown(row["depth"])[..., 0] == pytest.approx(render.depth.astype(float), abs=0.01)
            assert row["last"] == (row["step"] == renders[-1].step)
            assert row["seconds"] > 0
            assert (row["psnr"] is not None) == (row["last"] and name == "r_12")
    (lost,) = data["scenes"][1]["missing"]
    assert (lost["method"], lost["seed"], lost["status"]) == ("qnerf", 2, "diverged")
    assert "not finite" in lost["reason"]
    assert json.dumps(data, allow_nan=False)


def test_pictures_over_the_budget_are_left_out_by_importance_and_counted(small: Records) -> None:
    complete = picture_data(small)
    before = sum(map(len, complete.inline.values()))
    counts = []
    for budget in (before - 1, int(0.9 * before), int(0.6 * before)):
        made = picture_data(small, budget)
        assert sum(map(len, made.inline.values())) <= budget
        rows = [row for scene in made.data["scenes"] for row in scene["renders"]]
        left_out = made.data["left_out"]
        assert len(rows) < 78
        counts.append(len(rows) + sum(int(sentence.split()[0]) for sentence in left_out))
        assert any(sentence.endswith(f"{IMPORTANCE[4]}.") for sentence in left_out)
        assert {(row["method"], row["seed"]) for row in rows} >= {(method, 0) for method in small.methods}
        used = {ref["id"] for row in rows for ref in (row["colour"], row["opacity"], row["depth"])}
        assert used <= set(made.inline)
    assert set(counts) == {sum(len(scene["renders"]) for scene in complete.data["scenes"])}


def test_pictures_of_a_large_run_lie_in_files(small: Records) -> None:
    made = picture_data(small, budget=1000)
    assert made.inline == {}
    assert list(made.files) == [f"{FOLDER}/0_chair.js", f"{FOLDER}/1_drums.js"]
    assert FOLDER in made.data["beside"]
    texts = {}
    for text in made.files.values():
        texts |= json.loads(re.fullmatch(r"reportPictures\((\{.*\})\);\n", text, re.DOTALL)[1])
    for scene in made.data["scenes"]:
        for row in scene["renders"]:
            assert row["colour"]["file"].endswith(f"_{scene['name']}.js")
            assert decoded(row["colour"], texts[row["colour"]["id"]], 12, 12).shape == (12, 12, 3)
    few = picture_data(small, budget=1000, file_budget=12_000)
    assert few.data["left_out"]
    assert max(map(len, few.files.values())) < 14_000


@pytest.mark.slow
def test_a_page_says_where_its_pictures_are(small: Records, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = html.unescape(page(small))
    assert "'self'" not in text[: text.index("<style")]
    assert text.count('type="application/octet-stream"') > 30
    made = picture_data(small, budget=1000)
    monkeypatch.setattr("reports.run.run_page.picture_data", lambda records: made)
    write_page(small, tmp_path / "report.html")
    assert sorted(file.name for file in (tmp_path / FOLDER).iterdir()) == ["0_chair.js", "1_drums.js"]
    text = html.unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert made.data["beside"] in text
    assert "'self'" in text[: text.index("<style")]
    monkeypatch.setattr("reports.run.run_page.picture_data", lambda records: None)
    write_page(small, tmp_path / "report.html")
    assert not (tmp_path / FOLDER).exists()


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
def test_pictures_outside_of_the_records_are_not_read(single: Records, tmp_path: Path, path: str) -> None:
    (single.folder / "pictures/chair.nerf.0.safetensors").rename(tmp_path / "secret.safetensors")
    found = kept(replace(single, cells=[replace(cell, pictures=path) for cell in single.cells]), "chair")
    assert found.renders == {}
    assert set(found.missing) == {(method, 0) for method in single.methods}


def test_a_run_without_pictures_has_no_views(records):
    assert views(records) == []
    assert picture_data(records) is None
    assert seed_shown(records, "chair") is None


def test_the_truth_comes_first_and_each_strip_holds_all_views(single):
    (shown,) = rounds(single)
    assert (shown.scene, shown.views) == ("chair", 2)
    assert [strip.method for strip in shown.strips] == [None, "nerf", "nerf_matched", "qnerf"]
    saved = read_turn(single.folder / "pictures" / "chair.nerf.0.safetensors", "renders")
    drawn = pixels(shown.strips[1].image)
    assert drawn.shape == np.concatenate(saved.frames, axis=1).shape
    assert np.abs(drawn.astype(float) - np.concatenate(saved.frames, axis=1)).mean() < 8


def test_a_method_of_other_views_or_with_a_damaged_file_is_left_out(single):
    folder = single.folder / "pictures"
    (folder / "chair.nerf.0.safetensors").write_bytes(b"no pictures")
    other = folder / "chair.qnerf.0.safetensors"
    write_renders(other, read_renders(other), Turn(["a", "b"], np.zeros((2, 4, 4, 3), dtype=np.uint8)))
    (shown,) = rounds(single)
    assert [strip.method for strip in shown.strips] == [None, "nerf_matched"]
    assert shown.missing == ["nerf", "qnerf"]
    (folder / "chair.safetensors").unlink()
    assert rounds(single) == []


def test_a_large_run_has_small_pictures(single, monkeypatch):
    monkeypatch.setattr(turn, "BUDGET_BYTES", 1)
    monkeypatch.setattr(turn, "SIDES", (100, 8))
    (shown,) = rounds(single)
    assert max(pixels(shown.strips[0].image).shape[:2]) <= 16


TURNED = """[...document.querySelectorAll('#turn .frame')].every(frame => {{
    const [strip, seen] = [frame.firstElementChild, frame].map(node => node.getBoundingClientRect());
    return seen.width > 50 && Math.abs(seen.left - strip.left - {} * seen.width) < 1;
}})"""
"""Whether all frames show this view."""


@pytest.mark.slow
def test_one_slider_turns_all_strips_and_the_address_holds_the_place(browser, tmp_path):
    file = tmp_path / "report.html"
    write_page(fake_records(tmp_path / "run", seeds=1, pictures=True), file)
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
