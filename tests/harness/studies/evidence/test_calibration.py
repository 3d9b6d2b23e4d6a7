"""The intervals' calibration, and that it turns red for intervals that are too narrow or too wide."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import nct

from harness.records.study import Check, Series, Table
from harness.studies.evidence import calibration as study
from harness.studies.evidence.calibration import ELSEWHERE, HERE, ONE_SCENE, POWER, calibration, checks, simulated
from harness.verdicts import nested
from harness.verdicts.statistics import on_one_scene, on_these_scenes, scenes_like_these
from tests.harness.studies.evidence.planted import situation

COUNT = 1000
ESTIMATES = ("on_these_scenes", "scenes_like_these", "on_each_scene")


def few_kinds() -> list[Check]:
    """Of a corner of the grid."""
    grid = [simulated(noise, 8, 3, 0.2, COUNT) for noise in study.NOISE]
    return list(checks(grid, simulated("normal", 8, 3, study.PUBLISHED, COUNT), COUNT))


def failed(found: list[Check]) -> set[str]:
    return {check.what for check in found if not check.holds}


@pytest.mark.parametrize(
    ("factor", "failures", "below", "above"), [(1.0, 0, 1.0, 0.0), (0.3, 6, 0.8, 0.0), (3.0, 8, 1.0, 0.98)]
)
def test_intervals_of_another_width_are_seen(
    factor: float, failures: int, above: float, below: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three times as wide: coverage of all three from above, and the power that is lost."""
    for name in ESTIMATES:
        usual = getattr(nested, name)
        monkeypatch.setattr(
            nested, name, lambda values, usual=usual: replace(made := usual(values), error=factor * made.error)
        )
    found = few_kinds()
    assert len(failed(found)) == failures
    assert all(check.value is not None and above < check.value <= below for check in found if "intervals" in check.what)


def test_many_at_once_are_what_one_is() -> None:
    """The simulated intervals are those that are printed."""
    values = np.random.default_rng(0).normal(0, 0.2, (3, 5, 4))
    values[1, 2, 3] = values[2, 4, 1:] = np.nan
    for many, single in ((nested.on_these_scenes, on_these_scenes), (nested.scenes_like_these, scenes_like_these)):
        halves = study.half_widths(many(values))
        for place, rows in enumerate(values):
            interval = single({str(scene): row for scene, row in enumerate(rows)}).interval
            assert interval is not None
            assert halves[place] == pytest.approx((interval[1] - interval[0]) / 2)
    halves = study.half_widths(nested.on_each_scene(values))
    for place, rows in enumerate(values):
        for scene in range(5):
            interval = on_one_scene({str(scene): row for scene, row in enumerate(rows)}, str(scene)).interval
            assert interval is not None
            assert halves[place, scene] == pytest.approx((interval[1] - interval[0]) / 2)


def test_power_is_that_of_the_noncentral_t_distribution() -> None:
    found = simulated("normal", 8, 3, study.PUBLISHED, 20_000).power[ELSEWHERE]
    error = ((study.PUBLISHED**2 + study.PAIR_SD**2 / 3) / 8) ** 0.5
    for effect in POWER:
        assert found[effect] == pytest.approx(nct.sf(2.364624, 7, effect / error), abs=0.012)


def test_the_interval_on_these_scenes_does_not_answer_for_others() -> None:
    point = simulated("normal", 8, 3, 0.6, COUNT)
    assert point.coverage[HERE] == pytest.approx(0.95, abs=0.02)
    assert point.coverage[study.ASKED_WRONGLY] < 0.5


def test_a_collapse_that_nobody_sees_breaks_what_one_that_is_counted_does_not() -> None:
    seen, unseen = (simulated(noise, 16, 3, 0.0, COUNT).coverage for noise in list(study.NOISE)[2:])
    for kind in (HERE, ELSEWHERE, ONE_SCENE):
        assert seen[kind] == pytest.approx(0.95, abs=0.025)
    assert unseen[HERE] < 0.90
    assert unseen[ELSEWHERE] < 0.90


def test_the_study_tells_what_it_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "SCENES", (4, 8))
    monkeypatch.setattr(study, "SEEDS", (3,))
    found: list[Any] = list(calibration(replace(situation(Path(), {}), quick=True)))
    sentences = [finding for finding in found if isinstance(finding, str)]
    assert sentences[0].startswith("An interval of 95 % holds the truth in 9")
    (table,) = (finding for finding in found if isinstance(finding, Table))
    assert len(table.rows) == 1 + 4 * 2 * 3
    assert {len(row) for row in table.rows} == {len(table.columns)}
    assert {finding.name for finding in found if isinstance(finding, Series)} == {HERE, ELSEWHERE}
