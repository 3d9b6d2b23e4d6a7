"""Has anything changed? The first steps again, in another order of the sums, and with a constant changed by 1 %."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from harness.gate import early
from harness.gate.gates import WIDER
from harness.gate.references import Course, Courses, References, read_references
from tests.harness.gate import page
from tests.harness.gate.mutations import FILE, MUTATIONS, seen

ROOT = Path(__file__).parents[3]
TWO = ("nerf", "qnerf")


@pytest.fixture(scope="module")
def stored() -> References:
    return read_references(ROOT / "gates" / "classes", "avx2")


@pytest.fixture(scope="module")
def usual() -> Courses:
    return early.courses(TWO)


def test_sums_in_another_order_are_within_the_tolerance(usual: Courses, stored: References) -> None:
    for name in ("small blocks", "single operations"):
        order = early.REORDERINGS[name]
        for precision, courses in early.courses(TWO, order).items():
            size = early.largest(courses, usual[precision])
            assert size <= early.tolerance(precision, stored), (name, precision)
            if name == "small blocks":
                assert size > 0.0, "it is another order"


def test_any_class_gives_the_stored_first_steps_in_double_precision(usual: Courses, stored: References) -> None:
    """Whatever this processor is: its rounding has not grown, and nothing has changed since the renewal."""
    limit = early.tolerance("double", stored) * WIDER["changed"]
    for start, course in usual["double"].items():
        size, where = early.deviation(course, stored.courses["double"][start])
        assert size is not None
        assert size <= limit, where


def test_every_setting_of_the_profiles_is_the_stored_one(stored: References) -> None:
    assert early.profile_settings() == stored.profiles


@pytest.mark.parametrize("part", ["base φ", "learning rate", "optical depth", "background"])
def test_a_hundredth_is_found(part: str, usual: Courses, stored: References) -> None:
    key = next(mutation for mutation in MUTATIONS if mutation[1] == part)
    assert seen(usual, key, stored, ("qnerf",)).found_by


def test_deviations() -> None:
    course = Course([0.5, 0.25], {"1": [0.0, 1.0]})
    assert early.deviation(course, course)[0] == 0.0
    assert early.deviation(Course([0.5, 0.2525], course.renders), course) == (pytest.approx(0.01), "loss of step 1")
    other = Course(course.losses, {"1": [0.0, 1.02]})
    assert early.deviation(other, course) == (pytest.approx(0.02 / math.sqrt(2)), "render after step 1")
    assert early.deviation(Course([0.5], course.renders), course)[0] is None
    assert early.deviation(Course([0.5, math.nan], course.renders), course)[0] is None
    with pytest.raises(ValueError, match="not finite"):
        early.largest({"nerf": Course([0.5, math.nan], course.renders)}, {"nerf": course})


def rows() -> list[dict[str, Any]]:
    return list(json.loads(FILE.read_text(encoding="utf-8"))["rows"])


def test_the_table_is_of_these_mutations_and_few_are_missed() -> None:
    """`python -m tests.harness.gate.mutations` makes the file."""
    table = rows()
    assert [(row["part"], row["constant"], row["to"]) for row in table] == list(MUTATIONS)
    assert sum(bool(row["found_by"]) for row in table) >= max(20, len(table) - 4)


@pytest.mark.parametrize("name", ["spread", "mutations", "rank"])
def test_the_page_shows_what_was_measured(name: str) -> None:
    """`python -m tests.harness.gate.page` writes it there."""
    shown = page.between(name).search(page.PAGE.read_text(encoding="utf-8"))
    assert shown is not None
    assert page.tables()[name] in shown[0]


FULLEST = ("nerf_fine", "qnerf_stirred")
"""Starts in which most of the program takes part."""


@pytest.fixture(scope="module")
def fullest() -> Courses:
    return early.courses(FULLEST)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize("key", MUTATIONS, ids=lambda key: key[1])
def test_the_table_of_mutations_is_still_true(key: tuple[str, str, str], fullest: Courses, stored: References) -> None:
    row = next(row for row in rows() if (row["part"], row["constant"], row["to"]) == key)
    names = {f"changed.double.{start}" for start in FULLEST}
    assert names & set(seen(fullest, key, stored, FULLEST).found_by) == names & set(row["found_by"])
