"""Methods that are not compositions of parts: features in planes and hash tables, Gaussians, voxels.

Each method is a record of its settings. Grids whose resolutions grow by φ have controls for what else φ changes. A
factor near 2 with the same coarsest and finest level has fewer levels, and so fewer numbers to learn. The control with
an equal count of numbers has finer levels in planes, and longer tables in hash grids.
"""

from dataclasses import dataclass

from baselines.composition import DENSITY_SCALE, START
from baselines.numerics.encoding import PHI


@dataclass(frozen=True, kw_only=True)
class FeatureSettings:
    rate: float = 3.0
    """The learning rate of the features relative to that of the weights: a feature is `rate` times the stored value."""
    width: int = 64
    """The width of the network's two hidden layers."""
    direction_bands: int = 4
    density_scale: float = DENSITY_SCALE
    """The unit of density, and below the density of a fresh field, per half of the box's longest side."""
    start: float = START


@dataclass(frozen=True)
class PlaneSettings(FeatureSettings):
    nodes: tuple[int, ...]
    """The nodes along each side of a plane, coarse to fine."""
    first: float = 0.3
    """The centre, and below the half-width, of the first features: never 0, where a product has no gradient."""
    spread: float = 0.2


@dataclass(frozen=True)
class TableSettings(FeatureSettings):
    cells: tuple[int, ...]
    """The cells along a side of each level."""
    entries: int = 1 << 15
    """The maximum number of entries of a table; a level with fewer nodes has one entry per node."""
    spread: float = 0.1
    """The half-width of the first features. With the paper's 1e-4 a short training would hardly move away from 0."""


@dataclass(frozen=True)
class GaussianSettings:
    """Gaussians, drawn or traced. The rates are for a few hundred to a few thousand steps: at least 10 times those of
    3D Gaussian Splatting (Kerbl et al. 2023), which trains for 30 000 steps.
    """

    first: int
    most: int
    first_opacity: float = 0.5
    degree: int = 2
    """The degree of the spherical harmonics, 0 to 3, where colour depends on the direction."""
    widened: float = 0.2
    """The standard deviation, in pixels of the training views, by which a Gaussian is widened."""
    faster: float = 1.0
    """The factor of the learning rates, which are those at the start."""
    position: float = 1e-2
    log_scale: float = 1e-1
    rotation: float = 5e-2
    opacity: float = 5e-1
    colour: float = 1e-1
    harmonics: float = 2.5e-2
    last_rate: float = 0.02
    """The share of the rates that is left at the end."""
    betas: tuple[float, float] = (0.8, 0.95)
    epsilon: float = 1e-15
    moved_every: int = 50
    moved_until: float = 0.9
    """The share of the budget after which Gaussians stay where they are."""
    growth: float = 0.05
    """The share of new Gaussians at each relocation."""
    dead: float = 0.005
    """The opacity below which a Gaussian is moved to another one."""
    ssim_weight: float = 0.0
    """The weight of 1 − SSIM in the loss, beside the mean square error; `ellipsoids`, which see no views, have none."""


@dataclass(frozen=True)
class VoxelSettings:
    finest: int = 128
    """The number of voxels along the longest side of the box at the end; a quarter of it at first."""
    halves: tuple[float, float] = (0.1, 0.3)
    """The shares of the budget after which the grid has half of this number, and all of it."""
    bins: int = 192
    """The number of points along a ray: one and a half per voxel, as the field is nearly linear between centres."""
    rate_factor: float = 20.0
    """The learning rate relative to that of the networks: few rays of a batch meet a voxel."""
    smoothed: int = 8192
    """The voxels per step that are pulled towards their neighbours, with the weight `smoothing` in the loss."""
    smoothing: float = 1e-4
    density_scale: float = DENSITY_SCALE
    """The unit of density, and below the density of a fresh field, per half of the box's longest side."""
    start: float = START
    betas: tuple[float, float] = (0.9, 0.999)
    """The decay rates of Adam's two moments."""
    epsilon: float = 1e-15

    def stages(self) -> tuple[tuple[float, int], ...]:
        """Return for each stage the share of the budget at which it begins, and its voxels along the longest side."""
        return (0.0, self.finest // 4), (self.halves[0], self.finest // 2), (self.halves[1], self.finest)


@dataclass(frozen=True)
class GivenSettings:
    """Gaussians of a .ply file, which are drawn as the program that trained them draws them."""

    file: str = ""
    sha256: str = ""
    focal: float = 1.0
    """The focal length of the views, in pixels: the reference implementation blurs by a share of a pixel."""


def geometric(coarsest: int, finest: int, levels: int) -> tuple[int, ...]:
    """Return the resolution of each level, growing by one factor, as Eq. 2 and 3 of Müller et al. 2022."""
    growth = (finest / coarsest) ** (1.0 / max(levels - 1, 1))
    return tuple(round(coarsest * growth**level) for level in range(levels))


def by_phi(coarsest: int, levels: int) -> tuple[int, ...]:
    return tuple(round(coarsest * PHI**level) for level in range(levels))


PLANES = {
    "planes": (PlaneSettings(geometric(32, 128, 3)), "three planes of features at three resolutions, multiplied"),
    "planes_phi": (PlaneSettings(by_phi(32, 4)), "planes whose resolutions grow by φ"),
    "planes_same_ends": (
        PlaneSettings(geometric(32, 136, 3)),
        "planes from coarsest to finest of planes_phi by a factor near 2: control",
    ),
    "planes_same_size": (
        PlaneSettings((37, 75, 149)),
        "planes as large as those of planes_phi, growing by 2: control",
    ),
}
"""Map method → its settings and its title; below likewise."""
TABLES = {
    "hash_grid": (TableSettings(geometric(16, 192, 12)), "features in hash tables at twelve resolutions"),
    "hash_grid_phi": (TableSettings(by_phi(16, 6)), "hash tables whose resolutions grow by φ"),
    "hash_grid_same_ends": (
        TableSettings(geometric(16, 177, 5)),
        "hash tables from coarsest to finest of hash_grid_phi by a factor near 2: control",
    ),
    "hash_grid_same_size": (
        TableSettings(geometric(16, 177, 5), 41_252),
        "the same, with tables so long that there are as many numbers as in hash_grid_phi: control",
    ),
}
"""In a picture 100 pixels wide, the finest level of `hash_grid` has about two cells per pixel."""
GAUSSIANS = {
    "splats": (GaussianSettings(4000, 8000), "3-D Gaussians with spherical harmonics, drawn front to back"),
    "ellipsoids": (
        GaussianSettings(3000, 5000, faster=2.0, colour=0.2),
        "the same Gaussians, traced and differentiated by Mitsuba",
    ),
}
"""A traced step takes so long that the Gaussians are few (`python -m harness study families`)."""
