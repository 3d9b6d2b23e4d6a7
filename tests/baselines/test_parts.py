"""Which parts a method is made of: sizes, places of the skip, and that nothing else differs."""

from dataclasses import replace
from itertools import chain, combinations, pairwise

import pytest
import torch

from baselines.composition import Parts, skip_layer
from baselines.contract import Box, NetworkSize
from baselines.field import NetworkField
from baselines.methods.ablations import PARTS_OF_QNERF, combination
from baselines.methods.nerf import NERF, NERF_MATCHED
from baselines.methods.qnerf import QNERF, QNERF_LISTING4, QNERF_PRINTED, QNERF_THEOREM
from baselines.numerics.encoding import PHI
from tests.baselines.small_fields import ALL_PARTS, BOX, SMALL, field_of, render, some_rays


def linear_weights(*widths: int) -> int:
    """Weights and biases of a chain of linear layers."""
    return sum(inputs * outputs + outputs for inputs, outputs in pairwise(widths))


@pytest.mark.parametrize(
    ("method", "position", "direction", "amplifier"),
    [("nerf", 63, 27, 0), ("nerf_matched", 45, 21, 0), ("qnerf", 63, 27, 2), ("qnerf_theorem", 63, 27, 1)],
)
def test_parameter_counts_at_the_size_of_the_paper(method: str, position: int, direction: int, amplifier: int) -> None:
    counts = field_of(method, NetworkSize()).parameter_counts()
    wide_input = linear_weights(256 + position, 256) - linear_weights(256, 256)
    assert counts == {
        "density_net": linear_weights(position, *[256] * 8) + wide_input,
        "density_head": 257,
        "colour_net": linear_weights(256 + direction, 128, 128, 3),
        "amplifier": amplifier,
        "total": sum(counts[name] for name in ("density_net", "density_head", "colour_net", "amplifier")),
    }
    if position == 63:
        assert (counts["density_net"], counts["colour_net"]) == (493_056, 53_251), "not Table 1's 1.3 M and 67 K"


@pytest.mark.parametrize(
    ("skip", "depth", "layer"),
    [("phi", 8, 6), ("phi", 6, 4), ("phi", 5, 4), ("phi", 4, 3), ("half", 8, 4), ("half", 4, 2)],
)
def test_layer_of_the_skip(skip: str, depth: int, layer: int) -> None:
    assert skip_layer(skip, depth) == layer
    if skip == "phi":
        assert layer == int(PHI * depth / 2), "Listing 3"


def test_catalogue_holds_every_combination_once() -> None:
    parts = list(ALL_PARTS.values())
    subsets = list(chain.from_iterable(combinations(PARTS_OF_QNERF, count) for count in range(4)))
    assert {combination(*some, of=of) for of in (QNERF, QNERF_THEOREM) for some in subsets} <= {*parts}
    twice = [name for name, one in ALL_PARTS.items() if parts.count(one) > 1]
    assert len(twice) == 2, "a candidate, and that it was chosen"
    assert twice[0] == "qnerf_repaired"


@pytest.mark.parametrize("extent", [0.5, 1.0, 30.0])
def test_density_has_the_unit_of_the_box_and_as_printed_that_of_the_scene(extent: float) -> None:
    box = Box(-extent * torch.tensor([1.0, 0.2, 0.6]), extent * torch.tensor([1.0, 0.2, 0.6]))
    for parts in ALL_PARTS.values():
        expected = 1.0 if parts == QNERF_PRINTED else parts.density_scale / extent
        assert parts.density_unit(box) == pytest.approx(expected, rel=1e-6)


def trained(parts: Parts) -> NetworkField:
    """After three steps of Adam on random colours."""
    field = NetworkField(parts, SMALL, BOX, "float32", seed=5)
    optimiser = torch.optim.Adam(field.parameters(), lr=5e-3)
    truth = torch.rand(60, 3, generator=torch.Generator().manual_seed(62))
    for step in range(3):
        optimiser.zero_grad()
        colour = render(field, parts, some_rays(), torch.Generator().manual_seed(step)).colour
        torch.mean((colour - truth) ** 2).backward()
        optimiser.step()
    return field


@pytest.mark.parametrize("start", [QNERF, QNERF_LISTING4, NERF_MATCHED])
def test_with_every_part_put_back_training_is_nerf_bit_for_bit(start: Parts) -> None:
    parts = [field for fields in PARTS_OF_QNERF.values() for field in fields]
    back = replace(start, **{part: getattr(NERF, part) for part in (*parts, "quadrature")})
    for one, two in zip(trained(NERF).parameters(), trained(back).parameters(), strict=True):
        assert torch.equal(one, two)
    assert not torch.equal(trained(NERF).density_head.weight, field_of("nerf", seed=5).density_head.weight)
