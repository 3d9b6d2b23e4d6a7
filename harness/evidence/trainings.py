"""What the studies train: one literal table, so that their cost is seen on one screen."""

from dataclasses import dataclass, replace

from harness.plan import PROFILES, Plan
from harness.schedule import Budget
from scenes.catalog import CLASSICS

SEARCHED = ("chair", "ship")
"""Scenes on which the repaired Q-NeRF was chosen, by their validation views; its verdict is taken from the others."""
FACTORIAL_SCENES = ("lego", "ficus", "hotdog")
"""Blocks with fine studs, thin leaves, smooth and soft."""
READINGS = {
    "Listing 2": ("amplifier", "qnerf"),
    "Eq. 4": ("equation4", "qnerf_theorem"),
}
"""Reading of the amplifier → its name in the names of combinations, and the method with all three parts."""


@dataclass(frozen=True)
class Training:
    """What differs from the profile `reduced`."""

    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    steps: int
    seeds: tuple[int, ...] = (0, 1, 2)
    resolution: int = 100
    train_views: int = 100
    test_views: int = 15
    checkpoints: int = 3


def _factorial() -> tuple[str, ...]:
    """nerf, and every combination of the three parts under both readings."""
    names = ["nerf", "nerf_phi_encoding", "nerf_phi_skip", "nerf_phi_encoding_phi_skip"]
    for amplifier, whole in READINGS.values():
        names += [f"nerf_{amplifier}", f"nerf_phi_encoding_{amplifier}", f"nerf_{amplifier}_phi_skip", whole]
    return tuple(names)


DIRECTED = ("lego", "drums", "materials")
"""drums and materials have metals and glass: they look different from every side, which training finds out late.
lego's plastic hardly does."""
SCARCE = 20
"""Training views of which half and a quarter are taken. A hundred are more than so short a training uses up: on these
scenes half of a hundred changed the score by −0.03 dB, and a quarter by −0.04."""
LADDERS = ("nerf", "nerf_matched", "nerf_phi_encoding", "nerf_phi_far", "nerf_base165")
TEXTURED = ("lego", "chair")
HELD_OUT = tuple(name for name in CLASSICS if name not in SEARCHED)

TRAININGS: dict[str, Training] = {
    "no_encoding": Training(("nerf", "nerf_no_encoding"), DIRECTED, 600),
    "no_direction": Training(("nerf", "nerf_no_direction"), DIRECTED[1:], 1000, seeds=tuple(range(6))),
    "images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE),
    "half_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 2),
    "quarter_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 4),
    "factorial": Training(_factorial(), FACTORIAL_SCENES, 400),
    "bandwidth_100": Training(LADDERS, TEXTURED, 400, train_views=60, test_views=3),
    "bandwidth_200": Training(LADDERS, TEXTURED, 400, resolution=200, train_views=60, test_views=3),
    "bandwidth_300": Training(LADDERS, TEXTURED, 400, resolution=300, train_views=60, test_views=3),
    "repaired": Training(
        ("nerf", "nerf_matched", "qnerf_repaired", "nerf_phi_encoding_phi_skip"),
        HELD_OUT,
        400,
        seeds=(0, 1),
        checkpoints=4,
    ),
}


def plan_of(training: Training, precision_as_planned: bool, quick: bool) -> Plan:
    """The profile `reduced` with what the training changes; `quick` is far too short for any figure to mean anything.

    Where the processor has no bfloat16 products, the plan is in float32.
    """
    profile = PROFILES["reduced"]
    views = replace(profile.views, resolution=training.resolution, train=training.train_views, test=training.test_views)
    plan = replace(
        profile,
        scenes=training.scenes,
        methods=training.methods,
        seeds=training.seeds,
        budget=Budget(steps=training.steps, seconds=None),
        score=replace(profile.score, checkpoints=training.checkpoints, stored_views=0),
        views=views,
        train=profile.train if precision_as_planned else replace(profile.train, precision="float32"),
        extras=(),
    )
    if not quick:
        return plan
    tiny = replace(views, resolution=12 + training.resolution // 25, train=6, val=2, test=2, spp_train=4, spp_test=4)
    return replace(plan, budget=Budget(steps=4, seconds=None), views=tiny, seeds=training.seeds[:2])
