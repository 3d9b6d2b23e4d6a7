"""The page of a shelf: what must pass first, every finding visible or folded, no file read from elsewhere."""

import html
import re
from typing import Any

import pytest
from msgspec.structs import replace

from harness.records.study import Answer, Check, Series, Studies, Table
from reports.data.studies_load import find_studies
from reports.studies.study_page import about, headline, sentences, shelf_shown
from reports.studies.study_page import study_page as page_of
from tests.reports.fake_studies import fake_studies, study, write_fake_studies
from tests.reports.run.test_page import Outline, without_code
from tests.reports.studies.test_checks import trial

EMPTY = {shelf: Studies(shelf, {}, {}, finished=True) for shelf in ("evidence", "stability", "speed")}


def study_page(record: Studies) -> str:
    return page_of(shelf_shown(record))


def seen(text: str) -> str:
    """Return the text that a reader sees."""
    words = re.sub(r"<style.*?</style>|<[^>]*>", " ", without_code(text), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(words))


def of(*checks: Check) -> Studies:
    return fake_studies("stability", studies=[study("Q1", "t", *checks)])


def with_findings(shelf: str, *findings: Any) -> Studies:
    return replace(EMPTY[shelf], studies=[study("one", "One", *findings, question="Why?")])


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (fake_studies("evidence", failing=True), "2 of 3 checks of the evidence hold"),
        (fake_studies("evidence"), "All 3 checks of the evidence hold"),
        (fake_studies("speed"), "3 of 7 speed targets are met, 2 without a figure"),
        (of(trial("fail", "paper")), "Numerical stability: nothing of this harness was tried"),
        (of(trial()), "The one stability check of this harness passes"),
        (of(trial(), trial("fail")), "1 of 2 stability checks of this harness passes"),
        (of(trial(), trial("inconclusive")), "1 of 2 stability checks of this harness passes, 1 inconclusive"),
        (EMPTY["evidence"], "Evidence without a check"),
    ],
)
def test_the_headline_counts_what_must_pass(record, said):
    assert headline(record) == said


def test_the_sentences_state_what_is_open_and_what_is_a_property():
    said = sentences(of(trial(), trial("inconclusive"), trial("fail", "paper"), trial("not_available", value=None)))
    assert said[0] == "1 case with 4 checks and 1 subject."
    assert said[1:] == [
        "Inconclusive: 1 check; each says why.",
        "The paper’s forms as printed fail 1 of 1 checks; these are properties of those forms, not failures.",
        "Not tried: 1 not available here; each says why.",
    ]
    machine = "on AMD EPYC 9R14 with 2 cores and 2 threads, with units for bfloat16 matrix multiplications"
    assert machine in sentences(fake_studies("speed"))[0]


@pytest.mark.parametrize("shelf", EMPTY)
def test_an_empty_record_is_a_page_and_a_study_without_anything_too(shelf):
    assert {"matrix", "stability-outcomes"}.isdisjoint(Outline(study_page(EMPTY[shelf])).ids)
    assert "Why?" in study_page(with_findings("evidence"))


def test_quick_unfinished_and_broken_records_are_announced_first():
    assert 'class="alert"' not in study_page(fake_studies("evidence", charts=False))
    broken = fake_studies("evidence", failing=True, charts=False, finished=False, settings={"quick": True})
    text = study_page(broken)
    for said in ("A quick run.", "This run was not finished.", "Our own code must pass, and 1 check does not."):
        assert said in text[: text.index("<main>")]


def test_every_check_is_in_the_details_with_its_reason():
    record = fake_studies("stability", failing=True, charts=False)
    text = study_page(record)
    for study_of in record.studies:
        start = text.index(f'<details class="study" id="study-{study_of.info.id}"')
        own = seen(text[start : text.index("</details>", start)])
        for words in study_of.info.facts.values():
            assert words in own, words
        for check in study_of.checks:
            for words in filter(None, (check.subject, check.what, check.why)):
                assert words in own, (study_of.info.id, words)


def test_a_few_findings_are_visible_and_the_others_folded():
    findings = [Answer(f"Finding {place}.") for place in range(9)]
    said = seen(study_page(with_findings("evidence", *findings)))
    assert said.index("Finding 4.") < said.index("4 more findings") < said.index("Finding 5.")


def test_lines_stand_in_their_study_or_where_a_shelf_has_them_in_chapters():
    line = Series("p", 1, "a", "x", "y", [1.0, 2.0], [1.0, 2.0])
    shown = {shelf: shelf_shown(with_findings(shelf, line)) for shelf in EMPTY}
    titles = {
        shelf: [part.title for part in made.sections if 'class="plot"' in "".join(part.parts) and part.name != "matrix"]
        for shelf, made in shown.items()
    }
    assert titles == {"evidence": ["One"], "stability": ["Rounding: error against optical depth"], "speed": ["One"]}


def test_a_table_of_numbers_is_set_to_the_right_and_a_gap_is_a_dash():
    table = Table("t", 2, "T", ["part", "ms", "note"], [["a", 1.234, None], ["b", 2, "x"]])
    text = study_page(with_findings("speed", table))
    assert '<td class="" data-value="1.234">1.23</td>' in text
    assert '<td class="muted words">–</td>' in text


def test_a_record_comes_back_as_it_was_written_but_for_what_is_not_finite(tmp_path):
    record = fake_studies("stability")
    read = find_studies(write_fake_studies(tmp_path, record), "stability")
    assert [check for _, check in read.checks()] == [check for _, check in record.checks()]
    lost = [line for study_of in read.studies for line in study_of.series if None in line.y]
    assert [(line.name, line.y[:2]) for line in lost] == [("log_space", [None, None])]
    assert read.studies[1].tables[0].rows[0][2] == "not finite (nan)"
    assert find_studies(tmp_path / "stability", "stability") is None


def test_the_answer_of_a_study_is_its_heading_and_the_scale_says_once_what_runs_share():
    record = with_findings("evidence", Answer("It is 3."), Answer("More."))
    text = study_page(record)
    assert "<h2>It is 3.</h2>" in text
    assert text.count("It is 3.") == 1
    scaled = replace(record.studies[0], scale="lego; 4 s; 8 px | lego; 15 s; 8 px")
    assert dict(about(scaled))["scale"] == "lego; 4 s, 15 s; 8 px"
    assert dict(about(replace(scaled, scale="lego; 4 s | lego")))["scale"] == "lego; 4 s | lego"


def test_the_matrix_as_marks_comes_first_with_one_legend():
    record = fake_studies("stability", failing=True, charts=False)
    text = study_page(record)
    main = text[text.index("<main>") :]
    assert main.index('class="scroll glance"') < main.index("<details")
    assert text.count('class="marks"') == 1
    marks = re.findall(r'class="([a-z]+) mark" title', text)
    tried = {(study_of.info.id, check.owner, check.subject) for study_of, check in record.checks()}
    assert len(marks) == len(tried), "a mark per case, owner of the form and subject"
