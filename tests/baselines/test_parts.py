"""Which parts a method, a weakened NeRF and a partial combination are made of, and that nothing else differs."""

import math
from dataclasses import replace
from itertools import chain, combinations, pairwise

import pytest
import torch

from baselines.composition import Parts, reaching, skip_layer
from baselines.contract import NetworkSize
from baselines.field import NetworkField
from baselines.methods.ablations import PARTS_OF_QNERF, combination, partial_combinations
from baselines.methods.nerf import NERF, NERF_MATCHED
from baselines.methods.qnerf import QNERF, QNERF_LISTING4, QNERF_THEOREM
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


@pytest.mark.parametrize("bands", range(1, 17))
@pytest.mark.parametrize("base", [PHI, 1.65, 1.5, 2.0, 3.0])
def test_reaching_is_the_nearest_number_of_bands(base: float, bands: int) -> None:
    """The reference tries all numbers and compares logarithms."""
    off = {many: abs((many - 1) * math.log(base) - (bands - 1) * math.log(2.0)) for many in range(1, 40)}
    assert off[reaching(base, bands)] == pytest.approx(min(off.values()))


def test_without_encoding_a_network_gets_raw_coordinates() -> None:
    field = field_of("nerf_no_encoding", NetworkSize())
    widths = [layer.in_features for layer in field.density_net]  # type: ignore[union-attr]
    assert widths == [3, 256, 256, 256, 256, 259, 256, 256]
    assert field.colour_net[0].in_features == 256 + 3  # type: ignore[union-attr]
    d = torch.nn.functional.normalize(torch.randn(5, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    assert torch.equal(field.encode_directions(d), d)


@pytest.mark.parametrize(("amplifier", "whole"), [("amplifier", QNERF), ("equation4", QNERF_THEOREM)])
def test_partial_combinations_are_all_but_nothing_and_everything(amplifier: str, whole: object) -> None:
    assert isinstance(whole, type(QNERF))
    partial = partial_combinations(amplifier, whole)
    assert len(partial) == len(set(partial.values())) == 6
    assert {NERF, whole}.isdisjoint(partial.values())
    fields = {"phi_encoding": ["encoding"], amplifier: ["amplifier", "density_scale", "start"], "phi_skip": ["skip"]}
    for name, parts in partial.items():
        on = [part for word, parts_of_it in fields.items() if word in name for part in parts_of_it]
        assert parts == replace(NERF, **{part: getattr(whole, part) for part in on}), name
    assert partial[f"nerf_phi_encoding_{amplifier}"] == combination("phi_encoding", "amplifier", of=whole)
