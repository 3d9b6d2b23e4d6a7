"""What is measured on: the device, its precision, the settings that are compared, and the scenes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from baselines.accelerations import Accelerations
from baselines.contract import Box, NetworkSize, Precision, Rays
from harness.batches import Batches
from harness.device import has_amx, multiplies_bfloat16
from harness.evaluate import cameras_of
from harness.ground_truth import read_views
from harness.plan import Plan, planned
from harness.progress import Progress
from harness.runner import view_set_folders
from harness.seeds import generator_for
from harness.settings import GridSettings, TrainSettings, ViewSettings
from harness.speed.drawn_views import write_disc
from scenes.view_set import ViewSet

SCENES = ("lego", "hotdog", "drums")
DENSE = replace(Accelerations(), grid=False, clipping=False)
"""Whatever is fast, on every sample of every ray."""


@dataclass(frozen=True)
class Situation:
    """One run of the benchmark."""

    device: torch.device
    threads: int
    """All cores: both sides of every comparison get them, unless the question is about them."""
    quick: bool
    """Sizes at which nothing means anything, to try the benchmark itself."""
    plain_seconds: float
    view_sets: Path
    """Cache of rendered view sets."""
    scratch: Path
    """Folder of ours for what nobody keeps."""
    show: Progress

    @property
    def synchronise(self) -> Callable[[], object]:
        return torch.cuda.synchronize if self.device.type == "cuda" else lambda: None

    @property
    def precision(self) -> Precision:
        """Of matrix products, as `python -m harness run` would choose it here."""
        return "bfloat16" if multiplies_bfloat16(self.device) else "float32"

    @property
    def matrix_units(self) -> bool:
        """Whether this is the kind of machine that the higher targets are set for: a CPU with AMX."""
        return self.device.type == "cpu" and has_amx() and self.precision == "bfloat16"

    def target(self, with_matrix_units: float, without: float) -> float | None:
        """None on a GPU, for which the issue sets no such target."""
        if self.device.type != "cpu":
            return None
        return with_matrix_units if self.matrix_units else without

    def repeats(self, usual: int) -> int:
        return 2 if self.quick else usual


def paper_settings(situation: Situation, precision: Precision | None = None) -> TrainSettings:
    """8 × 256, colour 2 × 128, L = 10/4, 1024 rays of 64 samples, every one evaluated."""
    usual = TrainSettings(
        fine_bins=0,
        first_bins=64,
        clip_norm=1e9,  # the plain step has no clipping
        clip_ratio=1e9,
        precision=precision or situation.precision,
        grid=GridSettings(cells=0),
        accelerations=DENSE,
    )
    if not situation.quick:
        return usual
    return replace(usual, network=NetworkSize(8, 32, 2, 16, 10, 4), rays=64, bins=8, first_bins=8)


def reduced_plan(situation: Situation, scene: str = "lego") -> Plan:
    """The profile `reduced` on one scene, in the precision that a run would have here."""
    plan = planned("reduced", scenes=[scene], methods=["nerf"], seeds=1, precision=situation.precision)
    if not situation.quick:
        return plan
    small = replace(
        plan.train,
        network=NetworkSize(6, 16, 2, 16, 6, 2),
        rays=64,
        bins=16,
        first_bins=12,
        grid=GridSettings(cells=8, first_step=5, every=5),
    )
    views = ViewSettings(resolution=16, train=6, val=0, test=3, spp_train=4, spp_test=4)
    return replace(plan, train=small, score=replace(plan.score, chunk=256), views=views)


def batches_of(views: ViewSet, device: torch.device) -> Batches:
    return Batches(cameras_of(views, views.train, device), views.train.rgba)


@cache
def views_of(situation: Situation, scene: str) -> ViewSet:
    """The view set that the reduced profile trains on, rendered if it is not in the cache; a drawn one with `quick`."""
    plan = reduced_plan(situation, scene)
    views = plan.views
    if situation.quick:
        folder = situation.scratch / f"{scene}-drawn"
        write_disc(folder, views.resolution, views.train, views.test, seed=SCENES.index(scene))
    else:
        folder = view_set_folders(plan, situation.view_sets, situation.show)[scene]
    return read_views(folder, views, situation.scratch)


def synthetic_batch(situation: Situation, count: int) -> tuple[Rays, Tensor]:
    """`count` rays from all sides through the middle of the box ±1, near 2 and far 6, and a colour for each."""
    generator = generator_for("speed", "rays")
    origins = 4.0 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    aims = torch.rand(count, 3, generator=generator) - 0.5
    directions = torch.nn.functional.normalize(aims - origins, dim=-1)
    colours = torch.rand(count, 3, generator=generator)
    return Rays(origins.to(situation.device), directions.to(situation.device), 2.0, 6.0), colours.to(situation.device)


def unit_box(device: torch.device) -> Box:
    return Box(-torch.ones(3, device=device), torch.ones(3, device=device))
