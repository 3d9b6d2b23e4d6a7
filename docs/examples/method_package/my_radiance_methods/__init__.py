"""Three methods for the harness: NeRF with a part of its own, a field that is no network, and a trainer of its own."""

from dataclasses import replace

from baselines.catalog import Method
from baselines.composition import Ladder
from baselines.methods.nerf import NERF
from my_radiance_methods.blobs import Blobs, BlobSettings
from my_radiance_methods.voxel_grid import VoxelGridSettings

NERF_BASE3 = Method(
    replace(NERF, encoding="base3"),
    "NeRF with 3^k instead of 2^k, and two thirds of the bands",
    ladders={"base3": Ladder(3.0, lambda bands: max(1, 2 * bands // 3))},
)
BLOBS = Method(BlobSettings(), "soft blobs, each with a place, a size, a density and a colour", make_field=Blobs)
VOXEL_GRID = Method(
    VoxelGridSettings(),
    "a grid of voxels with a trainer of its own",
    "my_radiance_methods.voxel_grid:VoxelGridTrainer",
    deviations=("It has {voxels}³ voxels, {bins} points on every ray, and Adam at {rate:g}.",),
)
