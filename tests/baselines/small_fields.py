"""Small fields of every method, and rays to render them; the rest comes from the conformance checks."""

from dataclasses import replace

import pytest
import torch

from baselines.catalog import CATALOG
from baselines.composition import Parts
from baselines.contract import NetworkSize, Rays, Rendering
from baselines.field import NetworkField
from baselines.methods.ablations import PARTIAL
from harness.studies.conformance.subject import BOX, SMALL, WHITE, rendered, roughened, set_alpha, some_points
from tests.baselines.analytic import rays_at

__all__ = ["BOX", "EIGHT", "SMALL", "WHITE", "roughened", "set_alpha", "some_points"]

EIGHT = replace(SMALL, depth=8)
ALL_PARTS: dict[str, Parts] = {name: method.parts for name, method in CATALOG.items() if method.parts is not None}
"""The parts of every method that is a network."""
PARTS = {name: parts for name, parts in ALL_PARTS.items() if name not in PARTIAL}
"""The parts of methods that contain every entry of the tables: partial combinations add no code."""

every_method = pytest.mark.parametrize("method", PARTS)
every_depth = pytest.mark.parametrize("depth", [4, 5, 8])


def field_of(method: str, size: NetworkSize = SMALL, seed: int | str = 0, view_dependent: bool = True) -> NetworkField:
    return NetworkField(PARTS[method], size, BOX, "float32", seed, view_dependent)


def some_rays(count: int = 60) -> Rays:
    return rays_at(0.4, count, dtype=torch.float32)


def render(field: NetworkField, parts: Parts, some: Rays, generator: torch.Generator | None = None) -> Rendering:
    return rendered(field, parts.quadrature, some, generator)
