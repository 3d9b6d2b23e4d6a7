"""The profiles: plans as data."""

from dataclasses import replace
from typing import Any

from baselines.contract import NetworkSize
from baselines.methods.explicit import VoxelSettings
from baselines.numerics.optimisers import OptimiserName, OptimiserSettings
from harness.plan.run_plan import Extra, Plan
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, ScoreSettings, TrainSettings, ViewSettings
from scenes.catalog.entries import CLASSICS, RUNGS, STRESS

EXPLAINED = "lego"
"""The scene of methods that explain a result without being part of it: that of the paper's ablation, Table 4."""
COMPARED = ("nerf", "nerf_matched", "qnerf")
"""The methods of every default run: the two methods of the paper, and the bandwidth control."""
JUDGED = (*COMPARED, "qnerf_repaired")
"""The methods of a long run: `COMPARED`, and the best reading that changes a listing."""


def _tuned(name: OptimiserName, betas: tuple[float, float], first_rate: float, last_rate: float) -> dict[str, Any]:
    optimiser = OptimiserSettings(name, betas)
    return dict(optimiser=optimiser, learning_rate=first_rate, last_learning_rate=last_rate, decay="linear")


TUNED: dict[OptimiserName, dict[str, Any]] = {
    "adam": _tuned("adam", (0.9, 0.99), first_rate=2e-2, last_rate=6e-4),
    "soap": _tuned("soap", (0.9, 0.99), first_rate=1e-2, last_rate=3e-4),
    "muon": _tuned("muon", (0.95, 0.99), first_rate=1.4e-2, last_rate=4e-4),
}
"""Map optimiser → the settings of short runs with it, for all methods (`python -m harness study sweep`)."""

REDUCED_TRAINING = TrainSettings(
    network=NetworkSize(depth=6, width=64, colour_layers=2, colour_width=32),
    rays=512,
    bins=32,
    bins_per_pixel=0.4,
    first_bins=24,
    rendered_bins=64,
    fine_bins=0,
    covered_share=0.8,
    contrast_weight=3.0,
    **TUNED["soap"],
    warm_up_steps=50,
    average=12.0,
    precision="bfloat16",
    grid=GridSettings(cells=48, first_step=100, every=25, per_pixel=0.6),
    own={"voxels_drjit": VoxelSettings(finest=64, bins=96, rate_factor=27.0)},
)

REDUCED_VIEWS = ViewSettings(
    resolution=100,
    train=100,
    val=0,
    test=12,
    spp_train=64,
    spp_test=256,
    ceiling_train_db=36.0,
    ceiling_test_db=45.0,
)
"""The views for scores of about 30 dB, where the noise of the test views is 3 % of the error. Of the noise of the
training views a fifth adds to the error (lego: 0.8 dB are lost with a ceiling of 26 dB in place of 33).
"""

SHORT_TRAINING = replace(
    REDUCED_TRAINING,
    rays=256,
    bins=24,
    bins_per_pixel=None,
    first_bins=12,
    rendered_bins=None,
    warm_up_steps=30,
    grid=GridSettings(cells=32, first_step=80, every=20),
    precision="float32",
)
"""The settings for a few hundred steps on scenes that are simple, and hard for one reason."""

FULL = Plan(
    profile="full",
    scenes=tuple(CLASSICS),
    methods=COMPARED,
    seeds=(0, 1, 2),
    budget=Budget(steps=200_000, seconds=None),
    train=TrainSettings(grid=GridSettings(cells=0), precision="bfloat16"),
    score=ScoreSettings(checkpoints=12, earliest=0.005, curve_views=8),
    views=ViewSettings(ceiling_train_db=36.0, ceiling_test_db=40.0),
    extras=(Extra(EXPLAINED, ("nerf_float32", "qnerf_float32"), (0,)),),
)
"""The paper's own setting; `full_skipping` has the silhouettes' hull and an occupancy grid, which leave few samples."""

PROFILES: dict[str, Plan] = {
    "smoke": Plan(
        profile="smoke",
        scenes=("hotdog", "lego"),
        methods=COMPARED,
        seeds=(0, 1),
        budget=Budget(steps=60, seconds=None),
        train=replace(REDUCED_TRAINING, grid=GridSettings(cells=24, first_step=30, every=10)),
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=1024, train_views=2, stored_views=1),
        views=ViewSettings(resolution=32, train=20, val=2, test=5, spp_train=16, spp_test=32),
        extras=(Extra(EXPLAINED, ("qnerf_printed",), (0,)),),
    ),
    "reduced": Plan(
        profile="reduced",
        scenes=tuple(CLASSICS),
        methods=COMPARED,
        seeds=(0, 1, 2),
        budget=Budget(steps=750, seconds=None),
        train=REDUCED_TRAINING,
        score=ScoreSettings(checkpoints=4, earliest=0.125, curve_views=4, chunk=2048, train_views=2),
        views=REDUCED_VIEWS,
    ),
    "stress": Plan(
        profile="stress",
        scenes=tuple(STRESS),
        methods=COMPARED,
        seeds=(0,),
        budget=Budget(steps=300, seconds=None),
        train=SHORT_TRAINING,
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=2048, stored_views=1),
        views=ViewSettings(resolution=48, train=30, val=0, test=6, spp_train=16, spp_test=64),
    ),
    "ladder": Plan(
        profile="ladder",
        scenes=tuple(RUNGS),
        methods=COMPARED,
        seeds=(0,),
        budget=Budget(steps=200, seconds=None),
        train=SHORT_TRAINING,
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=2048, stored_views=1),
        views=ViewSettings(resolution=40, train=20, val=0, test=4, spp_train=16, spp_test=32),
    ),
    "converged": Plan(
        profile="converged",
        scenes=tuple(CLASSICS),
        methods=JUDGED,
        seeds=(0, 1, 2),
        budget=Budget(steps=4000, seconds=None),
        train=replace(
            REDUCED_TRAINING,
            rays=1024,
            bins_per_pixel=0.8,
            rendered_bins=96,
            warm_up_steps=100,
            grid=replace(REDUCED_TRAINING.grid, per_pixel=1.2, every=50, share=0.1),
        ),
        score=ScoreSettings(checkpoints=5, earliest=0.0625, chunk=2048),
        views=REDUCED_VIEWS,
    ),
    "full": FULL,
    "full_skipping": replace(
        FULL,
        profile="full_skipping",
        train=replace(FULL.train, grid=GridSettings(cells=96, first_step=2000, every=100, share=0.1)),
        extras=(),
    ),
}
