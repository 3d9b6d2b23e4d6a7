"""The resolutions of the grids: by what factor they grow from level to level.

The paper's factor φ stands beside controls of what else it changes. A factor near 2 with the same coarsest and finest
level has fewer levels and so fewer numbers to learn; one with as many numbers takes them elsewhere: planes from finer
levels, hash tables from longer ones.
"""

from dataclasses import dataclass

from baselines.numerics.encoding import PHI


def geometric(coarsest: int, finest: int, levels: int) -> tuple[int, ...]:
    """Return the resolution of each level, growing by one factor, as Eq. 2 and 3 of Müller et al. 2022."""
    growth = (finest / coarsest) ** (1.0 / max(levels - 1, 1))
    return tuple(round(coarsest * growth**level) for level in range(levels))


def by_phi(coarsest: int, levels: int) -> tuple[int, ...]:
    """Return resolutions that grow by φ."""
    return tuple(round(coarsest * PHI**level) for level in range(levels))


PLANES: dict[str, tuple[str, tuple[int, ...]]] = {
    "planes": ("three planes of features at three resolutions, multiplied", geometric(32, 128, 3)),
    "planes_phi": ("planes whose resolutions grow by φ", by_phi(32, 4)),
    "planes_same_ends": (
        "planes from coarsest to finest of planes_phi by a factor near 2: control",
        geometric(32, 136, 3),
    ),
    "planes_same_size": ("planes as large as those of planes_phi, growing by 2: control", (37, 75, 149)),
}
"""Map method → its title and the nodes along each side of a plane, coarse to fine."""


@dataclass(frozen=True)
class Tables:
    """Hash tables, coarse to fine."""

    title: str
    cells: tuple[int, ...]
    """The cells along a side of each level."""
    entries: int = 1 << 15
    """The most entries of a table; a level with fewer nodes has one for each."""


TABLES = {
    "hash_grid": Tables("features in hash tables at twelve resolutions", geometric(16, 192, 12)),
    "hash_grid_phi": Tables("hash tables whose resolutions grow by φ", by_phi(16, 6)),
    "hash_grid_same_ends": Tables(
        "hash tables from coarsest to finest of hash_grid_phi by a factor near 2: control", geometric(16, 177, 5)
    ),
    "hash_grid_same_size": Tables(
        "the same, with tables so long that there are as many numbers as in hash_grid_phi: control",
        geometric(16, 177, 5),
        41_252,
    ),
}
"""Two cells of the finest level a pixel of 100."""
