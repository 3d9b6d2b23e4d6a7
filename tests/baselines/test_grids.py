"""Planes of features and hash tables: compiled against composed and against Dr.Jit's, borders, the first fog, and the
resolutions of the methods that grow by φ, and what their controls hold fixed.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import pytest
import torch
from torch import Tensor

from baselines.catalog import CATALOG
from baselines.contract import Box, FieldSpec, NetworkSize
from baselines.field import field_of
from baselines.grids.hash_grid import HashGrid, encoded, hash_grid
from baselines.grids.interpolation import PLANE_CHANNELS, TABLE_CHANNELS, Encoded, Multiplied
from baselines.grids.planes import multiplied, planes
from baselines.methods.explicit import PLANES, TABLES, PlaneSettings, TableSettings, geometric
from baselines.numerics.encoding import PHI
from harness.studies.conformance.subject import BOX
from tests.harness.voxels import drjit_or_skip

NODES = (2, 5, 16)
CELLS = (2, 7, 40)
"""The last with more nodes than entries."""


class Kind(NamedTuple):
    shapes: list[tuple[int, ...]]
    compiled: Callable[..., Tensor]
    composed: Callable[..., Tensor]


def of_tables(entries: int) -> Kind:
    shapes = [(min((cells + 1) ** 3, entries), TABLE_CHANNELS) for cells in CELLS]
    return Kind(shapes, lambda x, *some: Encoded.apply(x, CELLS, *some), lambda x, *some: encoded(x, CELLS, *some))


KINDS = {
    "planes": Kind([(3, size, size, PLANE_CHANNELS) for size in NODES], Multiplied.apply, multiplied),
    "tables": of_tables(2048),
    "tables whose size is no power of two": of_tables(1999),
}


def features(kind: Kind) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [torch.rand(shape, generator=generator).requires_grad_() for shape in kind.shapes]


def points(count: int = 300, reach: float = 1.0) -> Tensor:
    return reach * (2.0 * torch.rand(count, 3, generator=torch.Generator().manual_seed(1)) - 1.0)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("reach", [1.0, 1.3])
def test_values_and_gradients_are_those_of_torch_and_the_same_bits_again(kind: Kind, reach: float) -> None:
    """This holds beyond the border, too."""
    x, compiled, again, composed = points(reach=reach), *(features(kind) for _ in range(3))
    ways = ((kind.compiled, compiled), (kind.compiled, again), (kind.composed, composed))
    out = [way(x, *some) for way, some in ways]
    weight = torch.randn(out[0].shape, generator=torch.Generator().manual_seed(2))
    for values in out:
        values.backward(weight)
    torch.testing.assert_close(out[0], out[2], rtol=1e-5, atol=1e-6)
    for one, same, other in zip(compiled, again, composed, strict=True):
        assert torch.equal(one.grad, same.grad)  # type: ignore[arg-type]
        torch.testing.assert_close(one.grad, other.grad, rtol=1e-4, atol=1e-5)


def test_at_a_node_the_features_are_the_product_of_three_nodes() -> None:
    """The axes in the order xy, xz, yz."""
    table = features(KINDS["planes"])[1]
    i, j, k = 1, 4, 0
    x = torch.tensor([[2.0 * node / (NODES[1] - 1) - 1.0 for node in (i, j, k)]])
    expected = table[0, i, j] * table[1, i, k] * table[2, j, k]
    torch.testing.assert_close(Multiplied.apply(x, table)[0], expected)


def test_a_dense_level_interpolates_a_linear_function_exactly() -> None:
    cells, slope = 4, torch.tensor([1.0, -2.0, 0.5])
    nodes = torch.cartesian_prod(*[torch.linspace(-1.0, 1.0, cells + 1)] * 3)
    got = Encoded.apply(points(), (cells,), torch.stack([nodes @ slope, nodes[:, 2]], dim=-1))
    torch.testing.assert_close(got, torch.stack([points() @ slope, points()[:, 2]], dim=-1), rtol=1e-5, atol=1e-5)


def test_each_level_has_no_more_entries_than_nodes() -> None:
    counts = [len(table) for table in HashGrid(TableSettings((2, 30, 31, 64), 1 << 15), seed=0).tables]
    assert counts == [27, 31**3, 1 << 15, 1 << 15]


@pytest.mark.parametrize("half", [1.0, 50.0])
@pytest.mark.parametrize(
    ("make", "own"), [(planes, PlaneSettings(NODES)), (hash_grid, TableSettings((16, 48), 1 << 12))]
)
def test_it_begins_with_thin_fog_whatever_the_unit_of_length(make: Callable[..., Any], own: Any, half: float) -> None:
    box = Box(-half * torch.ones(3), half * torch.ones(3))
    tau = make(FieldSpec(NetworkSize(), box, "float32", 0, True, own)).density(half * points()).detach() * 2 * half
    assert 0.3 < float(tau.mean()) < 3.0


@pytest.mark.parametrize(("cells", "entries"), [(6, 512), (40, 512), (40, 2048)])
def test_values_and_gradients_are_those_of_dr_jit(cells: int, entries: int) -> None:
    """A dense level, whose nodes Dr.Jit numbers from the other axis on, and two with collisions."""
    drjit_or_skip()
    import drjit as dr
    from drjit.hashgrid import HashGridEncoding
    from drjit.llvm.ad import ArrayXf, Float

    nodes = cells + 1
    size = min(nodes**3, entries)
    ours = torch.rand(size, TABLE_CHANNELS, generator=torch.Generator().manual_seed(3)).requires_grad_()
    dense = nodes**3 <= entries
    order = torch.arange(nodes**3).reshape([nodes] * 3).permute(2, 1, 0).reshape(-1) if dense else torch.arange(size)
    oracle = HashGridEncoding(
        Float, 3, n_levels=1, n_features_per_level=TABLE_CHANNELS, hashmap_size=entries, base_resolution=nodes,
        align_corners=True,
    )  # fmt: skip
    theirs = torch.zeros(oracle.n_params // TABLE_CHANNELS, TABLE_CHANNELS)
    theirs[:size] = ours.detach()[order]
    oracle.data = Float(theirs.reshape(-1).numpy())
    dr.enable_grad(oracle.data)
    x = points(reach=0.999)
    found = oracle(ArrayXf(((x + 1.0) / 2.0).T.contiguous().numpy()))
    weight = torch.randn(len(x), TABLE_CHANNELS, generator=torch.Generator().manual_seed(2))
    got = Encoded.apply(x, (cells,), ours)
    torch.testing.assert_close(got.detach().T, torch.from_numpy(found.numpy()), rtol=1e-4, atol=1e-5)
    got.backward(weight)
    dr.backward(dr.sum(found * ArrayXf(weight.T.contiguous().numpy()), axis=None))
    gradient = torch.from_numpy(dr.grad(oracle.data).numpy()).reshape(-1, TABLE_CHANNELS)[:size]
    assert ours.grad is not None
    torch.testing.assert_close(ours.grad[order], gradient, rtol=1e-4, atol=1e-4)


# growth

RESOLUTIONS = {name: own.nodes for name, (own, _) in PLANES.items()} | {
    name: own.cells for name, (own, _) in TABLES.items()
}


def encoder_size(method: str) -> int:
    spec = FieldSpec(NetworkSize(), BOX, "float32", 0, True, CATALOG[method].settings)
    return int(field_of(CATALOG[method], spec).parameter_counts()["encoder"])


def factors(name: str) -> list[float]:
    return [fine / coarse for coarse, fine in itertools.pairwise(RESOLUTIONS[name])]


def test_levels_grow_by_one_factor_from_the_coarsest_to_the_finest() -> None:
    cells = geometric(16, 192, 12)
    assert (len(cells), cells[0], cells[-1]) == (12, 16, 192)
    assert RESOLUTIONS["hash_grid"] == cells
    assert all(math.isclose(quotient, 12 ** (1 / 11), rel_tol=0.03) for quotient in factors("hash_grid"))
    assert geometric(16, 16, 1) == (16,)


@pytest.mark.parametrize("family", ["planes", "hash_grid"])
def test_controls_share_ends_or_size_with_what_grows_by_phi_and_grow_by_nearly_two(family: str) -> None:
    ours, ends = RESOLUTIONS[f"{family}_phi"], RESOLUTIONS[f"{family}_same_ends"]
    assert all(math.isclose(quotient, PHI, rel_tol=0.02) for quotient in factors(f"{family}_phi"))
    assert (ours[0], ours[-1]) == (ends[0], ends[-1])
    for control in ("same_ends", "same_size"):
        assert all(1.8 <= quotient <= 2.1 for quotient in factors(f"{family}_{control}"))
    size, same, fewer = (encoder_size(f"{family}_{name}") for name in ("phi", "same_size", "same_ends"))
    assert math.isclose(size, same, rel_tol=0.005)
    assert fewer < 0.9 * size
