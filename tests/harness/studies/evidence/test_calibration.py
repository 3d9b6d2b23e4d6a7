"""The intervals' calibration, which fails for intervals that are too narrow or too wide."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import nct

from harness.records.study import Check
from harness.studies.evidence import calibration as study
from harness.studies.evidence.calibration import ALONE, ELSEWHERE, HERE, ROBUST, calibration, simulate
from harness.verdicts.estimates import nested
from harness.verdicts.statistics import critical, on_one_scene, on_these_scenes, scenes_like_these
from tests.harness.patching import changed
from tests.harness.studies.evidence.planted import context_of, lines, sentences, table

COUNT = 1000
SCATTER = study.Scatter("planted", 0.12, (0.04, 0.07, 0.1, 0.3))


def checks_of_a_small_grid() -> list[Check]:
    grid = [simulate(noise, 8, 3, 0.2, SCATTER, COUNT) for noise in study.NOISE]
    default, bad = (simulate(noise, 8, 3, 0.12, SCATTER, COUNT) for noise in ("unequal scenes", study.ONE_BAD))
    return list(study.checks(study.Simulated(SCATTER, COUNT, grid, default, bad, {}, {})))


@pytest.mark.parametrize(("factor", "failures"), [(1.0, 0), (0.5, 12), (3.0, 12)])
def test_intervals_of_another_width_are_seen(factor: float, failures: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Six kinds of interval fail at both limits."""
    for name in ("on_these_scenes", "scenes_like_these"):
        changed(monkeypatch, nested, name, lambda made, _: replace(made, error=factor * made.error))
    failed = {check.what for check in checks_of_a_small_grid() if not check.holds and "intervals" in check.what}
    assert len(failed) == failures, failed
    assert not [what for what in failed if ROBUST in what]


def test_many_at_once_are_what_one_is() -> None:
    """The simulated intervals are those that are printed."""
    values = np.random.default_rng(0).normal(0, 0.2, (3, 5, 4))
    values[1, 2, 3] = values[2, 4, 2:] = np.nan
    cases = [
        (study.half_widths(many(values))[place], single({str(scene): row for scene, row in enumerate(rows)}))
        for many, single in ((nested.on_these_scenes, on_these_scenes), (nested.scenes_like_these, scenes_like_these))
        for place, rows in enumerate(values)
    ]
    halves = study.half_widths(nested.scenes_like_these(values[..., None]))
    cases += [(halves[place], on_one_scene(values[place])) for place in np.ndindex(halves.shape)]
    assert len(cases) == 2 * 3 + 3 * 5
    for half, difference in cases:
        assert difference.interval is not None
        assert half == pytest.approx((difference.interval[1] - difference.interval[0]) / 2)


def test_power_is_that_of_the_noncentral_t_distribution() -> None:
    results = simulate("equal scenes", 8, 3, 0.12, SCATTER, 20_000).power
    error = ((0.12**2 + SCATTER.pooled**2 / 3) / 8) ** 0.5
    for effect in study.POWER:
        assert results[ALONE][effect] == pytest.approx(nct.sf(2.364624, 7, effect / error), abs=0.012)
        assert results[ELSEWHERE][effect] == pytest.approx(
            nct.sf(critical(7, study.HEADLINE), 7, effect / error), abs=0.012
        )


def test_the_interval_on_these_scenes_does_not_answer_for_others() -> None:
    point = simulate("equal scenes", 8, 3, 0.6, SCATTER, COUNT)
    assert point.coverage[HERE] == pytest.approx(0.95, abs=0.02)
    assert point.coverage[study.ASKED_WRONGLY] < 0.6


def test_one_bad_cell_hides_an_effect_from_means_and_not_from_the_robust_estimate() -> None:
    usual, bad = (simulate(noise, 8, 3, 0.12, SCATTER, COUNT) for noise in ("unequal scenes", study.ONE_BAD))
    assert usual.power[ALONE][0.3] > 0.9
    assert bad.power[ALONE][0.3] < 0.1
    assert min(usual.power[ROBUST][0.3], bad.power[ROBUST][0.3]) > 0.85
    assert bad.coverage[ROBUST] == pytest.approx(0.955, abs=0.02)
    assert ROBUST not in simulate("equal scenes", 4, 3, 0.12, SCATTER, 10).coverage, "below six scenes there is none"


def test_families_of_five_per_cent_err_in_five_per_cent() -> None:
    """Pooled variances claimed a sign for some scene in 11 to 14 %."""
    claims, misses = study.errors_of_families(SCATTER, 4000)
    assert claims["single scenes"] == pytest.approx(0.05, abs=0.015)
    assert all(share < 0.06 for share in (*claims.values(), *misses.values()))
    assert all(share > 0.005 for share in misses.values()), "ten intervals that share cells miss together"


def test_the_scatter_is_read_from_the_published_run_and_named(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    sds = generator.choice([0.05, 0.2], 400)
    psnr = 30 + 0.3 * generator.standard_normal((400, 1)) + sds[:, None] * generator.standard_normal((400, 4))
    cells = [
        {"scene": str(scene), "method": method, "seed": seed, "psnr": value if method == "qnerf" else 28.0}
        for scene, row in enumerate(psnr) for seed, value in enumerate(row) for method in ("nerf", "qnerf")
    ]  # fmt: skip
    cells[0]["psnr"] = None
    file = tmp_path / "reduced" / "summary.json"
    file.parent.mkdir()
    run = {"scenes": [{"scene": str(scene)} for scene in range(400)], "seeds": [0, 1, 2, 3], "cells": cells}
    file.write_text(json.dumps(run | {"provenance": {"commit": "abc"}}))
    results = study.published_scatter(file)
    assert results.source == "qnerf − nerf in reduced/summary.json, commit abc"
    assert results.scene_sd == pytest.approx(0.3, rel=0.15)
    assert results.pooled == pytest.approx(np.sqrt(np.mean(sds**2)), rel=0.1)
    assert max(results.seed_sds) > 3 * float(np.median(results.seed_sds)), "no scene is smoothed"
    assert study.published_scatter(tmp_path / "none.json") == study.ASSUMED


def test_the_study_is_complete(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "SCENES", (4, 8))
    monkeypatch.setattr(study, "SEEDS", (3,))
    results = list(calibration(replace(context_of({}), quick=True)))
    assert sentences(results)[0].startswith("With 8 and 16 scenes, an interval of 95 % holds the truth in 9")
    assert any("in reduced/summary.json" in sentence for sentence in sentences(results))
    coverage = table(results, "coverage")
    assert len(coverage.rows) == 2 + len(study.NOISE) * 2 * 3
    assert {len(row) for row in coverage.rows} == {len(coverage.columns)}
    assert len(coverage.columns) == 4 + len(study.KINDS) + 4
    assert {name for _, name in lines(results)} == {HERE, ELSEWHERE, ALONE, ROBUST}
