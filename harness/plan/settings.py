"""How training, sampling and scoring are set: small frozen groups, equal for all methods of a comparison."""

from dataclasses import dataclass, field
from typing import Literal, get_args

from baselines.contract import EVERY_ACCELERATION, Accelerations, NetworkSize, Precision
from scenes.view_sets.source import Region

RayAttention = Literal["none", "gradients"]
RAY_ATTENTION: tuple[RayAttention, ...] = get_args(RayAttention)
ATTENDED_SHARE = 0.5
"""Share of a batch that attention draws; the rest is drawn evenly, so that no pixel has less than half of its usual
chance."""


@dataclass(frozen=True)
class GridSettings:
    """The occupancy grid that leaves empty space out."""

    cells: int = 32
    """Along each axis; 0 switches the grid off."""
    first_step: int = 150
    """Everything is evaluated before: a grid that prunes too early deletes what has not been learnt yet."""
    every: int = 25
    share: float = 0.25
    """Share of the cells measured at each refresh; the first one measures all."""
    opacity_threshold: float = 0.02
    """A cell is occupied where a ray through it loses more than this share of what it loses in the densest cell."""
    exploration: float = 0.01
    """Share of the unoccupied points that training evaluates all the same."""


@dataclass(frozen=True)
class VoxelSettings:
    """The explicit field `voxels_drjit`, which has no network to be sized by `NetworkSize`."""

    finest: int = 128
    """Voxels along the longest side of the box in the end; a quarter of them at first."""
    halves: tuple[float, float] = (0.1, 0.3)
    """Shares of the budget after which the grid has half of them, and all."""
    bins: int = 192
    """Points along a ray: one and a half a voxel, as their colour and density are nearly linear between centres."""
    rate_factor: float = 20.0
    """Learning rate relative to that of the networks: a voxel is seen by few rays of a batch."""
    smoothed: int = 8192
    """Voxels a step that are pulled towards their neighbours, and how much."""
    smoothing: float = 1e-4

    def stages(self) -> tuple[tuple[float, int], ...]:
        """(share of the budget from which it holds, voxels along the longest side)."""
        return (0.0, self.finest // 4), (self.halves[0], self.finest // 2), (self.halves[1], self.finest)


@dataclass(frozen=True)
class TrainSettings:
    """§7.1 of the paper by default: Adam, 5e-4, 1024 rays; the sampling of the original NeRF."""

    network: NetworkSize = field(default_factory=NetworkSize)
    rays: int = 1024
    bins: int = 64
    first_bins: int = 64
    """Bins a ray before the step from which the occupancy grid is in use."""
    fine_bins: int = 128
    learning_rate: float = 5e-4
    last_learning_rate: float = 5e-5
    warm_up_steps: int = 0
    clip_norm: float = 1.0
    clip_ratio: float = 4.0
    """A gradient is also clipped to this multiple of the usual norm of those before it: what is 1 to `clip_norm` may be
    a hundred times the usual, and Adam remembers its square for a thousand steps."""
    precision: Precision = "float32"
    grid: GridSettings = field(default_factory=GridSettings)
    accelerations: Accelerations = EVERY_ACCELERATION
    voxels: VoxelSettings = field(default_factory=VoxelSettings)
    ray_attention: RayAttention = "none"
    """How the pixels of a batch are chosen: all alike, or by attention (`baselines.numerics.attention`), the same for
    all methods. Off by default: it is a different comparison."""


@dataclass(frozen=True)
class ScoreSettings:
    """When and how the test set is scored."""

    checkpoints: int = 8
    earliest: float = 0.02
    """Share of the budget at the first checkpoint."""
    chunk: int = 4096
    """Rays rendered at a time; part of the result where a method's density depends on the call."""
    train_views: int = 4
    """Training views scored at the end, so that train and test stand together."""
    stored_views: int = 2
    """Test views kept as pictures for the report."""


@dataclass(frozen=True)
class ViewSettings:
    """What is rendered as ground truth, and what is taken to be needed of it."""

    resolution: int = 800
    train: int = 100
    val: int = 100
    test: int = 200
    spp_train: int = 256
    spp_test: int = 256
    need: tuple[str, ...] = ()
    """Parts that are kept whatever the scene says (`harness.plan.needed.FORCEABLE`)."""
    no_need: tuple[str, ...] = ()
    """Parts that are left out whatever the scene says."""
    region: Region | None = None
    """Where things lie, as the user says it of images that are not ours."""
