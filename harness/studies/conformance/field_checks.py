"""Checks of a field that the renderer of this harness evaluates. Each raises `Broken`, or an error of the method."""

from typing import Any

import torch
from torch import Tensor, nn

from baselines.contract import Box, Rays, TrainableField
from baselines.numerics.encoding import PHI
from harness.studies.conformance.subject import BOX, WHITE, Broken, Subject, roughened, some_points, some_rays

DEPTHS = (4, 5, 8)
ROUNDING = 2e-6
"""The tolerance of a display colour: chunks of another size sum in another order."""
SCALES = (0.0, 0.1, 10.0)
"""The factors of all weights: from a constant field to a saturated one."""


def keeps_the_protocols(subject: Subject) -> None:
    """The field is a torch module with all attributes that rendering and records need."""
    if not isinstance(subject.field(), nn.Module):
        raise Broken(f"a {type(subject.field()).__name__} is not a torch.nn.Module")
    field: Any = subject.field()
    needed = [name for name in dir(TrainableField) if not name.startswith("_")]
    if missing := [name for name in needed if not hasattr(field, name)]:
        raise Broken(f"it lacks {' '.join(missing)}")
    if not isinstance(field.pointwise, bool):
        raise Broken(f"pointwise is {field.pointwise!r}, not True or False")
    if not isinstance(field.density_limit, float) or not field.density_limit > 0.0:
        raise Broken(f"density_limit is {field.density_limit!r}, not a positive number or infinity")
    counted, held = field.parameter_counts().get("total"), sum(weight.numel() for weight in field.parameters())
    if counted != held:
        raise Broken(f"parameter_counts() says {counted} in total; it has {held}")


def gives_the_right_shapes(subject: Subject) -> None:
    """Density [points] and colour [points, 3] are float32 for 0, 1 and 7 points, at three depths."""
    for depth in DEPTHS:
        field = subject.field(depth)
        for count in (0, 1, 7):
            x, d, ray = some_points(count)
            view = field.encode_directions(d)
            if view.shape[0] != len(d):
                raise Broken(f"encode_directions of {len(d)} rays gives {tuple(view.shape)}")
            sigma, colour = field.density_and_colour(x, view, ray)
            before, after = field.density_before_and_after(x)
            given = {
                "density": field.density(x),
                "density before the amplifier": before,
                "density after the amplifier": after,
                "density with colour": sigma,
                "colour": colour,
            }
            for what, values in given.items():
                shape, kind = tuple(values.shape), values.dtype
                right = (count, 3) if what == "colour" else (count,)
                if shape != right or kind != torch.float32:
                    raise Broken(f"{what} of {count} points at depth {depth} is {kind} {shape}, not float32 {right}")


@torch.no_grad()
def stays_in_range(subject: Subject) -> None:
    """Density is finite and between 0 and the declared limit, colour is within [0, 1], and all functions that return a
    density agree.
    """
    for alpha in (None, 2.0):
        field = roughened(subject.field(), alpha)
        x, d, ray = some_points(500)
        sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
        _in("density", sigma, 0.0, field.density_limit * (1.0 + 1e-6))
        _in("colour", colour, 0.0, 1.0)
        others = {"density()": field.density(x), "density_before_and_after()": field.density_before_and_after(x)[1]}
        for what, other in others.items():
            # Eq. 4 subtracts a mean: rounding errors are a share of the largest density
            if not torch.allclose(other, sigma, rtol=1e-4, atol=1e-5 * max(1.0, float(sigma.max()))):
                apart = float((other - sigma).abs().max())
                raise Broken(f"{what} differs from density_and_colour() by {apart:.3g}")


@torch.no_grad()
def has_the_unit_of_the_box(subject: Subject) -> None:
    """In a unit of length k times as fine, the same box has the same field with 1 / k of the density. A method with a
    density per scene unit, or that encodes scene units, is exempt by its definition.
    """
    parts = subject.method.parts
    if parts is not None and "scene" in (parts.density_per, parts.coordinates):
        return
    x, d, ray = some_points(500)
    field = subject.field()
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    for k in (0.1, 8.0, 25.0):
        scaled = subject.field(box=Box(k * BOX.lower, k * BOX.upper))
        k_sigma, k_colour = scaled.density_and_colour(k * x, scaled.encode_directions(d), ray)
        for what, before, after in (("density × length", sigma, k * k_sigma), ("colour", colour, k_colour)):
            if not torch.allclose(before, after, rtol=1e-3, atol=1e-4):
                change = float((before - after).abs().max())
                raise Broken(f"{what} changes by {change:.3g} where the unit of length is {k:g} times as fine")


def survives_magnitudes(subject: Subject) -> None:
    """Colours and gradients are finite with all weights × 0, 0.1 and 10."""
    for scale in SCALES:
        field = roughened(subject.field())
        with torch.no_grad():
            for weight in field.parameters():
                weight.mul_(scale)
        rendering = subject.rendered(field, some_rays())
        _in(f"colour with weights × {scale:g}", rendering.colour.detach(), 0.0, 1.0 + 1e-5)
        (rendering.colour**2).sum().backward()
        _gradients_are_finite(field, f"with weights × {scale:g}")


