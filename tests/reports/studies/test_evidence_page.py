"""evidence.html: the checks first, every effect in sight or folded, nothing fetched, all escaped."""

import html
import re

import pytest
from msgspec.structs import replace

from harness.records.study import Answer, Effect, Series, Studies, StudyInfo, StudyRecord, Table, check
from reports.studies.effects_plot import Axis, Mark, axis_of, family_said, forests
from reports.studies.evidence_page import check_said, evidence_page, of_interest
from tests.reports.fake_evidence import INTEREST, fake_evidence, study
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts, without_code

EMPTY = Studies("evidence", {}, {}, finished=True)
INFO = StudyInfo("one", "One", "Why?", "So.")


def an_effect(difference: float | None, alone=None, together=None, **more) -> Effect:
    parts = {"scene": "all", "metric": "psnr", "budget": "steps", "family": 8, "verdict": "inconclusive"}
    parts |= {"name": "part", "against": "", "smallest_detectable": 0.4, "pairs": 9, "unpaired": 0, **more}
    return Effect(difference=difference, interval=alone, simultaneous=together, **parts)


@pytest.fixture(scope="module")
def text() -> str:
    return evidence_page(fake_evidence())


def seen(text: str) -> str:
    """What a reader reads."""
    words = re.sub(r"<style.*?</style>|<[^>]*>", " ", without_code(text), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(words))


def test_nothing_alarms_where_everything_holds():
    text = evidence_page(fake_evidence(with_failure=False, with_charts=False))
    assert "All 3 checks of the evidence hold" in seen(text)
    assert 'class="alert"' not in text


@pytest.mark.parametrize(
    ("pair", "mark"),
    [
        (None, None),
        ((-0.5, 0.5), Mark(25.0, 75.0, False, False)),
        ((-9.0, 0.0), Mark(0.0, 50.0, True, False)),
        ((0.0, 9.0), Mark(50.0, 100.0, False, True)),
        ((2.0, 9.0), None),
    ],
)
def test_intervals_end_at_the_edge_of_the_axis_and_say_so(pair, mark):
    assert Axis(-1.0, 1.0).mark(pair) == mark


def test_an_axis_holds_zero_every_difference_and_the_band_but_no_monstrous_interval():
    effects = [an_effect(0.3, (-90.0, 90.0), (-900.0, 900.0)), an_effect(-1.0, (-1.1, -0.9), (-1.2, -0.8))]
    axis = axis_of(effects, 0.2)
    assert axis.low < -1.0 < 0.0 < 0.3 < axis.high
    assert axis.low > -2.0
    assert axis.high < 1.0
    for few in ([], [an_effect(None)], [an_effect(0.0, (0.0, 0.0))]):
        assert axis_of(few, 0.0).low < 0.0 < axis_of(few, 0.0).high


def test_an_interval_of_survivors_alone_is_drawn_even_far_from_the_others():
    forest = forests([an_effect(0.3, (0.1, 0.5), (-0.2, 0.8))], INTEREST)[0]
    (row,) = forest.groups[0].rows
    assert row.dot is not None
    assert row.alone is not None
    assert row.together is not None
    assert row.together.start < row.alone.start < row.dot < row.alone.end < row.together.end
    assert forest.band is not None
    assert forest.band.start < forest.zero < forest.band.end


def test_a_difference_without_an_interval_is_a_dot_and_none_at_all_is_a_row():
    first, second = forests([an_effect(0.3), an_effect(None)], {})[0].groups[0].rows
    assert (first.alone, first.figures.small) == (None, "")
    assert first.dot is not None
    assert (second.dot, second.figures.text) == (None, "–")


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (check("a", 0.031, high=0.05), "a: 0.0310, wanted ≤ 0.05"),
        (check("a", 0.05004, high=0.05), "a: 0.05004, wanted ≤ 0.05"),
        (check("a", 1.5, low=0.5, high=2.5, unit="dB", why="so"), "a: 1.50 dB, wanted 0.5 … 2.5 dB (so)"),
        (check("a", None, low=80, unit="%"), "a: no figure, wanted ≥ 80 %"),
        (check("a", 3.0), "a: 3"),
    ],
)
def test_checks_in_words(found, said):
    assert check_said(found).replace("\u202f", " ") == said


def test_an_empty_record_and_a_study_without_anything_have_a_page():
    assert "without a check" in evidence_page(EMPTY)
    assert "It gave no answer in words." in seen(evidence_page(replace(EMPTY, studies=[StudyRecord(INFO)])))


def test_the_smallest_effects_of_interest_are_those_of_the_record():
    assert of_interest(fake_evidence()) == INTEREST
    assert of_interest(EMPTY) == {}


def test_hostile_words_stay_words():
    hostile_study = study(
        StudyInfo(HOSTILE, HOSTILE, HOSTILE, HOSTILE),
        HOSTILE,
        [HOSTILE, HOSTILE],
        [check(HOSTILE, None, unit=HOSTILE, why=HOSTILE)],
        [
            an_effect(
                0.1, (0.0, 0.2), (-0.1, 0.3), name=HOSTILE, against=HOSTILE, scene=HOSTILE, metric=HOSTILE, note=HOSTILE
            )
        ],
        [Series(HOSTILE, 0, HOSTILE, HOSTILE, HOSTILE, [1.0, 2.0], [1.0, 2.0])],
        [Table(HOSTILE, 0, HOSTILE, [HOSTILE], [[HOSTILE]])],
    )
    clean, hostile = (
        Outline(evidence_page(replace(EMPTY, studies=[one]))) for one in (StudyRecord(INFO), hostile_study)
    )
    drawn = "svg g path text use defs clippath rect table caption thead tbody tfoot tr th td i span figure figcaption"
    drawn += " details summary small wbr b ul li div script"
    assert set(hostile.tags) - set(clean.tags) <= set(drawn.split())
    assert foreign_scripts(evidence_page(replace(EMPTY, studies=[hostile_study]))) == []


def test_parts_stand_apart_from_methods_and_what_is_too_much_is_folded():
    parts = [an_effect(0.1, name=f"part {place}", scene=scene) for scene in ("lego", "all") for place in range(10)]
    methods = [an_effect(0.1, name="qnerf", against="nerf", scene="all") for _ in range(7)]
    (forest,) = forests([*parts, *methods], {})
    assert [group.scene for group in forest.groups] == ["all scenes"]
    assert [group.scene for group in forest.folded] == ["all scenes, method against method", "lego"]


def test_families_are_said_as_they_are():
    assert family_said([1]) == "each comparison stands for itself"
    assert family_said([12]) == "all of a family of 12 comparisons hold together in 95 % of repetitions"
    assert family_said([1, 12]) == "all of a family of 1 to 12 comparisons hold together in 95 % of repetitions"


def test_a_few_findings_are_in_sight_and_the_others_unfold():
    text = evidence_page(
        replace(EMPTY, studies=[StudyRecord(INFO, findings=[Answer(f"Finding {place}.") for place in range(9)])])
    )
    said = seen(text)
    assert said.index("Finding 4.") < said.index("4 more findings") < said.index("Finding 5.")
