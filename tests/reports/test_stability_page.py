"""stability.html and the section of the report: ours first, every finding in sight, nothing fetched, all escaped."""

import html
import re
import shutil
from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest

from harness.stability_record import CHAPTERS, StabilityRecord
from reports.beside import Beside
from reports.page import page
from reports.stability_page import stability_page
from tests.reports.fake_stability import fake_stability, hostile, write_fake_stability
from tests.reports.test_page import HOSTILE, Outline, foreign_scripts, without_code

EMPTY = StabilityRecord({}, {}, finished=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_fake_stability(tmp_path_factory.mktemp("stability"))


@pytest.fixture(scope="module")
def text(folder) -> str:
    return stability_page(fake_stability(), folder)


def body(text: str, name: str) -> str:
    start = text.index(f'<section id="{name}">')
    return text[start : text.index("</section>", start)]


def seen(text: str) -> str:
    """What a reader reads."""
    return html.unescape(re.sub(r"<style.*?</style>|<[^>]*>", " ", without_code(text), flags=re.DOTALL))


def test_the_page_is_well_formed_and_its_links_lead_somewhere(text):
    outline = Outline(text)
    assert len(outline.ids) == len(set(outline.ids))
    links = {link[1:] for link in outline.links if link.startswith("#")}
    assert links <= set(outline.ids)
    assert {"case-Q1", "chapter-9", "matrix", "findings", "cases"} <= links


def test_nothing_is_fetched(text):
    outline = Outline(text)
    assert [link for link in outline.links if not link.startswith(("#", "data:"))] == []
    assert re.findall(r"url\(\s*[\"']?(?!#)", text) == []
    assert "@import" not in text
    assert foreign_scripts(text) == []
    assert text.index("Content-Security-Policy") < text.index("<style>")


def test_the_first_screen_says_what_of_ours_failed_and_what_was_found(text):
    top = seen(text[: text.index("<nav")])
    for words in ("1 of 30 stability checks of this harness fails", "17 cases on 20 subjects", "54 outcomes",
                  "A2 harness: 3.00·10⁻⁴, wanted ≤ 2·10⁻⁶ (after a reload)", "miss the bar in 9 of 15 checks",
                  "miss the bar in 6 of 7 checks", "properties of theirs, not failures",
                  "1 not available here and 1 not applicable"):  # fmt: skip
        assert words in top, words


def test_where_all_is_well_the_first_screen_says_so_and_nothing_is_alarming(folder):
    top = stability_page(fake_stability(with_failure=False, with_charts=False), folder)
    top = top[: top.index("<nav")]
    assert "All 30 stability checks of this harness pass" in top
    assert "Everything that is ours passes: 30 checks." in top
    assert 'class="alert"' not in top


def test_every_outcome_is_in_the_details_with_its_reason(text):
    cases = body(text, "cases")
    for case in fake_stability().cases:
        start = cases.index(f'<div id="case-{case.info.id}">')
        own = seen(cases[start : cases.index("</details>", start)])
        for words in (case.info.input, case.info.danger, case.info.reference, case.info.bar):
            assert words in own, words
        for one in case.outcomes:
            for words in filter(None, (one.subject, one.what, one.why)):
                assert words in own, (case.info.id, words)


def test_a_failure_of_ours_and_a_property_of_the_paper_look_different(text):
    cells = body(text, "matrix")
    assert re.search(r'<span class="chip fails" title="harness[^>]*>.*?✕', cells)
    assert re.search(r'<td class="property" data-subject="qnerf"[^>]*>.*?◆', cells)
    assert cells.count('class="chip fails"') + cells.count('<td class="fails"') == 1


def test_the_details_of_a_failed_case_are_open_and_all_others_are_not(text):
    shut, opened = re.findall(r'<details class="case">', text), re.findall(r'<details class="case" open>', text)
    assert (len(shut), len(opened)) == (16, 1)


def test_what_was_found_of_others_is_listed_once_each(text):
    found = body(text, "findings")
    assert found.count("◆") == 15
    for words in ("listing4", "2.50·10⁷", "opaque, where 4e-8 is", "φ is a Pisot number", "not finite",
                  "33\u202f424\u202fsteps", "9 properties", "6 properties"):  # fmt: skip
        assert words in found, words
    assert "after a reload" not in found


def test_chapters_stand_in_their_order_with_charts_tables_and_pictures(text):
    numbers = [int(one) for one in re.findall(r'<section id="chapter-(\d+)">', text)]
    assert numbers == [1, 2, 3, 4, 5, 6, 7, 8, 9, 11]
    assert f"<h2>{CHAPTERS[9]}</h2>" in text
    assert body(text, "chapter-1").count('<svg class="plot"') == 3
    assert "▽ exactly 0" in body(text, "chapter-1")
    assert "✕ not a finite number" in body(text, "chapter-1")
    assert "Fitted orders" in body(text, "chapter-2")
    assert body(text, "chapter-4").count('src="data:image/png;base64,') == 3
    assert "The picture is missing beside the record." in body(text, "chapter-4")


def test_no_number_is_nan_or_infinite(text):
    visible = re.sub(r"<style.*?</style>|base64,[A-Za-z0-9+/=]+", "", without_code(text), flags=re.DOTALL)
    visible = visible.replace("the figure is nan", "")
    assert re.findall(r"\b(?:nan|NaN|inf|Infinity|None)\b", visible.replace("NaN, singular", "")) == []


def test_text_from_data_is_escaped_everywhere(folder):
    text = stability_page(hostile(fake_stability(), HOSTILE), folder)
    assert foreign_scripts(text) == []
    assert text.count("&lt;script&gt;") > 100
    outline = Outline(text)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)


