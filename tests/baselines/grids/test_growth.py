"""The resolutions of the methods that grow by φ, and what their controls hold fixed."""

import itertools
import math

import pytest

from baselines.catalog import CATALOG
from baselines.contract import FieldSpec, NetworkSize
from baselines.field import field_of
from baselines.methods.explicit import PLANES, TABLES, geometric
from baselines.numerics.encoding import PHI
from harness.studies.conformance.subject import BOX

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
    assert RESOLUTIONS["planes"] == (32, 64, 128)


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