def gradients_reach_everything(subject: Subject) -> None:
    """Each parameter has a finite gradient that is not 0 everywhere, at three depths."""
    for depth in DEPTHS:
        field = roughened(subject.field(depth))
        (subject.rendered(field, some_rays()).colour ** 2).sum().backward()
        _gradients_are_finite(field, f"at depth {depth}")
        for name, weight in field.named_parameters():
            if weight.grad is None:
                raise Broken(f"no gradient reaches {name} at depth {depth}")
            if not bool((weight.grad != 0).any()):
                raise Broken(f"the gradient of {name} is 0 everywhere at depth {depth}")


def _gradients_are_finite(field: Any, where: str) -> None:
    for name, weight in field.named_parameters():
        if weight.grad is not None and not bool(torch.isfinite(weight.grad).all()):
            raise Broken(f"the gradient of {name} is not finite {where}")


def weights_depend_on_the_seed_alone(subject: Subject) -> None:
    """Equal seeds give equal initial weights in any state of torch's global generator; other seeds give others."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        first = subject.field()
        torch.manual_seed(2)
        same = subject.field()
    for (name, weight), again in zip(first.named_parameters(), same.parameters(), strict=True):
        if not torch.equal(weight, again):
            raise Broken(f"{name} differs with the same seed; use baselines.contract.uniform_weights")
    for seed in (1, "0/fine"):
        pairs = zip(first.parameters(), subject.field(seed=seed).parameters(), strict=True)
        if all(torch.equal(weight, again) for weight, again in pairs):
            raise Broken(f"seed {seed!r} gives the weights of seed 0")


def is_paired_with_nerf(subject: Subject) -> None:
    """Initial weights with the name and shape of a weight of NeRF equal it, so that methods start alike."""
    reference = dict(Subject("nerf").field(depth=8).named_parameters())
    for name, weight in subject.field(depth=8).named_parameters():
        shared = name in reference and weight.shape == reference[name].shape
        if shared and not torch.equal(weight, reference[name]):
            raise Broken(f"{name} has name and shape of NeRF's weight and other initial values; use uniform_weights")


def renders_in_range(subject: Subject) -> None:
    """Colour, opacity and depth are finite and in range, with and without view direction; rays that miss the box show
    the background.
    """
    rays = some_rays()
    for depth in DEPTHS:
        for view_dependent in (True, False):
            rendering = subject.rendered(roughened(subject.field(depth, 0, view_dependent)), rays)
            _in("rendered colour", rendering.colour.detach(), 0.0, 1.0 + 1e-5)
            _in("opacity", rendering.opacity.detach(), 0.0, 1.0 + 1e-5)
            _in("depth", rendering.depth.detach(), rays.near, rays.far)
    nowhere = Rays(torch.full((3, 3), 5.0), torch.tensor([[0.0, 0.0, 1.0]]).expand(3, 3), rays.near, rays.far)
    if subject.quadrature != "listing4":  # it is not cut to the box
        rendering = subject.rendered(roughened(subject.field()), nowhere)
        if not torch.equal(rendering.colour, WHITE.expand(3, 3)):
            raise Broken("rays that miss the box are not background")


@torch.no_grad()
def renders_the_same_again(subject: Subject) -> None:
    """Two renderings are bit-identical, at midpoints and at random points of the same seed."""
    field = roughened(subject.field())
    for seed in (None, 3):
        generators = [None if seed is None else torch.Generator().manual_seed(seed) for _ in range(2)]
        first, again = (subject.rendered(field, some_rays(), generator) for generator in generators)
        if not (torch.equal(first.colour, again.colour) and torch.equal(first.depth, again.depth)):
            raise Broken("the same rays rendered again give another picture")


@torch.no_grad()
def pointwise_is_true(subject: Subject) -> None:
    """If `pointwise` is True, chunks of any size give the same picture; if it is False, some chunk changes it."""
    field = subject.field()
    claimed, rays = field.pointwise, some_rays(40)
    # α is not 1/φ as at the start, where Eq. 4 is the identity about any mean
    field = roughened(field, 1.5 / PHI if claimed else 1.0)
    complete = subject.rendered(field, rays)
    largest = 0.0
    for chunk in (1, 7, 20):
        pieces = [subject.rendered(field, rays.part(start, start + chunk)) for start in range(0, len(rays), chunk)]
        for name in ("colour", "opacity"):
            joined = torch.cat([getattr(piece, name) for piece in pieces])
            largest = max(largest, float((joined - getattr(complete, name)).abs().max()))
    if claimed and largest > ROUNDING:
        raise Broken(f"pointwise is True, but chunks of another size change a picture by {largest:.3g}")
    if not claimed and largest <= ROUNDING:
        raise Broken("pointwise is False, but no chunk of another size changed the picture: it only costs time")


def _in(what: str, values: Tensor, low: float, high: float) -> None:
    if not bool(torch.isfinite(values).all()):
        raise Broken(f"{what} is not finite")
    if values.numel() and not (float(values.min()) >= low and float(values.max()) <= high):
        raise Broken(f"{what} is {float(values.min()):.6g} to {float(values.max()):.6g}, not {low:g} to {high:g}")
