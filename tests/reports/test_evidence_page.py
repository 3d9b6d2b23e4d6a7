"""evidence.html: the checks first, every effect in sight or folded, nothing fetched, all escaped."""

import html
import re
from dataclasses import replace

import pytest

from harness.chart_record import Series, Table
from harness.evidence_record import Check, Effect, EvidenceRecord, StudyInfo, StudyRecord
from reports.effects_plot import Axis, Mark, axis_of, family_said, forests
from reports.evidence_page import evidence_page
from reports.evidence_view import check_said, checks_grid, headline, of_interest, plain, sentences, wanted
from tests.reports.fake_evidence import INTEREST, fake_evidence
from tests.reports.test_page import HOSTILE, Outline, foreign_scripts, without_code

EMPTY = EvidenceRecord({}, {}, finished=True)
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


def study_of(text: str, name: str) -> str:
    start = text.index(f'id="study-{name}"')
    return text[start : text.index("</article>", start)]


def test_the_page_is_well_formed_and_its_links_lead_somewhere(text):
    outline = Outline(text)
    assert len(outline.ids) == len(set(outline.ids))
    links = {link[1:] for link in outline.links if link.startswith("#")}
    assert links <= set(outline.ids)
    assert {"study-calibration", "study-factorial", "provenance"} <= links


def test_nothing_is_fetched(text):
    outline = Outline(text)
    assert [link for link in outline.links if not link.startswith(("#", "data:"))] == []
    assert re.findall(r"url\(\s*[\"']?(?!#)", text) == []
    assert foreign_scripts(text) == []


def test_what_does_not_hold_is_said_on_top_and_stands_first_in_its_table(text):
    top = seen(text[: text.index("<nav")])
    assert "1 of 3 checks of the evidence does not hold" in top
    assert "share of real A/A comparisons that are called better or worse: 0.0810, wanted ≤ 0.05" in top
    grid = checks_grid(fake_evidence().studies[0].checks)
    assert [row[3].text for row in grid.rows] == ["✕ does not hold", "✓ holds", "✓ holds"]


def test_nothing_alarms_where_everything_holds():
    text = evidence_page(fake_evidence(with_failure=False, with_charts=False))
    assert "All 3 checks of the evidence hold" in seen(text)
    assert 'class="alert"' not in text


def test_a_study_gives_its_question_its_answer_and_how_it_was_done(text):
    said = seen(study_of(text, "calibration"))
    for words in ("How often does it see", "Where there is no difference it sees one in 2.4 %", "8 scenes × 3 seeds",
                  "6 seeds; 300 steps", "drawn from the spreads", "Power: how often", "Spread between seeds",
                  "3 min 23 s", "of 4000, drawn from the spread"):  # fmt: skip
        assert words in said, words


def test_forests_show_all_scenes_first_and_fold_the_rest(text):
    body = study_of(text, "factorial")
    assert seen(body).index("all scenes") < seen(body).index("More: lego; ficus; hotdog")
    assert body.count('<table class="forest"') == 5, "two budgets, each with its scenes folded; SSIM"
    assert "PSNR at equal steps (dB)" in seen(body)
    assert "+0.89 [+0.77, +1.02] better" in seen(body)
    assert "2 pairs not judged" in seen(body)
    assert "±0.2" in seen(body)


def test_every_effect_stands_in_the_table_in_full(text):
    body = study_of(text, "factorial")
    assert "Every effect: 121 comparisons" in seen(body)
    assert seen(body[body.index("Every effect") :]).count("equal training time") == 57
    assert "qnerf nerf lego PSNR equal training time – – – 28 – 0 3 inconclusive" in seen(body)


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


def test_metrics_and_budgets_have_a_forest_each():
    effects = [
        an_effect(0.1, metric=metric, budget=budget) for metric in ("psnr", "own") for budget in ("seconds", "steps")
    ]
    assert [one.title for one in forests(effects, {})] == [
        "PSNR at equal training time",
        "PSNR at equal steps",
        "own at equal training time",
        "own at equal steps",
    ]


@pytest.mark.parametrize(
    ("check", "said"),
    [
        (Check("a", 0.031, high=0.05), "a: 0.0310, wanted ≤ 0.05"),
        (Check("a", 0.05004, high=0.05), "a: 0.05004, wanted ≤ 0.05"),
        (Check("a", 1.5, low=0.5, high=2.5, unit="dB", why="so"), "a: 1.50 dB, wanted 0.5 … 2.5 dB (so)"),
        (Check("a", None, low=80, unit="%"), "a: no figure, wanted ≥ 80 %"),
        (Check("a", 3.0), "a: 3"),
    ],
)
def test_checks_in_words(check, said):
    assert check_said(check).replace("\u202f", " ") == said


def test_limits_are_said_without_digits_that_nobody_asked_for():
    assert [plain(one) for one in (0.05, 30.0, 0.0, 1.0, 1e-6)] == ["0.05", "30", "0", "1", "10⁻⁶"]
    assert wanted(Check("a", 1.0, low=0.0)) == "≥ 0"


def test_the_headline_counts():
    assert headline(EMPTY) == "Evidence: 0 studies, without a check"
    one = StudyRecord(INFO, checks=[Check("a", 1.0, high=2.0)])
    assert headline(replace(EMPTY, studies=[one])) == "The one check of the evidence holds"
    assert sentences(EMPTY) == ["No study is whole."]


def test_an_empty_record_and_a_study_without_anything_have_a_page():
    assert "without a check" in evidence_page(EMPTY)
    assert "It gave no answer in words." in seen(evidence_page(replace(EMPTY, studies=[StudyRecord(INFO)])))


def test_unfinished_and_quick_studies_are_called_so():
    text = seen(evidence_page(replace(fake_evidence(with_charts=False), finished=False, settings={"quick": True})))
    assert "These studies were not finished. 4 are whole" in text
    assert "Quick studies." in text


def test_the_smallest_effects_of_interest_are_those_of_the_record():
    assert of_interest(fake_evidence()) == INTEREST
    assert of_interest(EMPTY) == {}


def test_hostile_words_stay_words():
    study = StudyRecord(
        StudyInfo(HOSTILE, HOSTILE, HOSTILE, HOSTILE),
        HOSTILE,
        [HOSTILE, HOSTILE],
        [Check(HOSTILE, None, unit=HOSTILE, why=HOSTILE)],
        [
            an_effect(
                0.1, (0.0, 0.2), (-0.1, 0.3), name=HOSTILE, against=HOSTILE, scene=HOSTILE, metric=HOSTILE, note=HOSTILE
            )
        ],
        [Series(HOSTILE, 0, HOSTILE, HOSTILE, HOSTILE, [1.0, 2.0], [1.0, 2.0])],
        [Table(HOSTILE, 0, HOSTILE, [HOSTILE], [[HOSTILE]])],
    )
    clean, hostile = (Outline(evidence_page(replace(EMPTY, studies=[one]))) for one in (StudyRecord(INFO), study))
    drawn = "svg g path text use defs clippath rect table caption thead tbody tfoot tr th td i span figure figcaption"
    drawn += " details summary small wbr b ul li div script"
    assert set(hostile.tags) - set(clean.tags) <= set(drawn.split())
    assert foreign_scripts(evidence_page(replace(EMPTY, studies=[study]))) == []


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
        replace(EMPTY, studies=[StudyRecord(INFO, findings=[f"Finding {place}." for place in range(9)])])
    )
    said = seen(text)
    assert said.index("Finding 4.") < said.index("4 more findings") < said.index("Finding 5.")