def test_pictures_outside_of_the_folder_are_not_read(folder, tmp_path):
    inner = write_fake_stability(tmp_path / "inner")
    case = next(one for one in fake_stability().cases if one.pictures)
    paths = ["../inner/stability/whole.png", "../../etc/passwd", str(inner / "stability" / "whole.png"), "stability"]
    stray = [replace(case.pictures[0], path=path) for path in paths]
    text = stability_page(fake_stability(cases=[replace(case, pictures=stray)]), tmp_path / "outer")
    assert "data:image/png" not in without_code(text)
    assert text.count("The picture is missing") == 4


def test_an_empty_record_is_a_page_too(tmp_path):
    text = stability_page(EMPTY, tmp_path)
    outline = Outline(text)
    assert "nothing of this harness was tried" in text
    assert {"matrix", "findings", "cases", "provenance"} & set(outline.ids) == set()


def test_an_unfinished_and_a_quick_run_say_so(folder, text):
    assert "not finished" not in text
    assert "A quick run" not in text
    said = stability_page(fake_stability(with_charts=False, finished=False, settings={"quick": True}), folder)
    assert "This run was not finished." in said
    assert "17 whole cases" in said
    assert "A quick run." in said


def test_the_report_beside_it_is_linked(folder):
    assert "report.html" in Outline(stability_page(fake_stability(with_charts=False), folder, beside_report=True)).links


def test_the_section_of_the_report_shows_the_same(records, folder):
    shutil.copytree(folder / "stability", records.out / "stability")
    tried = fake_stability(with_charts=False)
    text, whole = stability_page(tried, records.out), page(records, Beside(tried))
    outline = Outline(whole)
    assert len(outline.ids) == len(set(outline.ids))
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert "stability.html" in outline.links
    assert "#stability" in outline.links
    assert "1 of 30 stability checks of this harness fails" in whole[: whole.index("<nav")]
    section = body(whole, "stability")
    for name in ("matrix", "findings", "chapter-4", "chapter-9", "cases"):
        words = seen(body(text, name)).split()
        assert " ".join(words[5:]) in " ".join(seen(section).split()), name


def test_a_report_without_stability_has_no_trace_of_it(records):
    text = page(records)
    assert "stability" not in seen(text).lower()
    assert "stability.html" not in text
    assert 'id="stability"' not in text


def test_the_page_of_a_whole_catalogue_with_pictures_stays_small(tmp_path):
    out = write_fake_stability(tmp_path)
    noise = np.random.default_rng(0).random((900, 900, 3)).astype(np.float32)
    for name in ("whole", "chunks", "difference", "gone"):
        matplotlib.image.imsave(out / "stability" / f"{name}.png", noise)
    assert len(stability_page(fake_stability(with_charts=False), out)) < 4_000_000
