"""The first screen in a real browser: what is in sight, what its tables give as files, and what long names do."""

import re

import pytest

from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import opened, unfold
from tests.reports.exploring import rows_of, saved
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow

LONG = "anameofsixtylettersinwhichthereisnoplaceatallwhereitcanbreak"


def written(folder, *scenes, **options) -> str:
    write_page(read_records(write_fake_run(folder / "run", scenes, size=16, **options)), folder / "report.html")
    return (folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> str:
    return written(tmp_path_factory.mktemp("whole"), "chair", "drums", pictures=False, with_diverged=False)


@pytest.fixture(scope="module")
def lengthy(tmp_path_factory) -> str:
    """A scene with a long name that stands in alerts, notes, figures and pictures."""
    return written(tmp_path_factory.mktemp("lengthy"), "chair", LONG)


def test_the_claims_are_saved_a_row_each_with_numbers_that_parse(browser, whole):
    view, _ = opened(browser, whole)
    tools = view.locator(".scroll:has(.principal) + .tools, .tools:has(+ .scroll .principal)")
    rows = rows_of(saved(view, tools, "CSV"))
    assert [row["claim"] for row in rows] == view.locator(".principal tbody th").all_inner_texts()
    by_claim = {row["claim"]: row for row in rows}
    every, average, weights = (by_claim[name] for name in ("PSNR gain, every scene", "PSNR gain, average", "weights"))
    assert (every["printed"], every["printed from"], every["printed to"]) == ("", "1.2", "1.8")
    assert (average["printed"], average["printed unit"]) == ("1.5", "dB")
    assert [round(float(average[f"measured{end}"]), 2) for end in ("", " low", " high")] == [0.81, 0.69, 0.93]
    assert (weights["printed"], weights["measured"], weights["note"]) == ("1370000", "546566", "the paper’s network")
    assert by_claim["fewer iterations to 30 dB"]["measured"] == ""
    figures = [
        row[name] for row in rows for name in row if re.fullmatch(r"(printed|measured)( from| to| low| high)?", name)
    ]
    assert [float(one) for one in figures if one]
    markdown = [line for line in saved(view, tools, "Markdown").splitlines() if line.startswith("|")]
    assert markdown[0] == "| claim | printed | measured | verdict | note |"
    assert len(markdown) == 2 + len(rows)
    assert markdown[-1].endswith("| the paper’s network |")
    latex = [line for line in saved(view, tools, "LaTeX").splitlines() if line.endswith(" \\\\")]
    assert len(latex) == 1 + len(rows)
    assert {line.count(" & ") for line in latex} == {4}


def test_a_sorted_tally_keeps_its_total_last_and_links_are_no_part_of_buttons(browser, whole):
    view, _ = opened(browser, whole)
    view.locator(".tally th .sort").nth(4).click()
    rows = view.locator(".tally tr")
    counts = [0 if text == "·" else int(text) for text in rows.locator("td:last-child").all_inner_texts()]
    assert counts[:-1] == sorted(counts[:-1], reverse=True)
    assert counts[-1] == sum(counts[:-1])
    assert rows.last.inner_text().startswith("93 printed statements")
    assert view.locator("button a, a button").count() == 0


@pytest.mark.parametrize("width", [390, 1280])
def test_a_long_name_makes_no_page_wider_and_is_not_cut(browser, lengthy, width):
    view, _ = opened(browser, lengthy, viewport={"width": width, "height": 844})
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width
    cut = """[...document.querySelectorAll('.alert, .scroll:has(.principal), figcaption')]
        .filter(one => one.checkVisibility() && one.scrollWidth > one.clientWidth + 1).map(one => one.textContent)"""
    assert view.evaluate(cut) == []
    for place in (".alert", ".principal .why td", "#convergence figcaption"):
        assert view.locator(place, has_text=LONG).count() > 0
