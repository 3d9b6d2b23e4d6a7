"""The first steps: repeated, with another order of sums, and with a constant changed by 1 %."""

import json
import math
from typing import Any

import pytest
from torch import Tensor

from baselines import field
from harness.gate import early
from harness.gate.gates import TOLERANCES
from harness.gate.references import Course, Courses, References
from tests.harness.gate import page
from tests.harness.gate.mutations import FILE, MUTATIONS, seen

TWO = ("nerf", "qnerf")


@pytest.fixture(scope="module")
def usual() -> Courses:
    return early.courses(TWO)


def farthest(here: Courses, there: Courses, precision: str) -> float:
    sizes = [early.deviation(course, there[precision][start])[0] for start, course in here[precision].items()]
    return max(math.inf if size is None else size for size in sizes)


def in_halves(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """Compute `torch.nn.functional.linear` as two sums."""
    middle = x.shape[-1] // 2
    total = x[..., :middle] @ weight[:, :middle].T + x[..., middle:] @ weight[:, middle:].T
    return total if bias is None else total + bias


@pytest.mark.slow
def test_sums_in_another_order_are_within_tolerance(usual: Courses, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(field, "linear", in_halves)
    for precision, courses in (reordered := early.courses(TWO)).items():
        assert farthest(reordered, usual, precision) <= TOLERANCES[precision] / 8, precision
        assert courses.keys() == set(TWO)
    assert farthest(reordered, usual, "single") > 0.0, "it is another order"


def test_every_processor_gives_the_stored_first_steps_of_the_stored_settings(
    usual: Courses, stored: References
) -> None:
    assert early.profile_settings() == stored.profiles
    for precision, tolerance in TOLERANCES.items():
        assert farthest(usual, stored.courses, precision) <= tolerance, precision


@pytest.mark.slow
@pytest.mark.parametrize("part", ["base φ", "learning rate", "optical depth", "background"])
def test_a_hundredth_is_found(part: str, usual: Courses) -> None:
    key = next(mutation for mutation in MUTATIONS if mutation[1] == part)
    assert seen(usual, key, ("qnerf",)).found_by


def test_deviations() -> None:
    course = Course([0.5, 0.25], {"1": [0.0, 1.0]})
    assert early.deviation(course, course)[0] == 0.0
    assert early.deviation(Course([0.5, 0.2525], course.renders), course) == (pytest.approx(0.01), "loss of step 1")
    other = Course(course.losses, {"1": [0.0, 1.02]})
    assert early.deviation(other, course) == (pytest.approx(0.02 / math.sqrt(2)), "render after step 1")
    assert early.deviation(Course([0.5], course.renders), course)[0] is None
    assert early.deviation(Course([0.5, math.nan], course.renders), course)[0] is None


def rows() -> list[dict[str, Any]]:
    return list(json.loads(FILE.read_text(encoding="utf-8"))["rows"])


def test_the_table_is_of_these_mutations_and_few_are_missed() -> None:
    """`python -m tests.harness.gate.mutations` makes the file."""
    table = rows()
    assert [(row["part"], row["constant"], row["to"]) for row in table] == list(MUTATIONS)
    assert sum(bool(row["found_by"]) for row in table) >= max(20, len(table) - 4)


@pytest.mark.parametrize("name", ["spread", "renewal", "mutations"])
def test_the_page_shows_what_was_measured(name: str) -> None:
    """`python -m tests.harness.gate.page` writes it."""
    shown = page.between(name).search(page.PAGE.read_text(encoding="utf-8"))
    assert page.tables()[name] in shown[0]


FULLEST = ("nerf_fine", "qnerf_stirred")
"""The starts that use most of the program."""


@pytest.fixture(scope="module")
def fullest() -> Courses:
    return early.courses(FULLEST)


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize("key", MUTATIONS, ids=lambda key: key[1])
def test_the_table_of_mutations_is_still_true(key: tuple[str, str, str], fullest: Courses) -> None:
    row = next(row for row in rows() if (row["part"], row["constant"], row["to"]) == key)
    names = {f"changed.double.{start}" for start in FULLEST}
    assert names & set(seen(fullest, key, FULLEST).found_by) == names & set(row["found_by"])
