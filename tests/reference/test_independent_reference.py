"""Our renderer compared with Mitsuba's path tracer, with Dr.Jit on Mitsuba's volumes, and with closed forms."""

from pathlib import Path

import mpmath
import numpy as np
import pytest
import torch

from harness.execution.progress import Progress
from harness.plan.run_plan import Machine
from harness.records.study import Check
from harness.studies.stability.rays import reference_cases
from harness.studies.stability.rays.reference_cases import (
    COLOUR_BAR,
    DIRECTION,
    ORIGIN,
    SCALAR,
    SIGMA_BAR,
    VALUE_BAR,
    bundle,
    by_autograd,
    closed_form,
    errors,
    layered,
    random_grids,
    rendered,
    z_scores,
)
from harness.studies.stability.stability_context import StabilityContext
from scenes.files.errors import InputError
from scenes.rendering.medium_reference import differentiated, tracked
from scenes.rendering.variant import Variant, choose_variant


@pytest.fixture(scope="module")
def llvm() -> Variant:
    try:
        return choose_variant("llvm_ad_rgb")
    except InputError as error:
        pytest.skip(str(error))


def ours(tau: float, denser: float = 1.0, lighter: float = 1.0) -> np.ndarray:
    sigma, colour = random_grids(tau)
    return rendered(denser * sigma, lighter * colour, 4096).colour[0].numpy()


@pytest.mark.parametrize("tau", [0.03, 5.0])
def test_the_renderer_agrees_with_path_tracing(tau: float) -> None:
    estimate = tracked(*random_grids(tau), ORIGIN, DIRECTION, 40_000, SCALAR)
    assert estimate.standard_error.max() < 4e-3
    assert np.abs(z_scores(ours(tau), estimate)).max() < 4.0
    # the test would notice 50 % more density, and a colour that is off by 5 % for a solid, or by 20 % for a thin medium
    assert np.abs(z_scores(ours(tau, denser=1.5), estimate)).max() > 8.0
    assert np.abs(z_scores(ours(tau, lighter=1.05 if tau > 1 else 1.2), estimate)).max() > 8.0


def test_tracking_on_all_cores_estimates_the_same(llvm: Variant) -> None:
    estimate = tracked(*random_grids(0.3), ORIGIN, DIRECTION, 100_000, llvm)
    assert estimate.standard_error.max() < 2e-3
    assert np.abs(z_scores(ours(0.3), estimate)).max() < 4.0


def test_a_homogeneous_medium_has_its_closed_form() -> None:
    """τ = 3 along the ray: the construction itself, without our renderer."""
    length = 1.0 / np.abs(DIRECTION).max()
    sigma, colour = np.full((16, 16, 16), 3.0 / length), np.full((16, 16, 16, 3), 0.7)
    estimate = tracked(sigma, colour, np.array([-1.0, 0.3, 0.4]), DIRECTION, 40_000, SCALAR)
    truth = 0.7 * -np.expm1(-3.0)
    assert np.abs((estimate.mean - truth) / estimate.standard_error).max() < 4.0


@pytest.mark.parametrize("tau", reference_cases.TAU_OF_A_VOXEL)
def test_values_and_gradients_agree_with_drjit_on_gridvolume(tau: float, llvm: Variant) -> None:
    sigma, colour = random_grids(tau)
    rays = bundle()
    delta = torch.diff(rays.edges, dim=-1).numpy()
    theirs = differentiated(sigma, colour, rays.points.numpy(), delta, rays.weights.numpy(), llvm)
    value, d_sigma, d_colour = errors(theirs, by_autograd(sigma, colour, rays))
    assert value <= VALUE_BAR
    assert d_sigma <= SIGMA_BAR
    assert d_colour <= COLOUR_BAR
    # the test would notice a density that is off by one part in ten thousand
    assert errors(theirs, by_autograd(1.0001 * sigma, colour, rays))[1] > SIGMA_BAR


def test_empty_voxels_have_their_gradient(llvm: Variant) -> None:
    """Where Mitsuba's own `prbvolpath` gives exactly 0, as it never samples there."""
    sigma, colour = random_grids(0.3)
    sigma[:, :, 8:] = 0.0
    rays = bundle()
    delta = torch.diff(rays.edges, dim=-1).numpy()
    theirs = differentiated(sigma, colour, rays.points.numpy(), delta, rays.weights.numpy(), llvm)
    assert np.abs(theirs.d_sigma[:, :, 9:]).max() > 1e-3
    assert errors(theirs, by_autograd(sigma, colour, rays))[1] <= SIGMA_BAR


def test_closed_form_of_layers_against_ordinary_integration() -> None:
    sigma, grey = layered()
    colour, opacity = closed_form(sigma, grey)
    centres = (np.arange(16) + 0.5) / 16
    t = (np.arange(200_000) + 0.5) / 200_000
    density = np.interp(t, centres, sigma)
    through = np.exp(-(np.cumsum(density) - 0.5 * density) / 200_000)
    assert colour == pytest.approx(np.mean(through * density * np.interp(t, centres, grey)), abs=1e-8)
    assert opacity == pytest.approx(-np.expm1(-density.mean()), abs=1e-12)
    even, _ = closed_form(np.full(16, 2.0), np.full(16, 0.5))
    assert even == pytest.approx(float(0.5 * -mpmath.expm1(-2)), abs=1e-15)


def test_the_case_says_what_is_missing_without_llvm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(name: str) -> Variant:
        raise InputError(f"Mitsuba variant {name} does not work here")

    monkeypatch.setattr(reference_cases, "choose_variant", refuse)
    context = StabilityContext(tmp_path, tmp_path, tmp_path, True, Progress(), Machine("cpu", 1, 1), ("nerf",))
    outcomes = [check for check in reference_cases.independent(context) if isinstance(check, Check)]
    missing = [check for check in outcomes if check.status == "not_available"]
    assert {check.why for check in missing} == {"Mitsuba variant llvm_ad_rgb does not work here"}
    assert {check.subject for check in missing} == {"midpoint, llvm_ad_rgb", "midpoint, gridvolume"}
    closed = {check.subject: check for check in outcomes if "closed form" in check.subject}
    assert set(closed) == {f"{rule}, closed form" for rule in reference_cases.QUADRATURES}, "all quadratures are tested"
    assert {check.status for check in closed.values() if check.owner == "ours"} == {"pass"}
    assert closed["left, closed form"].limit == reference_cases.FIRST_ORDER_BAR
    assert "first order" in closed["left, closed form"].why
