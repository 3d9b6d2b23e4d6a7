"""Operations of a network: counted from its shapes, by hand, and by what torch really does."""

from types import SimpleNamespace

import pytest
import torch
from torch.utils.flop_counter import FlopCounterMode

from baselines import field
from baselines.catalog import CATALOG
from baselines.contract import FieldSpec, NetworkSize
from baselines.field import NetworkField
from harness.studies.speed.throughput import step_flops
from harness.training.cell_training import flops_per_evaluation
from reports.data.table import FORWARD_AND_BACKWARD
from tests.baselines.small_fields import BOX, EIGHT, SMALL, field_of, some_points

POINTS = 24


def really_done(method: str, size: NetworkSize) -> int:
    """Return the operations per point that torch counts in a forward pass of single operations, one ray per point."""
    parts = CATALOG[method].parts
    field = NetworkField(parts, size, BOX, "float32", 0)
    x, _, _ = some_points(POINTS)
    d = torch.nn.functional.normalize(x, dim=-1)
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        field.density_and_colour(x, field.encode_directions(d), torch.arange(POINTS))
    total, rest = divmod(counter.get_total_flops(), POINTS)
    assert rest == 0
    return int(total)


@pytest.mark.parametrize(
    "method", ["nerf", "nerf_matched", "qnerf", "nerf_phi_far", "nerf_no_encoding", "nerf_no_direction"]
)
@pytest.mark.parametrize("size", [SMALL, EIGHT])
def test_counted_from_shapes_is_what_torch_does(method: str, size: NetworkSize) -> None:
    assert flops_per_evaluation(field_of(method, size)) == really_done(method, size)


@pytest.mark.parametrize(("method", "features", "encoder"), [("planes", 24, 24 * 26), ("hash_grid", 24, 24 * 16)])
def test_learnt_features_by_hand(method: str, features: int, encoder: int) -> None:
    """A weight and a sum for each of 12 corners, and two products; or of 8 corners."""
    network = 2 * (features * 64 + 64 + (64 + 27) * 64 + 64 * 3)
    listed = CATALOG[method]
    made = field.field_of(listed, FieldSpec(SMALL, BOX, "float32", 0, True, listed.settings))
    assert flops_per_evaluation(made) == encoder + network


def test_a_step_in_forward_passes_is_at_most_a_tenth_above_what_is_needed() -> None:
    """The encoded position needs no gradient, and the direction's multiplication runs once per ray."""
    size, points, rays = NetworkSize(), 1000, 10
    counted = FORWARD_AND_BACKWARD * points * (flops_per_evaluation(field_of("nerf", size)) or 0)
    # the gradient into the encoded position, which enters two layers, and into the encoded direction
    for_encoded = 2 * points * 2 * 63 * 256 + 2 * rays * 27 * 128
    for_directions = 3 * 2 * 27 * 128 * (points - rays)
    needed = step_flops(size, points, rays)
    assert counted == needed + for_encoded + for_directions
    assert 1.0 < counted / needed < 1.1


def test_voxels_are_interpolated_between_eight_and_weighted_by_direction_and_what_is_neither_has_no_count() -> None:
    assert flops_per_evaluation(SimpleNamespace(coefficients=1)) == 8 * 2 * 4
    assert flops_per_evaluation(SimpleNamespace(coefficients=4)) == 8 * 2 * 13 + 2 * 3 * 4
    assert flops_per_evaluation(object()) is None
    assert flops_per_evaluation(torch.nn.ReLU()) is None
