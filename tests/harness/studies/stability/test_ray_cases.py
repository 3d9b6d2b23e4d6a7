"""Q1 to Q10, C1: this harness passes, broken rules and removed checks fail, and the references are exact."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import mpmath
import pytest
from torch import Tensor

from baselines.numerics import sampling
from baselines.numerics.quadrature import QUADRATURES
from harness.records.study import CHAPTERS, Check, Series, Table
from harness.studies.stability.rays import camera_cases, quadrature_edges, quadrature_orders, quadrature_rounding
from harness.studies.stability.rays.exact_rays import OURS, exact, homogeneous
from harness.studies.stability.rays.quadrature_orders import fitted_order
from harness.studies.stability.rays.usual_quadrature import running_product, stock_expm1
from harness.studies.stability.stability_context import StabilityContext, worst_of
from tests.harness.studies.stability.made_up import checks, context_in, findings


@pytest.fixture
def context(tmp_path: Path) -> StabilityContext:
    return context_in(tmp_path, "nerf")


def broken(case: str, context: StabilityContext) -> list[Check]:
    return [check for check in checks(case, context) if check.is_broken]


@pytest.mark.parametrize("name", [f"Q{number}" for number in range(1, 11)])
def test_this_harness_passes_and_other_forms_fail(name: str, context: StabilityContext) -> None:
    made = findings(name, context)
    outcomes = {(check.owner == "ours", check.status) for check in made if isinstance(check, Check)}
    assert {status for is_ours, status in outcomes if is_ours} == {"pass"}
    assert any(not is_ours for is_ours, _ in outcomes)
    assert (False, "fail") in outcomes or name in ("Q4", "Q5", "Q10")
    assert all(finding.item in CHAPTERS for finding in made if isinstance(finding, Series | Table))


def test_the_worst_error_is_one_that_is_not_finite() -> None:
    assert math.isnan(worst_of([1.0, math.nan, 2.0]))
    assert worst_of(iter([1.0, 3.0, 2.0])) == 3.0


def weigh_midpoint_by(
    monkeypatch: pytest.MonkeyPatch, weights: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
) -> None:
    monkeypatch.setitem(QUADRATURES, "midpoint", dataclasses.replace(QUADRATURES["midpoint"], weights=weights))


def flattened(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Weights that are right only for one density everywhere."""
    return QUADRATURES["left"].weights(sigma.mean(dim=-1, keepdim=True) + 0.0 * sigma, lengths)


@pytest.mark.parametrize(
    ("case", "depth", "weights", "said"),
    [
        ("Q1", None, running_product, "transmittance relative"),
        ("Q3", 15.6, stock_expm1, "one density"),
        ("Q3", 0.1, flattened, "ramp"),
    ],
)
def test_other_forms_in_place_of_the_midpoint_rule_fail(
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
    try:
        assert [check.subject for check in broken("Q2", context)] == ["trapezoid"]
    finally:
        quadrature_orders._errors.cache_clear()


def test_removed_checks_fail_q8_and_q9(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
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
    assert (failed.subject, failed.what) == ("midpoint", "other rays with a changed bit, without checks (audit)")
    assert failed.value is not None
    assert failed.value >= 30, "NaN and infinity reach all 15 others"


def test_samples_that_step_back_fail_q10(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quadrature_edges, "inverse_cdf", lambda t, w, u: sampling.inverse_cdf(t, w, u).flip(-1))
    assert broken("Q10", context)


def test_the_reference_is_the_closed_form() -> None:
    """∫ τ e^(−τt) (1 + cos(3t + ½))/2 dt over [0, 1] as a complex exponential."""
    for tau in (1.0, 10.0, 1000.0, 64000.0):
        opacity = -mpmath.expm1(-tau)
        rate = mpmath.mpc(-tau, 3)
        wave = tau * mpmath.exp(mpmath.mpc(0, 0.5)) * (mpmath.exp(rate) - 1) / rate
        assert exact(homogeneous(tau)) == pytest.approx((float(opacity), float((opacity + wave.real) / 2)), rel=1e-13)


def test_the_slope_is_the_order_and_rounding_has_none() -> None:
    counts = (8, 16, 32, 64)
    assert fitted_order([3.0 * n**-2.5 for n in counts], counts) == pytest.approx(2.5)
    assert fitted_order([1e-15] * 4, counts) is None


def test_left_ends_that_miss_the_shell_are_judged(context: StabilityContext) -> None:
    by_name = {check.subject: check for check in checks("Q5", context) if "importance" in check.what}
    assert set(by_name) == set(QUADRATURES)
    assert (by_name["left"].status, by_name["left"].owner) == ("fail", "usual")
    assert (by_name["left"].value or 0.0) > 0.5
    assert "misses the part that lies in front" in by_name["left"].why
    assert "has a separate one" in by_name["trapezoid"].why


def test_cameras_of_this_harness_pass_and_the_usual_forms_fail(context: StabilityContext) -> None:
    made = checks("C1", context)
    assert [check.status for check in made if check.owner == "ours"] == ["pass"] * 6
    assert [check.status for check in made if check.owner == "usual"] == ["fail"] * 3
    mitsuba = next(check for check in made if check.subject == "Mitsuba without checks")
    assert "origin on target" in mitsuba.why
    assert "NaN" in mitsuba.why


def test_a_removed_check_and_the_usual_slab_test_fail_c1(
    context: StabilityContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(camera_cases, "check_poses", lambda poses, names: None)
    monkeypatch.setattr(camera_cases, "ray_box", camera_cases.naive_slab)
    poses, slab = broken("C1", context)
    assert poses.value == 7
    assert "pose: mirrored" in poses.why
    assert slab.what.startswith("axis-parallel rays")
