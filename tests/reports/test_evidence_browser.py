"""The studies and the work–precision diagrams in a real browser: chosen without a script, readable in the dark and on a
phone."""

import xml.etree.ElementTree as ET

import pytest

from reports.data.beside import Beside
from reports.data.load import read_records
from reports.run.run_page import write_page
from reports.studies.effects_plot import forests
from tests.reports.browsing import opened
from tests.reports.exploring import rows_of, saved
from tests.reports.fake_evidence import INTEREST, fake_evidence
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_run(tmp_path_factory.mktemp("evidence") / "run", pictures=False)
    write_page(read_records(out), out / "report.html", Beside(evidence=fake_evidence()))
    return (out / "report.html").as_uri()


def shown(view) -> list[str]:
    return view.evaluate(
        "[...document.querySelectorAll('.choice')].filter(one => one.offsetHeight).map(one => one.className)"
    )


def test_one_pair_of_error_and_cost_is_seen_and_the_reader_chooses_which(browser, address):
    view, noise = opened(browser, address)
    assert shown(view) == ["choice rmse_linear-seconds"]
    view.get_by_text("1 − SSIM", exact=True).first.click()
    view.get_by_text("network evaluations", exact=True).first.click()
    assert shown(view) == ["choice dssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert shown(view) == ["choice dssim-seconds"], "by keyboard as well"
    assert noise == []


def test_a_forest_is_saved_as_it_is_drawn_with_its_numbers(browser, address):
    view, _ = opened(browser, address)
    tools = view.locator("#study-factorial .tools").first
    study = next(one for one in fake_evidence().studies if one.info.id == "factorial")
    (rows, *_) = (group.rows for group in forests(study.effects, INTEREST)[0].groups)
    saved_rows = rows_of(saved(view, tools, "CSV"))
    assert len(saved_rows) == sum(len(group.rows) for group in forests(study.effects, INTEREST)[0].groups)
    found = [row for row in saved_rows if row["scene"] == "all scenes"]
    wanted = ("", "all", "psnr", "steps")
    effects = [one for one in study.effects if (one.against, one.scene, one.metric, one.budget) == wanted]
    for row, drawn, effect in zip(found, rows, effects, strict=True):
        assert (row["scene"], row["effect"], row["verdict"]) == ("all scenes", drawn.name, drawn.verdict)
        ends = ("", " low", " high", " simultaneous low", " simultaneous high")
        numbers = [float(row[f"difference and 95 % interval{end}"]) for end in ends]
        assert numbers == [effect.difference, *effect.interval, *effect.simultaneous]
    tree = ET.fromstring(saved(view, tools, "SVG"))
    assert tree.find(f"{SVG}title").text == "What does each part do? – PSNR at equal steps (dB)"
    dots = [float(one.get("cx")) for one in tree.iter(f"{SVG}circle")][: len(rows)]
    width = view.evaluate("document.querySelector('.forest .track').getBoundingClientRect().width")
    places = [(row.dot - rows[0].dot) * width / 100 for row in rows]
    assert [dot - dots[0] for dot in dots] == pytest.approx(places, abs=0.05)
    assert "var(" not in ET.tostring(tree, encoding="unicode")
