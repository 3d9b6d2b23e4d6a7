"""stability.html and the section of the report: ours first, every finding in sight, nothing fetched, all escaped."""

import html
import re

import matplotlib.image
import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.study import Studies
from reports.run.run_page import page
from reports.studies.stability_page import stability_page
from tests.reports.fake_stability import fake_stability, write_fake_stability
from tests.reports.run.test_page import Outline, without_code

EMPTY = Studies("stability", {}, {}, finished=True)


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


def test_every_outcome_is_in_the_details_with_its_reason(text):
    cases = body(text, "cases")
    for case in fake_stability().studies:
        start = cases.index(f'<div id="case-{case.info.id}">')
        own = seen(cases[start : cases.index("</details>", start)])
        for words in case.info.facts.values():
            assert words in own, words
        for one in case.checks:
            for words in filter(None, (one.subject, one.what, one.why)):
                assert words in own, (case.info.id, words)


def test_pictures_outside_of_the_folder_are_not_read(folder, tmp_path):
    inner = write_fake_stability(tmp_path / "inner")
    case = next(one for one in fake_stability().studies if one.pictures)
    paths = ["../inner/stability/whole.png", "../../etc/passwd", str(inner / "stability" / "whole.png"), "stability"]
    stray = [replace(case.pictures[0], path=path) for path in paths]
    text = stability_page(fake_stability(studies=[replace(case, findings=stray)]), tmp_path / "outer")
    assert "data:image/png" not in without_code(text)
    assert text.count("The picture is missing") == 4


def test_an_empty_record_is_a_page_too(tmp_path):
    text = stability_page(EMPTY, tmp_path)
    outline = Outline(text)
    assert "nothing of this harness was tried" in text
    assert {"matrix", "findings", "cases", "provenance"} & set(outline.ids) == set()


def test_the_report_beside_it_is_linked(folder):
    assert "report.html" in Outline(stability_page(fake_stability(with_charts=False), folder, beside_report=True)).links


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
