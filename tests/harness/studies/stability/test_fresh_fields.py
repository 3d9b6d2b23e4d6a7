"""A6: the record of a fresh field, and a field without a gradient that must be detected."""

from dataclasses import replace

import pytest
import torch

from harness.studies.stability.fields import fresh_fields


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
