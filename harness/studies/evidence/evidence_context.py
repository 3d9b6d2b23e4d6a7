"""The context of the evidence studies, and the table of what they train."""

from dataclasses import dataclass, replace

from harness.plan.needed import kept
from harness.plan.profiles import PROFILES, REDUCED_VIEWS
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.records.metric_table import METRICS
from harness.studies.trained_context import TrainedContext
from scenes.catalog.entries import CLASSICS
from scenes.view_sets.source import Region

FACTORIAL_SCENES = ("lego", "ficus", "hotdog")
"""Scenes of blocks with fine studs, of thin leaves, and of smooth and soft shapes."""
DIRECTED = ("lego", "drums", "materials")
"""Scenes whose appearance depends on direction: in drums and materials it is learnt late, in lego it is weak."""
SCARCE = 20
"""The number of training views that is halved and quartered. So short a training does not exhaust a hundred views: on
these scenes half of a hundred changed the score by −0.03 dB, and a quarter by −0.04.
"""
READINGS = {"Listing 2": ("amplifier", "qnerf"), "Eq. 4": ("equation4", "qnerf_theorem")}
"""Reading of the amplifier → its part of a combination's name, and the method with all three parts."""
COMBINATIONS = (
    *("nerf", "nerf_phi_encoding", "nerf_phi_skip", "nerf_phi_encoding_phi_skip"),
    *("nerf_amplifier", "nerf_phi_encoding_amplifier", "nerf_amplifier_phi_skip", "qnerf"),
    *("nerf_equation4", "nerf_phi_encoding_equation4", "nerf_equation4_phi_skip", "qnerf_theorem"),
)
"""Every combination of the three parts under both readings."""
LADDERS = ("nerf", "nerf_matched", "nerf_phi_encoding", "nerf_phi_far", "nerf_base165")
DENSITIES = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_repaired")
"""Methods that cover every reading of density that a user would train."""
THIN = ("ficus", "mic")
"""Scenes of thin objects, which most rays miss."""
TEN = tuple(range(10))
OBJECTED = (
    *("nerf", "nerf_no_shift", "nerf_released", "nerf_listing4"),
    *("qnerf", "qnerf_shifted", "qnerf_theorem", "qnerf_listing4"),
    *("qnerf_repaired", "nerf_phi_encoding_phi_skip"),
)
"""Methods that differ from NeRF or Q-NeRF in something that a reader may object to."""
WITHOUT_SILHOUETTES = ("nerf", "nerf_matched", "qnerf", "qnerf_repaired")


@dataclass(frozen=True)
class Training:
    methods: tuple[str, ...]
    scenes: tuple[str, ...]
    steps: int
    seeds: tuple[int, ...] = (0, 1, 2)
    resolution: int = 100
    train_views: int = 100
    test_views: int = REDUCED_VIEWS.test
    checkpoints: int = 3
    need: tuple[str, ...] = ()
    """Parts to keep even if the scenes do not need them (`harness.plan.needed.FORCEABLE`)."""
    half_side: float | None = None
    """Half of the side of a cube about the origin, which replaces the scene's own box."""


TRAININGS: dict[str, Training] = {
    "no_encoding": Training(("nerf", "nerf_no_encoding"), DIRECTED, 600),
    "no_direction": Training(("nerf", "nerf_no_direction"), DIRECTED[1:], 1000, seeds=tuple(range(6))),
    "images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE),
    "half_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 2),
    "full_steps": Training(("nerf",), tuple(CLASSICS), 1000, seeds=(0, 1)),
    "steps_850": Training(("nerf",), tuple(CLASSICS), 850, seeds=(0, 1)),
    "steps_930": Training(("nerf",), tuple(CLASSICS), 930, seeds=(0, 1)),
    "quarter_images": Training(("nerf",), DIRECTED, 400, train_views=SCARCE // 4),
    "factorial": Training(COMBINATIONS, FACTORIAL_SCENES, 400),
    "bandwidth_100": Training(LADDERS, tuple(CLASSICS), 400, seeds=(0,), train_views=60, test_views=3),
    "bandwidth_200": Training(LADDERS, tuple(CLASSICS), 400, seeds=(0,), resolution=200, train_views=60, test_views=3),
    "bandwidth_300": Training(LADDERS, tuple(CLASSICS), 400, seeds=(0,), resolution=300, train_views=60, test_views=3),
    "objections": Training(OBJECTED, tuple(CLASSICS), 1000, seeds=(0,)),
    "no_silhouettes": Training(
        WITHOUT_SILHOUETTES, tuple(CLASSICS), 1000, seeds=(0,), need=("outside_hull", "background_rays")
    ),
    "box_own": Training(DENSITIES, tuple(CLASSICS), 200, seeds=TEN, checkpoints=1),
    "box_1_5": Training(DENSITIES, THIN, 200, seeds=TEN, checkpoints=1, half_side=1.5),
    "box_1_8": Training(DENSITIES, THIN, 200, seeds=TEN[:5], checkpoints=1, half_side=1.8),
    "box_2_4": Training(DENSITIES, THIN, 200, seeds=TEN[:5], checkpoints=1, half_side=2.4),
}


@dataclass(frozen=True)
class EvidenceContext(TrainedContext):
    command = "nox -s evidence"

    def settings(self) -> dict[str, object]:
        interest = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
        return {"quick": self.quick, "device": self.machine.device, "smallest_of_interest": interest}

    def plan(self, name: str) -> Plan:
        """Return the profile `reduced` with the changes of the named training, in float32 if the processor has no
        bfloat16 matrix multiplications. With `quick` it is far too short for any figure to mean anything.
        """
        training, profile = TRAININGS[name], PROFILES["reduced"]
        size, seeds, steps = training.resolution, training.seeds, training.steps
        views = replace(profile.views, resolution=size, train=training.train_views, test=training.test_views)
        if (half := training.half_side) is not None:
            views = replace(views, region=Region((-half, -half, -half, half, half, half)))
        train = profile.train if self.as_planned else replace(profile.train, precision="float32")
        views, train = replace(views, need=training.need), kept(train, training.need)
        if self.quick:
            views = replace(views, resolution=12 + size // 25, train=6, val=2, test=2, spp_train=4, spp_test=4)
            seeds, steps = seeds[:2], 4
        return replace(
            profile.without_extras(),
            scenes=training.scenes,
            methods=training.methods,
            seeds=seeds,
            budget=Budget(steps=steps, seconds=None),
            score=replace(profile.score, checkpoints=training.checkpoints, stored_views=0),
            views=views,
            train=train,
        )
