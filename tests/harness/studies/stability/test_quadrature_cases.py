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
from harness.execution.progress import Quiet
from harness.records.study import CHAPTERS, Check
from harness.studies.stability.cases import SHELF
from harness.studies.stability.rays import quadrature_edges, quadrature_orders, quadrature_rounding
from harness.studies.stability.rays.exact_rays import exact, exponential, gaussian, homogeneous, ramp, weights_in_digits
from harness.studies.stability.rays.quadrature_orders import fitted_order
from harness.studies.stability.rays.quadrature_rounding import running_product, stock_expm1
from harness.studies.stability.stability_context import Finding, StabilityContext

NAMES = [f"Q{number}" for number in range(1, 11)]


@pytest.fixture
def situation(tmp_path: Path) -> StabilityContext:
    return StabilityContext(("nerf",), tmp_path, tmp_path, tmp_path, 1, True, Quiet())


def findings(name: str, situation: StabilityContext) -> list[Finding]:
    return list(SHELF.measure_of(name)(situation))


def outcomes(name: str, situation: StabilityContext) -> list[Check]:
    return [one for one in findings(name, situation) if isinstance(one, Check)]


@pytest.mark.parametrize("name", NAMES)
def test_ours_pass_and_someone_else_is_measured_too(name: str, situation: StabilityContext) -> None:
    found = findings(name, situation)
    ours = [one for one in found if isinstance(one, Check) and one.owner == "ours"]
    assert ours
    assert [one for one in ours if one.status == "fail"] == []
    assert any(isinstance(one, Check) and one.owner != "ours" for one in found)
    for one in found:
        if isinstance(one, Check):
            assert one.what or one.why
        else:
            assert one.item in CHAPTERS


@pytest.mark.parametrize("name", ["Q1", "Q3", "Q6", "Q7", "Q8", "Q9"])
def test_the_danger_is_seen(name: str, situation: StabilityContext) -> None:
    assert any(one.status == "fail" and one.owner != "ours" for one in outcomes(name, situation))


def broken(monkeypatch: pytest.MonkeyPatch, weights: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]) -> None:
    monkeypatch.setitem(QUADRATURES, "midpoint", dataclasses.replace(QUADRATURES["midpoint"], weights=weights))


