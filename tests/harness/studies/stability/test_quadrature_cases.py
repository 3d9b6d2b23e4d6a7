"""Q1 to Q10: what they measure is what it is called, ours pass, and a rule that is broken on purpose fails."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import mpmath
import pytest
import torch
from torch import Tensor

from baselines.numerics import sampling
from baselines.numerics.quadrature import QUADRATURES
from harness.records.study import CHAPTERS, Check, Series, Table
from harness.studies.stability.rays import quadrature_edges, quadrature_orders, quadrature_rounding
from harness.studies.stability.rays.exact_rays import (
    OURS,
    Profile,
    exact,
    exponential,
    gaussian,
    homogeneous,
    ramp,
    weights_in_digits,
)
from harness.studies.stability.rays.quadrature_orders import fitted_order
from harness.studies.stability.stability_context import StabilityContext
from harness.studies.usual_quadrature import running_product, stock_expm1
from tests.harness.studies.stability.made_up import checks, context_in, findings


@pytest.fixture
def context(tmp_path: Path) -> StabilityContext:
    return context_in(tmp_path, "nerf")


def broken(case: str, context: StabilityContext) -> list[Check]:
    return [check for check in checks(case, context) if check.is_broken]


@pytest.mark.parametrize("name", [f"Q{number}" for number in range(1, 11)])
def test_ours_pass_and_the_danger_is_seen(name: str, context: StabilityContext) -> None:
    made = findings(name, context)
    ours = [check for check in made if isinstance(check, Check) and check.owner == "ours"]
    others = [check for check in made if isinstance(check, Check) and check.owner != "ours"]
    assert ours
    assert [check for check in ours if check.status == "fail"] == []
    assert others
    if name in ("Q1", "Q2", "Q3", "Q6", "Q7", "Q8", "Q9"):
        assert any(check.status == "fail" for check in others)
    assert all(check.what or check.why for check in [*ours, *others])
    assert all(check.item in CHAPTERS for check in made if isinstance(check, Series | Table))


def weigh_midpoint_by(
    monkeypatch: pytest.MonkeyPatch, weights: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
) -> None:
    monkeypatch.setitem(QUADRATURES, "midpoint", dataclasses.replace(QUADRATURES["midpoint"], weights=weights))


def flattened(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Weights that are right for one density everywhere alone."""
    return QUADRATURES["left"].weights(sigma.mean(dim=-1, keepdim=True) + 0.0 * sigma, lengths)


@pytest.mark.parametrize(
    ("case", "depth", "weights", "said"),
    [
        ("Q1", None, running_product, "transmittance relative"),
        ("Q3", 15.6, stock_expm1, "one density"),
        ("Q3", 0.1, flattened, "ramp"),
    ],
)
def test_rounding_and_gradients_of_others_in_our_place_fail(
    case: str, depth: float | None, weights: Callable[..., tuple[Tensor, Tensor]], said: str,
    context: StabilityContext, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    weigh_midpoint_by(monkeypatch, weights)
    if depth is not None:
        monkeypatch.setattr(quadrature_rounding, "BIN_DEPTHS", [depth])
    failed = broken(case, context)
    assert {check.subject for check in failed} == {"midpoint"}
    assert any(said in check.why for check in failed)
    assert case != "Q1" or len(failed) == 2, "rounding, and half precision that is not refused"


def test_another_order_than_declared_fails_q2(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    misdeclared = dataclasses.replace(QUADRATURES["left"], orders=QUADRATURES["midpoint"].orders)
    monkeypatch.setitem(QUADRATURES, "trapezoid", misdeclared)
    quadrature_orders._errors.cache_clear()
    failed = [check.subject for check in broken("Q2", context)]
    quadrature_orders._errors.cache_clear()
    assert failed == ["trapezoid"]


def test_what_is_not_refused_fails_q8_and_q9(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("baselines.numerics.quadrature", "baselines.rendering"):
        monkeypatch.setattr(f"{module}.require_density", lambda sigma: None)
    monkeypatch.setattr("baselines.rendering.require_interval", lambda near, far: None)
    assert [check.subject for check in broken("Q9", context)] == OURS
    assert set(OURS) <= {check.subject for check in broken("Q8", context)}


def test_a_bad_sample_that_spreads_fails_q9(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    def coupled(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        return QUADRATURES["left"].weights(sigma - sigma.mean() + sigma.mean(), lengths)

    weigh_midpoint_by(monkeypatch, coupled)
    (failed,) = broken("Q9", context)
    assert (failed.subject, failed.what) == ("midpoint", "other rays with a changed bit, where nobody asks (audit)")
    assert failed.value is not None
    assert failed.value >= 30, "NaN and infinity reach all 15 others"


def test_samples_that_step_back_fail_q10(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadrature_edges, "inverse_cdf", lambda t, w, u: sampling.inverse_cdf(t, w, u).flip(-1))
    assert broken("Q10", context)


def test_the_reference_is_the_closed_form() -> None:
    """∫ τ e^(−τt) (1 + cos(3t + ½))/2 dt over [0, 1] as a complex exponential."""
    for tau in (1.0, 10.0, 1000.0, 64000.0):
        whole = -mpmath.expm1(-tau)
        rate = mpmath.mpc(-tau, 3)
        wave = tau * mpmath.exp(mpmath.mpc(0, 0.5)) * (mpmath.exp(rate) - 1) / rate
        assert exact(homogeneous(tau)) == pytest.approx((float(whole), float((whole + wave.real) / 2)), rel=1e-13)


@pytest.mark.parametrize("profile", [ramp(3.0), exponential(100.0), gaussian(100.0), exponential(64000.0)])
def test_depth_is_the_integral_of_density(profile: Profile) -> None:
    t = torch.linspace(0.0, 1.0, 200001, dtype=torch.float64)
    middle = 0.5 * (t[1:] + t[:-1])
    for share in (0.3, 1.0):
        inside = profile.sigma(middle)[middle < share]
        assert float(inside.sum()) / 200000 == pytest.approx(float(profile.depth(share)), rel=1e-6)


def test_weights_in_digits_sum_to_one() -> None:
    for name in OURS:
        points = 3 * QUADRATURES[name].stride + QUADRATURES[name].closed
        w = weights_in_digits(name, [mpmath.mpf(k) / 3 for k in range(points)], [mpmath.mpf(2)] * 3)
        assert float(sum(w)) == pytest.approx(1.0, abs=1e-14)


def test_the_slope_is_the_order_and_rounding_has_none() -> None:
    counts = (8, 16, 32, 64)
    assert fitted_order([3.0 * n**-2.5 for n in counts], counts) == pytest.approx(2.5)
    assert fitted_order([1e-15] * 4, counts) is None


def test_left_ends_that_miss_the_shell_are_judged_and_not_left_out(context: StabilityContext) -> None:
    by_name = {check.subject: check for check in checks("Q5", context) if "importance" in check.what}
    assert set(by_name) == set(QUADRATURES)
    assert (by_name["left"].status, by_name["left"].owner) == ("fail", "usual")
    assert (by_name["left"].value or 0.0) > 0.5
    assert "misses what lies in front" in by_name["left"].why
    assert "bar of its own" in by_name["trapezoid"].why
