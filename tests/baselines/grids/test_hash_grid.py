"""The hash encoding: compiled against composed, against Dr.Jit's, its border, and what collides."""

import pytest
import torch

from baselines.contract import FieldSpec, NetworkSize
from baselines.grids.hash_grid import HashGrid, encoded, hash_grid
from baselines.grids.interpolation import TABLE_CHANNELS, Encoded
from baselines.methods.explicit import TableSettings
from harness.studies.conformance.subject import BOX
from tests.harness.voxels import drjit_or_skip

CELLS = (2, 7, 40)
"""The last with more nodes than entries."""


def tables(entries: int = 2048) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    sizes = [min((cells + 1) ** 3, entries) for cells in CELLS]
    return [torch.rand(size, TABLE_CHANNELS, generator=generator).requires_grad_() for size in sizes]


def points(count: int = 300, reach: float = 1.0) -> torch.Tensor:
    return reach * (2.0 * torch.rand(count, 3, generator=torch.Generator().manual_seed(1)) - 1.0)


@pytest.mark.parametrize("entries", [2048, 1999])
@pytest.mark.parametrize("reach", [1.0, 1.3])
def test_values_and_gradients_are_those_of_torch(reach: float, entries: int) -> None:
    """Beyond the border, too, and where the number of entries is no power of two."""
    x, compiled_tables, others = points(reach=reach), tables(entries), tables(entries)
    weight = torch.randn(len(x), TABLE_CHANNELS * len(CELLS), generator=torch.Generator().manual_seed(2))
    compiled, composed = Encoded.apply(x, CELLS, *compiled_tables), encoded(x, CELLS, *others)
    torch.testing.assert_close(compiled, composed, rtol=1e-5, atol=1e-6)
    compiled.backward(weight)
    composed.backward(weight)
    for table, other in zip(compiled_tables, others, strict=True):
        torch.testing.assert_close(table.grad, other.grad, rtol=1e-4, atol=1e-5)


def test_a_dense_level_interpolates_a_linear_function_exactly() -> None:
    cells = 4
    nodes = torch.cartesian_prod(*[torch.linspace(-1.0, 1.0, cells + 1)] * 3)
    table = torch.stack([nodes @ torch.tensor([1.0, -2.0, 0.5]), nodes[:, 2]], dim=-1)
    x = points()
    got = Encoded.apply(x, (cells,), table)
    torch.testing.assert_close(got[:, 0], x @ torch.tensor([1.0, -2.0, 0.5]), rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(got[:, 1], x[:, 2], rtol=1e-5, atol=1e-5)


def test_nodes_that_collide_share_one_entry_and_add_their_gradients() -> None:
    table = torch.zeros(1, TABLE_CHANNELS, requires_grad=True)
    x = points(50)
    Encoded.apply(x, (9,), table).sum().backward()
    assert table.grad is not None
    torch.testing.assert_close(table.grad, torch.full((1, TABLE_CHANNELS), 50.0), rtol=1e-5, atol=1e-4)


def test_each_level_has_no_more_entries_than_nodes() -> None:
    counts = [len(table) for table in HashGrid(TableSettings((2, 30, 31, 64), 1 << 15), seed=0).tables]
    assert counts == [27, 31**3, 1 << 15, 1 << 15]


def test_the_same_input_gives_the_same_bits() -> None:
    first, second = tables(), tables()
    for some in (first, second):
        Encoded.apply(points(500), CELLS, *some).square().sum().backward()
    assert all(torch.equal(one.grad, other.grad) for one, other in zip(first, second, strict=True))


def test_it_begins_with_thin_fog() -> None:
    field = hash_grid(FieldSpec(NetworkSize(), BOX, "float32", 0, True, TableSettings((16, 48), 1 << 12)))
    tau = field.density(points()).detach() * 2 * BOX.half_extent
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
