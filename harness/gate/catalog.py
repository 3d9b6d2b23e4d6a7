"""The gates: one table made from a few literal settings, as every limit depends on how many there are."""

from dataclasses import dataclass
from typing import Any, Literal

Kind = Literal["training", "images", "fairness", "speed"]
Rule = Literal["mean", "null", "largest", "slower", "none_differs", "false_calls", "found"]
KINDS: tuple[Kind, ...] = ("training", "images", "fairness", "speed")

FALSE_ALARM = 0.01
"""How often the whole suite may fail where nothing changed."""

TRAINED_SCENES = ("lego", "drums", "hotdog")
TRAINED_METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_repaired")
SCORES = {"psnr": "dB", "ssim": "", "depth_rmse": "scene units"}
STEPS = 150
RESOLUTION = 40
GATE_SEEDS = (1000, 1001)
AGAIN_SEEDS = (1002, 1003)
"""Of `nerf` once more: the other arm of the A/A comparison."""
RENEWAL_SEEDS = tuple(range(2000, 2012))

IMAGE_SCENES = ("lego", "drums", "hotdog", "materials")
IMAGE_VIEW = 30
"""Of the 200 test views."""
IMAGE_RESOLUTION = 48
IMAGE_SPP = 256
IMAGE_BATCHES = 16
"""Independent renders of `IMAGE_SPP` samples a pixel that a gate looks at."""
REFERENCE_BATCHES = 96
"""Renders that the stored mean and variance are made of."""
RENEWAL_BLOCKS = 10
"""Times `IMAGE_BATCHES` further renders that limits are made of."""

SPEED_REPEATS = 25
RENEWAL_PROCESSES = 8
SPEED_MARGIN = 1.5
"""Another processor has another ratio of a training step to the calibration kernel: by how much is declared here, not
measured."""


@dataclass(frozen=True)
class Gate:
    """One figure that is held to limits."""

    name: str
    kind: Kind
    what: str
    unit: str
    rule: Rule
    """How limits follow from what was measured (`harness.gate.limits`)."""
    new: int = 1
    """Measurements that the gate's figure is made from."""


def gates() -> tuple[Gate, ...]:
    """All of them, in the order in which they are shown."""
    return (*_training(), *_images(), *_fairness(), *_speed())


def _training() -> list[Gate]:
    found = []
    for scene in (*TRAINED_SCENES, "all"):
        for method in TRAINED_METHODS:
            for score, unit in SCORES.items():
                where = "mean over the scenes" if scene == "all" else scene
                what = f"{score} of {method}, {where}, after {STEPS} steps"
                name = f"training.{scene}.{method}.{score}"
                found.append(Gate(name, "training", what, unit, "mean", len(GATE_SEEDS)))
    return found


def _images() -> list[Gate]:
    found = []
    for scene in IMAGE_SCENES:
        found += [
            Gate(
                f"images.{scene}.bias",
                "images",
                f"{scene}: brightness less the reference's, pixels weighted by their precision",
                "%",
                "mean",
                IMAGE_BATCHES,
            ),
            Gate(
                f"images.{scene}.pixels",
                "images",
                f"{scene}: mean square of the pixels' deviations in standard errors, each cut at 25",
                "",
                "mean",
            ),
            Gate(
                f"images.{scene}.largest",
                "images",
                f"{scene}: largest deviation of a pixel of one render, in standard deviations",
                "σ",
                "largest",
                IMAGE_BATCHES,
            ),
        ]
    what = "all scenes: brightness less the reference's, scenes weighted by their precision"
    return [*found, Gate("images.all.bias", "images", what, "%", "mean", IMAGE_BATCHES)]


def _fairness() -> list[Gate]:
    def gate(name: str, what: str, rule: Rule, unit: str = "", new: int = 1) -> Gate:
        return Gate(f"fairness.{name}", "fairness", what, unit, rule, new)

    return [
        gate("first_weights", "first weights that differ where methods share name and shape", "none_differs"),
        gate("batches", "batches that are not those of the first method at the same step", "none_differs"),
        *(
            gate(f"copies.{method}", f"weights and scores in which two copies of {method} differ", "none_differs")
            for method in TRAINED_METHODS
        ),
        gate("compared_copies", "comparisons of copies that see a difference", "none_differs"),
        *(
            gate(f"a_a.{score}", f"{score} of nerf less that of nerf with other seeds", "null", unit, len(GATE_SEEDS))
            for score, unit in SCORES.items()
        ),
        gate("false_calls", "share of simulated A/A comparisons that are called better or worse", "false_calls"),
        gate("found", "share of planted effects found, of the size that is found in 80 %", "found"),
    ]


def _speed() -> list[Gate]:
    found = [
        Gate(f"speed.train.{method}", "speed", f"a training step of {method} in calibration kernels", "×", "slower")
        for method in TRAINED_METHODS
    ]
    found += [
        Gate(f"speed.render.{method}", "speed", f"a rendered view of {method} in calibration kernels", "×", "slower")
        for method in ("nerf", "qnerf")
    ]
    return [*found, Gate("speed.score", "speed", "all scores of a view in calibration kernels", "×", "slower")]


def settings_of(kind: Kind) -> dict[str, Any]:
    """What limits of a kind are only valid for, as JSON. What a change of shows as a failing gate is not in it."""
    training = {"steps": STEPS, "resolution": RESOLUTION}
    found: dict[Kind, dict[str, Any]] = {
        "training": training,
        "images": {
            "view": IMAGE_VIEW,
            "resolution": IMAGE_RESOLUTION,
            "spp": IMAGE_SPP,
            "reference_batches": REFERENCE_BATCHES,
        },
        "fairness": training,
        "speed": {"repeats": SPEED_REPEATS, "margin": SPEED_MARGIN},
    }
    return found[kind]
