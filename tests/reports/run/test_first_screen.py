"""The pictures and the ruler of a report's first screen, the groups of its contents, and what an open page is told."""

import base64
import io
import json
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from reports.data.load import Records
from reports.data.studies_load import ShelfRecords
from reports.page.shell import in_groups, section
from reports.run.figures import ruler
from reports.run.pictures import _closer, exhibit
from reports.run.run_page import VERSION_FILE, page, version, write_page
from tests.replacing import replace
from tests.reports.claims.test_claims import with_comparisons
from tests.reports.fake_run import EIGHT, fake_records
from tests.reports.fake_studies import fake_studies


def picture(uri: str) -> Any:
    return matplotlib.image.imread(io.BytesIO(base64.b64decode(uri.partition(",")[2])))[..., :3]


@pytest.fixture(scope="module")
def five(tmp_path_factory: pytest.TempPathFactory) -> Records:
    out = tmp_path_factory.mktemp("five") / "run"
    return fake_records(out, scenes=EIGHT[:5], seeds=1, size=12, pictures=True, with_diverged=False)


@pytest.mark.parametrize(
    ("differences", "scene"),
    [((3.0, -1.0, 0.5, 0.4, 9.0), "ficus"), ((3.0, -1.0, 0.5, 4.0, 9.0), "chair"), ((3.0, -1.0, 0.5, 4.0), "ficus")],
)
def test_the_pictures_are_those_of_the_scene_with_the_median_difference(
    five: Records, differences: tuple[float, ...], scene: str
) -> None:
    known = dict(zip(five.scenes, differences, strict=False))
    judged = replace(five, comparisons=[row for row in five.comparisons if row.scene in (*known, "all")])
    shown = exhibit(with_comparisons(judged, **{name: {"difference": each} for name, each in known.items()}))
    assert shown.title == five.scene(scene).title
    assert f"the scene of the median difference of {len(known)} scenes" in shown.why
    assert [each.method for each in shown.renders] == ["nerf", "qnerf"]
    assert all(each.caption.endswith(" dB") for each in shown.renders)
    assert picture(shown.truth).shape == picture(shown.difference).shape == (12, 12, 3)


def test_a_run_without_a_comparison_shows_what_there_is(five: Records) -> None:
    begun = replace(five, comparisons=[], cells=[cell for cell in five.cells if cell.method == "nerf"])
    begun = replace(begun, run=replace(begun.run, finished=False))
    shown = exhibit(begun)
    assert [(each.method, each.caption) for each in shown.renders][1] == ("qnerf", "no picture yet")
    assert shown.difference is None
    assert ruler(begun) is None
    assert "no picture yet" in page(begun)


def test_each_pixel_has_the_colour_of_the_method_that_is_closer() -> None:
    errors = [np.array([[0.0, 0.2, 0.5]]), np.array([[0.0, 0.0, 0.6]])]
    drawn = _closer(errors, ["#000000", "#ff0000"])
    assert drawn[0, 0].tolist() == [1.0, 1.0, 1.0], "as close: paper"
    assert drawn[0, 1].tolist() == pytest.approx([1.0, 0.0, 0.0]), "the second is closer by the full scale"
    assert drawn[0, 2].tolist() == pytest.approx([0.5, 0.5, 0.5]), "the first is closer by half of it"


def test_the_ruler_has_both_intervals_the_band_and_the_claim_on_one_axis(whole: Records) -> None:
    made = ruler(whole)
    row = whole.comparison("all", "qnerf", "nerf")
    assert made.rows[:2] == ("− nerf\nthese scenes", "− nerf\nscenes like these")
    bars = [(trace.x[0], trace.y[0], trace.x_high[0]) for trace in made.traces if trace.label == "95 % interval"]
    pairs = [each.simultaneous for each in (row.on_these_scenes, row.scenes_like_these)]
    assert bars[:2] == [(low, float(place), high) for place, (low, high) in enumerate(pairs)]
    (claimed,) = [trace for trace in made.traces if trace.label == "claimed"]
    assert (claimed.x, claimed.y) == ((1.5,), (0.0,))
    (band,) = [trace for trace in made.traces if trace.kind == "area"]
    assert (min(band.x), max(band.x)) == (-0.2, 0.2)
    assert made.x_limits[0] < -0.2 < 1.5 < made.x_limits[1]
    assert made.x_label == "difference in test PSNR (dB)"


def test_a_wide_interval_does_not_decide_the_axis(whole: Records) -> None:
    wide = replace(whole.comparison("all", "qnerf", "nerf").scenes_like_these, simultaneous=(-90.0, 90.0))
    made = ruler(with_comparisons(whole, all={"scenes_like_these": wide}))
    assert max(map(abs, made.x_limits)) < 5
    assert "[−90.00, +90.00]" in made.figures[1], "its ends are printed"


def test_the_contents_have_groups_in_the_order_of_the_page() -> None:
    every = [section(name, name) for name in ("a", "b", "c", "d")]
    groups = in_groups(every, {"First": ("c",), "Second": ("b", "a"), "Last": ()})
    assert {group: [part.name for part in parts] for group, parts in groups.items()} == {
        "First": ["c"], "Second": ["b", "a"], "Last": ["d"],
    }  # fmt: skip


def test_stability_has_a_row_on_the_first_screen_in_any_case(whole: Records, whole_page: str) -> None:
    assert "Stability was not tested in this run." in whole_page[: whole_page.index("<nav")]
    text = page(whole, ShelfRecords(stability=fake_studies("stability", charts=False)))
    top = text[: text.index("<nav")]
    assert "Stability was not tested" not in top
    assert 'href="#stability">All ' in top


def test_serving_is_not_on_the_first_screen(whole: Records) -> None:
    quick = fake_studies("serving", failing=True, charts=False, settings={"quick": True})
    text = page(whole, ShelfRecords(serving=quick))
    assert 'href="#serving"' not in text[: text.index("At what scale")]
    assert "A quick run." in text


def test_only_an_unfinished_page_asks_for_a_newer_one(whole: Records, tmp_path: Path) -> None:
    begun = replace(whole, run=replace(whole.run, finished=False), cells=whole.cells[:-1])
    (tmp_path / "other").mkdir()
    for name, records in (("report.html", begun), ("report.html", whole), ("other/report.html", whole)):
        write_page(records, tmp_path / name)
        asks = 'id="version-data"' in (tmp_path / name).read_text(encoding="utf-8")
        assert asks == (records is begun)
        told = (tmp_path / name).parent / VERSION_FILE
        if told.exists():
            assert told.read_text(encoding="utf-8") == f"reportVersion({json.dumps(version(records))});\n"
    assert not (tmp_path / "other" / VERSION_FILE).exists(), "nobody has an earlier page open"
    assert version(begun) != version(whole)
