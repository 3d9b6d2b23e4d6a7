"""Ladders of frequencies, weakened NeRFs and partial combinations: what they change, and nothing else."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.composition import reaching
from baselines.contract import NetworkSize
from baselines.methods.ablations import combination, partial_combinations
from baselines.methods.nerf import NERF
from baselines.methods.qnerf import QNERF, QNERF_THEOREM
from baselines.numerics.encoding import PHI
from tests.baselines.small_fields import field_of


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
