"""Cases about encoding, amplifier, chunks, optimiser, primitives, fresh fields: all run, and each detects its fault."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from baselines.catalog import CATALOG
from baselines.numerics.checks import BadDensity
from baselines.numerics.encoding import PHI
from baselines.numerics.optimisers import OPTIMISERS
from harness.records.study import Check, Series, Table
from harness.studies.stability.fields import (
    amplifier_cases,
    float64_twin,
    fresh_fields,
    optimiser_cases,
    small_training,
    unit_cases,
)
from harness.studies.stability.rays import encoding_cases
from harness.studies.stability.stability_context import METHODS, StabilityContext
from tests.harness.studies.stability.made_up import checks, context_in, findings

SLOW = [pytest.param(case, marks=pytest.mark.slow) for case in ("E3", "A2", "C2", "A4", "A5", "A6", "G1", "O2")]


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> StabilityContext:
    """Drawn views and tiny networks: nothing is rendered by Mitsuba, and no figure means anything."""
    return context_in(tmp_path_factory.mktemp("stability"), *METHODS)


@pytest.mark.parametrize("case", ["E1", "E2", "A1", "A3", "O1", "O3", "O4", "O5", "G2", *SLOW])
def test_every_case_has_one_outcome_per_subject(case: str, context: StabilityContext) -> None:
    made = findings(case, context)
    outcomes = [finding for finding in made if isinstance(finding, Check)]
    assert outcomes
    assert len({check.subject for check in outcomes}) == len(outcomes), "a cell of the matrix is one outcome"
    assert all(check.why for check in outcomes if check.value is None)
    for finding in made:
        if isinstance(finding, Series):
            assert len(finding.x) == len(finding.y)
            assert all(map(math.isfinite, finding.y))
        elif isinstance(finding, Table):
            assert {len(row) for row in finding.rows} == {len(finding.columns)}


def test_a_method_without_these_parts_is_not_applicable_and_says_why(tmp_path: Path) -> None:
    only_voxels = context_in(tmp_path, "voxels_drjit")
    for case in ("A2", "A3", "O3", "C2"):
        by_name = {check.subject: check for check in checks(case, only_voxels)}
        assert by_name["voxels_drjit"].status == "not_applicable"
        assert "grid of values" in by_name["voxels_drjit"].why
        if case == "A3":
            assert by_name["harness"].status == "not_applicable", "nothing is tried without a trainer"


def test_a_twin_in_float64_differs_from_its_training_only_by_rounding(context: StabilityContext) -> None:
    def in_double(count: int | None, offset: int) -> small_training.History:
        trainer = float64_twin.in_dtype(small_training.new_trainer(context, "qnerf"), torch.float64)
        return small_training.train(context, trainer, count, lambda step: doubled(step + offset))

    doubled = float64_twin.doubled(context)
    twin = in_double(None, offset=0)
    assert {weight.dtype for weight in twin.trainer.fields.parameters()} == {torch.float64}
    single = small_training.train(context, small_training.new_trainer(context, "qnerf"))
    first, last = (abs(single.losses[step] / twin.losses[step] - 1.0) for step in (0, -1))
    assert 0.0 < first < 1e-6, "other numbers, and the same loss"
    assert last < 1e-3
    shifted = in_double(1, offset=1)
    assert abs(shifted.losses[0] / twin.losses[0] - 1.0) > 1e-3, "another batch has another loss"


# encodings


def test_the_kernel_has_its_lobes_where_lucas_numbers_put_them() -> None:
    """The figures are those of an independent computation."""

    def at(base: float, bands: int, d: float) -> float:
        return float(encoding_cases.kernel(base, bands, torch.tensor([d]))[0])

    first, second, third = encoding_cases.DISTANCES
    assert (first, second, third) == (pytest.approx(1.4472, abs=1e-4), pytest.approx(0.8944, abs=1e-4), 1.0)
    assert [at(PHI, 10, first), at(PHI, 14, first)] == pytest.approx([0.80, 0.86], abs=0.006)
    assert [at(PHI, 10, second), at(PHI, 14, second)] == pytest.approx([0.60, 0.72], abs=0.006)
    assert [at(2.0, 10, 1.0), at(2.0, 10, 0.5), at(2.0, 10, 2.0)] == pytest.approx([0.8, 0.7, 1.0], abs=1e-9)
    assert max(at(1.65, bands, d) for bands in (10, 14) for d in encoding_cases.DISTANCES) < 0.3
    assert at(PHI, 10, 0.0) == 1.0


def near(cycles: float) -> float:
    """The relative distance to the nearest frequency of a ladder, or sum or difference of two, in cycles on [−1, 1]."""
    ladders = [[0.0, *(base**k for k in range(20))] for base in {base for base, _ in encoding_cases.LADDERS.values()}]
    made = {abs(a + sign * b) for ladder in ladders for a in ladder for b in ladder for sign in (1.0, -1.0)}
    return min(abs(cycles / frequency - 1.0) for frequency in made if frequency > 0.1)


def test_no_grating_lies_on_a_ladder_or_on_two_of_its_members() -> None:
    assert max(near(64.0), near(PHI**9), near(1.65**8), near(128.0 + 32.0), near(256.0 - 16.0)) < 1e-12
    assert min(map(near, encoding_cases.GRATINGS)) >= 0.01
    assert max(encoding_cases.GRATINGS) > encoding_cases.POINTS / 2


def test_networks_learn_their_values_independently() -> None:
    x = torch.linspace(-1.0, 1.0, 60)
    wave = torch.sin(math.pi * 2.0 * x)
    truth = torch.stack([wave, -0.5 * wave])
    both = encoding_cases.fitted(2.0, 4, x, truth, x, 150)
    assert float((both - truth).abs().max()) < 0.1
    other = encoding_cases.fitted(2.0, 4, x, torch.stack([wave, 3.0 * wave]), x, 150)
    torch.testing.assert_close(both[0], other[0], rtol=0.0, atol=1e-3)


def test_the_error_of_a_position_that_is_not_finite_is_nan() -> None:
    features = torch.zeros(1, 21)
    assert all(math.isnan(encoding_cases.largest_error(features, x, 2.0)) for x in (math.nan, math.inf))
    assert encoding_cases.largest_error(features, 0.0, 2.0) == 1.0, "a cosine of 0 instead of 1"


# amplifier


def test_a_slab_of_a_pixel_is_as_opaque_as_its_unit_of_density_allows(context: StabilityContext) -> None:
    """A pixel of the classic camera is 4.0311 / 1111.11 scene units wide at 800 px, and half of the box 1.5."""
    assert amplifier_cases.largest_density("listing2") == 1.0
    assert amplifier_cases.largest_density("none") > 1e3
    assert amplifier_cases.largest_density("equation4") > 1e3
    by_name = {check.subject: check for check in checks("A4", context)}
    unit = CATALOG["qnerf"].parts.density_scale  # type: ignore[union-attr]
    assert by_name["qnerf"].value == pytest.approx(1.0 - math.exp(-unit * 4.0311 / 1111.11 / 1.5))
    assert by_name["qnerf_printed"].value == pytest.approx(1.0 - math.exp(-4.0311 / 1111.11))
    assert "1 per scene unit; 0.0286 at 100 px, 0.00723 at 400 px, 0.00362 at 800 px" in by_name["qnerf_printed"].why
    assert {by_name[name].status for name in ("nerf", "qnerf_theorem", "qnerf_running_mean")} == {"pass"}
    assert {by_name[name].owner for name in ("nerf", "qnerf_running_mean")} == {"ours"}
    assert {by_name[name].owner for name in ("qnerf", "qnerf_shifted", "qnerf_running_mean_listing2")} == {"paper"}


def test_the_threshold_of_listing_2_is_a_step_and_an_infinite_or_negative_alpha_is_seen() -> None:
    jumps = [amplifier_cases.jump_at_threshold(beta) for beta in (1.0, 1.5, 2.0)]
    assert jumps == pytest.approx([0.0, 0.25, 0.5], abs=1e-6)
    spread = torch.linspace(-1.0, 1.0, 9)
    finite, _, inverted = zip(
        *(amplifier_cases.at_inputs("equation4", alpha, spread) for alpha in (1.0, -1.0)), strict=True
    )
    assert (finite, inverted) == ((True, True), (False, True))
    assert not amplifier_cases.at_inputs("equation4", math.inf, spread)[0]


def test_clamped_densities_have_no_gradient() -> None:
    amplifier = amplifier_cases.amplifier_with("equation4", alpha=2.0)
    raw = torch.linspace(-6.0, 6.0, 50).requires_grad_()
    before, after = amplifier.before_and_after(raw)
    clamped = small_training.at_an_end(before, after, math.inf)
    assert 0 < int(clamped.sum()) < 50
    slopes = [torch.autograd.grad(after[i], before, retain_graph=True)[0].abs().sum() for i in range(50)]
    assert [float(slope) == 0.0 for slope in slopes] == clamped.tolist()


def test_only_the_spoilt_ray_is_lost_and_a_wrong_number_is_detected(
    context: StabilityContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    rays = small_training.setup(context).test.all_rays(0)
    bad = len(rays) // 2
    trainer = small_training.new_trainer(context, "nerf")
    assert torch.nonzero(amplifier_cases.rays_lost(trainer, rays, bad))[:, 0].tolist() == [bad]
    assert amplifier_cases.rays_lost(small_training.new_trainer(context, "qnerf"), rays, bad).all()
    assert set(amplifier_cases.misnamed(trainer, rays, bad).values()) == {""}
    monkeypatch.setattr(BadDensity, "among", lambda self, rays: BadDensity(self.ray + 1, self.sample, self.value))
    assert amplifier_cases.misnamed(trainer, rays, bad)["a NaN sample"].startswith("density of sample 0 of ray")


def test_a_nan_that_is_hidden_fails(context: StabilityContext, monkeypatch: pytest.MonkeyPatch) -> None:
    none = torch.zeros(16 * 16, dtype=torch.bool)
    monkeypatch.setattr(amplifier_cases, "rays_lost", lambda trainer, rays, bad: none[: len(rays)])
    by_name = {check.subject: check for check in checks("A3", context)}
    assert by_name["nerf"].is_broken
    assert "hidden" in by_name["nerf"].why


def test_unchecked_positions_are_judged_where_they_are_finite(context: StabilityContext) -> None:
    by_name = {check.subject: check for check in checks("E2", context)}
    for ladder in ("2^k", "φ^k"):
        assert 0.03 < (by_name[f"{ladder}, unchecked"].value or 0.0) <= 2.0
        assert "inf, nan" in by_name[f"{ladder}, unchecked"].why


# chunks


def test_a_mean_over_the_chunk_changes_pixels(context: StabilityContext) -> None:
    trainer = small_training.trained(context, "qnerf").trainer
    with torch.no_grad():
        trainer.coarse.density_head.weight *= 20.0
        trainer.coarse.amplifier.alpha.fill_(0.9)  # type: ignore[operator]
    try:
        ways = unit_cases.differences(context, trainer)
    finally:
        small_training.trained.cache_clear()
    assert min(ways["chunks of 16"], ways["padded"]) > 1e-4
    assert ways["training mode"] == ways["reloaded"] == 0.0


# optimiser and half precision


def test_smoothing_and_recovery_of_given_losses() -> None:
    assert optimiser_cases.smoothed([1.0, 3.0]) == [1.0, 2.0]
    assert optimiser_cases.smoothed([0.0] * 30 + [20.0] * 20)[-1] == pytest.approx(20.0)
    base = [1.0] * 300
    assert optimiser_cases.steps_until_back(base, base, 50) == 0
    once = [1.0] * 50 + [100.0] + [1.0] * 249
    assert optimiser_cases.steps_until_back(once, base, 50) == optimiser_cases.SMOOTHED
    assert optimiser_cases.steps_until_back([1.0] * 50 + [2.0] * 250, base, 50) is None


def test_weights_in_half_precision_do_not_move_or_are_not_finite() -> None:
    assert optimiser_cases._moved(torch.float32, 1e-4) == pytest.approx(0.05, rel=1e-3)
    assert [optimiser_cases._moved(torch.bfloat16, 1e-4, epsilon) for epsilon in (1e-8, 1e-4)] == [0.0, 0.0]
    assert optimiser_cases._moved(torch.float16, 0.0) == "the weight is nan"
    assert optimiser_cases._moved(torch.float16, 1e-5) == "the weight is -inf"


def test_soap_descends_further_than_adam_where_curvature_lies_along_no_axis() -> None:
    losses = {
        name: [optimiser_cases.descended(name, 1e3, count, torch.float64)[0] for count in (0, 400)]
        for name in OPTIMISERS
    }
    assert losses["adam"][0] == losses["soap"][0] > losses["adam"][1]
    assert losses["soap"][1] < 0.1 * losses["adam"][1]
    unit = torch.eye(3)[None]
    assert optimiser_cases.off_orthogonal(unit) == 0.0
    assert optimiser_cases.off_orthogonal(2.0 * unit) == 3.0


def test_a_spike_changes_only_the_steps_after_it(context: StabilityContext) -> None:
    base = small_training.trained(context, "nerf").losses
    assert optimiser_cases.spiked(context, "nerf", 3, 1.0, "as here") == base
    losses = optimiser_cases.spiked(context, "nerf", 3, 1e9, "not clipped")
    assert losses[:4] == base[:4]
    assert losses[5:] != base[5:]


@pytest.mark.parametrize("method", ["nerf", "qnerf"])
def test_layers_are_those_of_the_field(method: str, context: StabilityContext) -> None:
    field = small_training.trained(context, method).trainer.field
    x = field.box.from_unit(torch.rand(50, 3, generator=torch.Generator().manual_seed(3)))
    position = encoding_cases.encode(field.box.normalised(x), field.base, field.position_bands)
    with torch.no_grad():
        raw = amplifier_cases.layers(field, position, torch.float32)[-1][:, 0]
        sigma = field.density_unit * field.amplifier.before_and_after(raw)[1]
        torch.testing.assert_close(sigma, field.density(x), rtol=1e-4, atol=1e-3)


# a fresh field


def test_a_ball_covers_the_pixels_of_its_cone() -> None:
    """A cone about the axis of a square view: π (f tan θ)² pixels, where sin θ = radius / distance."""
    seen = fresh_fields.cameras(256)
    colours = fresh_fields.ball(seen.all_rays(0))
    covered = float((colours < 1.0).any(-1).float().mean())
    sine = fresh_fields.RADIUS / fresh_fields.DISTANCE
    radius = seen.focal / 256 * sine / (1.0 - sine**2) ** 0.5
    assert covered == pytest.approx(torch.pi * radius**2, rel=0.01)
    torch.testing.assert_close(colours.unique(dim=0), torch.tensor([fresh_fields.BALL, (1.0, 1.0, 1.0)]))


def test_batches_are_the_same_for_every_reading_and_differ_between_steps() -> None:
    first, again = (fresh_fields.batches(16)(3)[0] for _ in range(2))
    assert torch.equal(first.directions, again.directions)
    assert not torch.equal(first.directions, fresh_fields.batches(16)(4)[0].directions)


@pytest.mark.slow
def test_listing_2_loses_its_gradient_on_white_and_keeps_it_on_grey_and_with_a_shift() -> None:
    dead, grey, shifted = (
        fresh_fields.course_of(replace(fresh_fields.FRESH_FIELDS[name], settings=fresh_fields.SMALL), steps)
        for name, steps in (
            ("Listing 2, unit 25", 40),
            ("Listing 2, unit 25, small network, grey", 80),
            ("Listing 2 shifted, unit 25", 80),
        )
    )
    assert dead["step"] == [1.0, 20.0, 40.0]
    assert dead["error"][-1] == pytest.approx(1.0, abs=0.01), "the background only"
    assert dead["gradient"][0] > 1e-2
    assert dead["gradient"][-1] < 1e-6
    assert dead["white"][-1] > 0.9
    for alive in (grey, shifted):
        assert alive["gradient"][-1] > 1e-4
        assert alive["white"][-1] < 0.1
        assert min(alive["error"]) < fresh_fields.LEARNT
