"""Leaving a ray once it is opaque: what it saves, what it may change, and where it must not act."""

import pytest
import torch

from baselines.contract import Rendering
from baselines.rendering import OPAQUE
from tests.baselines.analytic import AnalyticField, ball, homogeneous, rays_at, soft_shell
from tests.baselines.test_rendering import render, straight_ray


@torch.no_grad()
def both(sigma: object, bins: int = 64) -> tuple[Rendering, Rendering]:
    """With and without stopping, on rays around the ball."""
    rays = rays_at(0.3, 40)
    made = [render(AnalyticField(sigma), rays, bins, early_stop=stop) for stop in (True, False)]  # type: ignore[arg-type]
    return made[0], made[1]


@pytest.mark.parametrize("density", [0.1, 3.0, 10.0, 100.0, 1e4])
@pytest.mark.parametrize("bins", [1, 3, 64])
def test_colours_change_by_less_than_the_threshold(density: float, bins: int) -> None:
    stopped, whole = both(ball(density, 0.8), bins)
    assert (stopped.colour - whole.colour).abs().max() <= OPAQUE
    assert (stopped.opacity - whole.opacity).abs().max() <= OPAQUE
    assert (stopped.depth - whole.depth).abs().max() <= 4.0 * OPAQUE / (1.0 - OPAQUE)


def test_what_is_not_opaque_is_bitwise_the_same() -> None:
    stopped, whole = both(ball(3.0, 0.8))
    assert torch.equal(stopped.colour, whole.colour)
    assert stopped.network_evaluations == whole.network_evaluations


def test_an_opaque_ball_costs_less() -> None:
    stopped, whole = both(ball(100.0, 0.8))
    assert stopped.network_evaluations < 0.8 * whole.network_evaluations


def test_a_thin_wall_does_not_hide_what_it_lets_through() -> None:
    """Transmittance e^-2 behind the first wall: the second one still counts."""
    stopped, whole = both(soft_shell(10.0, 0.5, 0.05), 128)
    assert torch.equal(stopped.colour, whole.colour)


def test_nothing_stops_while_there_are_gradients() -> None:
    field = AnalyticField(homogeneous(1e4))
    render(field, straight_ray(), 64, early_stop=True)
    assert field.points == 64


@torch.no_grad()
def test_nothing_stops_where_density_depends_on_the_call() -> None:
    """Listing 2 takes its mean over the points of the call: leaving some out would change the others."""
    field = AnalyticField(homogeneous(1e4))
    field.pointwise = False
    render(field, straight_ray(), 64, early_stop=True)
    assert field.points == 64
