"""Adjusted p-values agree with published references, and their error rates hold in simulation."""

import numpy as np
import pytest
from scipy.stats import false_discovery_control

from harness.verdicts.estimates.multiplicity import benjamini_hochberg, holm


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, None, 0.005]) == pytest.approx([0.03, 0.06, 0.06, None, 0.02])
    assert holm([0.02, 0.5], family=4) == pytest.approx([0.08, 1.0])
    assert holm([]) == []
    assert holm([None]) == [None]


def test_holm_rejects_all_that_bonferroni_rejects() -> None:
    for p in np.random.default_rng(0).beta(0.3, 1.0, (200, 6)):
        adjusted = np.array(holm(p.tolist()), dtype=np.float64)
        assert (adjusted <= np.minimum(6 * p, 1.0) + 1e-15).all()
        assert (adjusted >= p).all()
        assert (np.diff(adjusted[np.argsort(p)]) >= 0).all()


def test_benjamini_and_hochberg_as_scipy_has_it() -> None:
    p = np.random.default_rng(1).beta(0.3, 1.0, 40)
    found = benjamini_hochberg([None, *p.tolist(), None])
    assert found[0] is found[-1] is None
    assert found[1:-1] == pytest.approx(false_discovery_control(p).tolist())


def test_a_family_of_mixed_truths_errs_in_five_per_cent() -> None:
    """Three of six differ: any of the other three is wrongly rejected in at most 5 %."""
    p = np.random.default_rng(2).uniform(size=(4000, 6))
    p[:, :3] = 1e-9
    wrong = np.mean([min(value or 0.0 for value in holm(row.tolist())[3:]) <= 0.05 for row in p])
    assert 0.035 < wrong < 0.06