def test_a_running_product_in_our_place_fails_q1(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    broken(monkeypatch, running_product)
    failed = [one for one in outcomes("Q1", situation) if one.is_broken]
    assert {one.subject for one in failed} == {"midpoint"}
    assert len(failed) == 2, "rounding, and half precision that is not refused"


def test_a_stock_expm1_in_our_place_fails_q3(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    broken(monkeypatch, stock_expm1)
    monkeypatch.setattr(quadrature_rounding, "BIN_DEPTHS", [15.6])
    failed = [one for one in outcomes("Q3", situation) if one.is_broken]
    assert {one.subject for one in failed} == {"midpoint"}
    assert max(one.value or 0.0 for one in failed) > 0.05


def test_another_order_than_declared_fails_q2(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(QUADRATURES, "trapezoid", QUADRATURES["left"])
    orders = dataclasses.replace(QUADRATURES["left"], orders=QUADRATURES["midpoint"].orders)
    monkeypatch.setitem(QUADRATURES, "trapezoid", orders)
    quadrature_orders._errors.cache_clear()
    failed = [one.subject for one in outcomes("Q2", situation) if one.is_broken]
    quadrature_orders._errors.cache_clear()
    assert failed == ["trapezoid"]


def test_what_is_not_refused_fails_q8_and_q9(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("baselines.numerics.quadrature", "baselines.rendering"):
        monkeypatch.setattr(f"{module}.require_density", lambda sigma: None)
    monkeypatch.setattr("baselines.rendering.require_interval", lambda near, far: None)
    assert [one.subject for one in outcomes("Q9", situation) if one.is_broken] == quadrature_rounding.OURS
    assert set(quadrature_rounding.OURS) <= {one.subject for one in outcomes("Q8", situation) if one.is_broken}


def test_a_bad_sample_that_spreads_fails_q9(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    def coupled(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        return QUADRATURES["left"].weights(sigma - sigma.mean() + sigma.mean(), lengths)

    broken(monkeypatch, coupled)
    monkeypatch.setattr(quadrature_edges, "OURS", {"midpoint": QUADRATURES["midpoint"]})
    failed = [one for one in outcomes("Q9", situation) if one.is_broken]
    assert [one.what for one in failed] == ["other rays with a changed bit, where nobody asks (audit)"]
    assert failed[0].value is not None
    assert failed[0].value >= 30, "NaN and infinity reach all 15 others"


def test_samples_that_step_back_fail_q10(situation: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        quadrature_edges, "inverse_cdf", lambda t_edges, w, u: sampling.inverse_cdf(t_edges, w, u).flip(-1)
    )
    assert any(one.is_broken for one in outcomes("Q10", situation))


def test_the_reference_is_the_closed_form() -> None:
    """∫ τ e^(−τt) (1 + cos(3t + ½))/2 dt over [0, 1] as a complex exponential."""
    for tau in (1.0, 10.0, 1000.0, 64000.0):
        whole = -mpmath.expm1(-tau)
        rate = mpmath.mpc(-tau, 3)
        wave = tau * mpmath.exp(mpmath.mpc(0, 0.5)) * (mpmath.exp(rate) - 1) / rate
        assert exact(homogeneous(tau)) == pytest.approx((float(whole), float((whole + wave.real) / 2)), rel=1e-13)


@pytest.mark.parametrize("profile", [ramp(3.0), exponential(100.0), gaussian(100.0), exponential(64000.0)])
def test_depth_is_the_integral_of_density(profile: object) -> None:
    t = torch.linspace(0.0, 1.0, 200001, dtype=torch.float64)
    middle = 0.5 * (t[1:] + t[:-1])
    for share in (0.3, 1.0):
        inside = profile.sigma(middle)[middle < share]  # type: ignore[attr-defined]
        assert float(inside.sum()) / 200000 == pytest.approx(float(profile.depth(share)), rel=1e-6)  # type: ignore[attr-defined]


def test_weights_in_digits_sum_to_one() -> None:
    for name in quadrature_rounding.OURS:
        points = 3 * QUADRATURES[name].stride + QUADRATURES[name].closed
        w = weights_in_digits(name, [mpmath.mpf(k) / 3 for k in range(points)], [mpmath.mpf(2)] * 3)
        assert float(sum(w)) == pytest.approx(1.0, abs=1e-14)


def test_the_slope_is_the_order_and_rounding_has_none() -> None:
    counts = (8, 16, 32, 64)
    assert fitted_order([3.0 * n**-2.5 for n in counts], counts) == pytest.approx(2.5)
    assert fitted_order([1e-15] * 4, counts) is None


def test_left_ends_that_miss_the_shell_are_judged_and_not_left_out(situation: StabilityContext) -> None:
    looked = [one for one in outcomes("Q5", situation) if "importance" in one.what]
    by_name = {one.subject: one for one in looked}
    assert set(by_name) == set(QUADRATURES)
    assert (by_name["left"].status, by_name["left"].owner) == ("fail", "usual")
    assert (by_name["left"].value or 0.0) > 0.5
    assert "misses what lies in front" in by_name["left"].why
    assert "bar of its own" in by_name["trapezoid"].why


def test_log_space_is_said_to_be_nan_only_where_it_is(
    situation: StabilityContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of(name: str) -> Check:
        return next(one for one in outcomes("Q3", situation) if one.subject == name)

    assert "nan where one density is 0" in of("log space").why
    assert "where one density is 0" not in of("running product").why
    monkeypatch.setattr(quadrature_rounding, "log_space", running_product)
    assert "where one density is 0" not in of("log space").why


def test_a_gradient_that_is_wrong_on_a_ramp_alone_fails_q3(
    situation: StabilityContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def flattened(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        return QUADRATURES["left"].weights(sigma.mean(dim=-1, keepdim=True) + 0.0 * sigma, lengths)

    broken(monkeypatch, flattened)
    monkeypatch.setattr(quadrature_rounding, "BIN_DEPTHS", [0.1])
    assert any(one.is_broken and "ramp" in one.why for one in outcomes("Q3", situation))
