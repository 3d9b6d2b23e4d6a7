"""Sign and size of a difference, their phrase, and records with one of the former verdicts."""

from pathlib import Path
from typing import Any

import pytest

from harness.records.former.four_words import in_two_words
from harness.records.verdict import OPEN, Sign, Size, Verdict, verdict_of

FORMER = Path(__file__).parents[2] / "former"
PUBLISHED = Path(__file__).parents[3] / "docs" / "reduced" / "summary.json"
SMALLER: Size = "smaller than matters"


@pytest.mark.parametrize(
    ("interval", "sign", "size", "phrase"),
    [
        ((0.3, 0.9), "above 0", "matters", "above 0, matters"),
        ((0.01, 0.9), "above 0", "open", "above 0, size open"),
        ((0.05, 0.15), "above 0", SMALLER, "above 0, smaller than matters"),
        ((-0.15, -0.05), "below 0", SMALLER, "below 0, smaller than matters"),
        ((-0.1, 0.15), "open", SMALLER, "sign open, smaller than matters"),
        ((0.0, 0.0), "open", SMALLER, "sign open, smaller than matters"),
        ((0.0, 0.5), "open", "open", "sign and size open"),
        ((-0.2, 0.1), "open", "open", "sign and size open"),
        ((0.2, 0.4), "above 0", "open", "above 0, size open"),
        (None, "open", "open", "sign and size open"),
    ],
)
def test_an_interval_answers_both(interval: tuple[float, float] | None, sign: Sign, size: Size, phrase: str) -> None:
    found = verdict_of(interval, 0.2)
    assert (found, found.phrase) == (Verdict(sign, size), phrase)
    turned = interval and (-interval[1], -interval[0])
    assert verdict_of(turned, 0.2) == found.turned


def test_without_a_margin_no_size_is_asked_about() -> None:
    assert verdict_of((0.3, 0.9), 0.0) == Verdict("above 0", "open")


def row(word: str, interval: tuple[float, float] | None, **more: Any) -> dict[str, Any]:
    return {"interval": interval, "simultaneous": interval, "verdict": word, "smallest_detectable": 0.1, **more}


@pytest.mark.parametrize(
    ("former", "expected"),
    [
        (row("better", (0.01, 0.9), metric="psnr"), Verdict("above 0", "open")),
        (row("worse", (0.01, 0.03), metric="flip"), Verdict("above 0", "matters")),
        (row("equivalent", (0.01, 0.03), metric="psnr"), Verdict("above 0", SMALLER)),
        ({**row("better", (0.1, 0.2), metric="psnr"), "simultaneous": None}, Verdict("above 0", "open")),
        (row("equivalent", (-4.0, 4.0), saving=0.1), Verdict("open", SMALLER)),
        (row("better", None, saving=40.0), Verdict("above 0", "open")),
        # two seeds of a scene have an interval, and no verdict
        (row("inconclusive", (0.3, 0.9), metric="psnr"), OPEN),
    ],
)
def test_a_former_word_is_read_from_its_interval(former: dict[str, Any], expected: Verdict) -> None:
    assert Verdict(**in_two_words(former)["verdict"]) == expected


def test_a_former_estimate_has_the_margin_of_what_it_is_part_of() -> None:
    inner = row("better", (0.01, 0.03))
    data = in_two_words({"metric": "psnr", "margin": 0.005, "given": {"pairs": [{"scenes_like_these": inner}]}})
    assert data["given"]["pairs"][0]["scenes_like_these"]["verdict"] == {"sign": "above 0", "size": "matters"}
    assert in_two_words({"metric": "psnr", "on_these_scenes": inner})["on_these_scenes"]["verdict"]["size"] == SMALLER


@pytest.mark.parametrize("verdict", [{"sign": "open", "size": "open"}, "seen", "within its bound", "inconclusive"])
def test_verdicts_of_this_version_and_of_other_vocabularies_stay(verdict: Any) -> None:
    """A claim or an omission may be inconclusive too, but has no smallest detectable difference."""
    claim = {"verdict": verdict, "interval": [0.1, 0.2]}
    assert in_two_words([claim]) == [claim]


@pytest.mark.parametrize("pair", ["ab", [1.0], [None, 1.0], {"low": 0.0}, 3, [True, 2.0]])
def test_a_former_word_behind_no_interval_is_left_to_the_reader_to_refuse(pair: Any) -> None:
    former = {**row("better", None, metric="psnr"), "simultaneous": pair}
    assert in_two_words(former)["verdict"] == "better"
