"""The picture data of the page: it decodes as in the script, fits its budget, and states what was left out."""

import base64
import html
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reports.data import packing
from reports.data.load import read_records
from reports.data.saved_pictures import kept
from reports.run.pictures import FOLDER, IMPORTANCE, picture_data
from reports.run.run_page import page, write_page
from tests.reports.fake_run import write_fake_run


def decoded(ref: dict[str, Any], text: str, width: int, height: int) -> np.ndarray:
    """Decode value by value, as the interface of the page states it, to [height, width, channels]."""
    raw = zlib.decompress(base64.b64decode(text, validate=True))
    many = ref["bits"] // 8
    assert len(raw) == ref["channels"] * many * width * height
    planes = []
    for start in range(0, len(raw), width * height):
        plane = list(raw[start : start + width * height])
        for row in range(height):
            for column in range(width):
                place = row * width + column
                before = place - 1 if column else place - width if row else None
                plane[place] = (plane[place] + (0 if before is None else plane[before])) % 256
        planes.append(plane)
    picture = np.zeros((height, width, ref["channels"]))
    for channel in range(ref["channels"]):
        own = planes[channel * many : (channel + 1) * many]
        levels = [
            sum(byte << (8 * (many - 1 - k)) for k, byte in enumerate(bytes_)) for bytes_ in zip(*own, strict=True)
        ]
        values = ref["low"] + np.array(levels) / (2 ** ref["bits"] - 1) * (ref["high"] - ref["low"])
        picture[..., channel] = (np.exp(values) - 1e-4 if ref.get("log") else values).reshape(height, width)
    return picture


@pytest.mark.parametrize("size", [(1, 1), (1, 5), (5, 1), (7, 4)])
def test_what_the_script_decodes_is_what_was_packed(size: tuple[int, int]) -> None:
    height, width = size
    colour = np.random.default_rng(3).random((height, width, 3)) * 1.2 - 0.1
    depth = np.linspace(0.0, 6.0, height * width).reshape(height, width)  # from nothing hit to the farthest
    packed = packing.display(colour)
    assert (packed.ref["channels"], packed.ref["bits"]) == (3, 8)
    back = decoded(packed.ref, packed.text, width, height)
    assert back == pytest.approx(colour.clip(0, 1), abs=0.5 / 255 + 1e-9)
    packed = packing.depth(depth, 6.0)
    assert (packed.ref["channels"], packed.ref["bits"], packed.ref["low"]) == (1, 16, 0.0)
    assert decoded(packed.ref, packed.text, width, height)[..., 0] == pytest.approx(depth, abs=0.5 * 6.0 / 4095 + 1e-9)


def test_light_is_within_a_thousandth_from_black_to_the_largest_half() -> None:
    light = np.concatenate([[0.0, 65504.0], np.geomspace(1e-6, 65504.0, 298)]).reshape(10, 10, 3)
    packed = packing.light(light)
    assert packed.ref["log"] is True
    error = np.abs(decoded(packed.ref, packed.text, 10, 10) - light) / (light + 1e-4)
    assert error.max() < 0.7e-3
    flat = packing.light(np.full((2, 2, 3), 0.25))
    assert decoded(flat.ref, flat.text, 2, 2) == pytest.approx(np.full((2, 2, 3), 0.25))


def test_equal_pictures_share_an_id() -> None:
    one, same, other = (packing.display(np.full((2, 2), value)) for value in (0.2, 0.2, 0.9))
    assert one.id == same.id != other.id
    assert re.fullmatch(r"px[0-9a-f]{12}", one.id)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fake_run(tmp_path_factory.mktemp("data") / "run", size=12, hdr=("drums",))


def test_every_saved_picture_is_in_a_small_page(out: Path) -> None:
    records = read_records(out)
    made = picture_data(records)
    data = made.data

    def shown(ref: dict[str, Any]) -> np.ndarray:
        return decoded(ref, made.inline[ref["id"]], 12, 12)

    assert (data["left_out"], data["beside"], made.files) == ([], "", {})
    assert (data["methods"], data["variables"]["qnerf"]) == (records.methods, "--qnerf")
    for scene in data["scenes"]:
        own = kept(records, scene["name"])
        assert [view["name"] for view in scene["views"]] == list(own.truth)
        assert len(scene["renders"]) == sum(map(len, own.renders.values()))
        for view in scene["views"]:
            truth = own.truth[view["name"]]
            assert view["hdr"] == (scene["name"] == "drums")
            assert shown(view["truth"]["display"]) == pytest.approx(truth.display.astype(float), abs=0.51 / 255)
            assert (view["truth"]["linear"] is None) != view["hdr"]
            if view["hdr"]:
                linear = truth.linear.astype(float)
                assert shown(view["truth"]["linear"]) == pytest.approx(linear, rel=1e-3, abs=1e-6)
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


def test_pictures_over_the_budget_are_left_out_by_importance_and_counted(out: Path) -> None:
    records = read_records(out)
    complete = picture_data(records)
    before = sum(map(len, complete.inline.values()))
    counts = []
    for budget in (before - 1, int(0.9 * before), int(0.6 * before)):
        made = picture_data(records, budget)
        assert sum(map(len, made.inline.values())) <= budget
        rows = [row for scene in made.data["scenes"] for row in scene["renders"]]
        left_out = made.data["left_out"]
        assert len(rows) < 78
        counts.append(len(rows) + sum(int(sentence.split()[0]) for sentence in left_out))
        assert any(sentence.endswith(f"{IMPORTANCE[4]}.") for sentence in left_out)
        assert {(row["method"], row["seed"]) for row in rows} >= {(method, 0) for method in records.methods}
        used = {ref["id"] for row in rows for ref in (row["colour"], row["opacity"], row["depth"])}
        assert used <= set(made.inline)
    assert set(counts) == {sum(len(scene["renders"]) for scene in complete.data["scenes"])}


def test_pictures_of_a_large_run_lie_in_files(out: Path) -> None:
    records = read_records(out)
    made = picture_data(records, budget=1000)
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
    small = picture_data(records, budget=1000, file_budget=12_000)
    assert small.data["left_out"]
    assert max(map(len, small.files.values())) < 14_000


@pytest.mark.slow
def test_a_page_says_where_its_pictures_are(out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    records = read_records(out)
    text = html.unescape(page(records))
    assert "'self'" not in text[: text.index("<style")]
    assert text.count('type="application/octet-stream"') > 30
    made = picture_data(records, budget=1000)
    monkeypatch.setattr("reports.run.run_page.picture_data", lambda records: made)
    write_page(records, tmp_path / "report.html")
    assert sorted(file.name for file in (tmp_path / FOLDER).iterdir()) == ["0_chair.js", "1_drums.js"]
    text = html.unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert made.data["beside"] in text
    assert "'self'" in text[: text.index("<style")]
    monkeypatch.setattr("reports.run.run_page.picture_data", lambda records: None)
    write_page(records, tmp_path / "report.html")
    assert not (tmp_path / FOLDER).exists()
