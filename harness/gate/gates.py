"""The gates: one table made from a few literal settings."""

from dataclasses import dataclass
from typing import Any, Literal

Kind = Literal["changed", "worse", "images", "fairness", "speed"]
Rule = Literal["mean", "largest", "none_differs", "of_class"]
KINDS: tuple[Kind, ...] = ("changed", "worse", "images", "fairness", "speed")

TRAINED_SCENES = ("lego", "drums", "hotdog")
TRAINED_METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_repaired")
HEADLINES = (("qnerf", "nerf"), ("qnerf", "nerf_matched"))
SCORES = {"psnr": "dB", "ssim": "", "depth_rmse": "half boxes"}
STEPS = 150
RESOLUTION = 40
GATE_SEEDS = (1000, 1001, 1002, 1003)
DRAWS = 2
"""The trainings of each cell at renewal that differ in the last bit of their first weights alone: the spread that
rounding causes.
"""

LARGEST_LOSS = {"psnr": 0.1, "ssim": 0.004, "depth_rmse": 0.02}
"""The amount by which the mean over all cells may be worse than the stored one, in the score's unit: half of the 0.2 dB
that must be detected. That of a single method may be twice as much.
"""
LARGEST_SHIFT = 0.2
"""The amount in dB by which a headline may differ from the stored one."""
SLOWER_FOUND = 1.5
"""The slowdown that must be detected; the limit is the square root of it."""
FACTORS = {"double": 1e4, "single": 10.0}
"""Precision → the factor by which the first steps may deviate by more than all measured reorderings."""
WIDER = {"changed": 10.0, "worse": 2.0, "speed": 1.5}
"""Kind → the factor by which its limits are wider on a class of processor that has no references."""

IMAGE_SCENES = ("lego", "drums", "hotdog", "materials")
IMAGE_VIEW = 30
"""The index of the view, of the 200 test views."""
IMAGE_RESOLUTION = 48
IMAGE_SPP = 256
IMAGE_BATCHES = 16
"""The independent renders of `IMAGE_SPP` samples per pixel that a gate examines."""
REFERENCE_BATCHES = 96
"""The renders that the stored mean and variance are made of."""
RENEWAL_BLOCKS = 10
"""The times `IMAGE_BATCHES` further renders that limits are made of."""

SPEED_REPEATS = 25
RENEWAL_PROCESSES = 4


@dataclass(frozen=True)
class Gate:
    """One figure that is compared with limits."""

    name: str
    kind: Kind
    what: str
    unit: str
    rule: Rule
    """The rule by which limits follow from what was measured (`harness.gate.limits`, `harness.gate.references`)."""
    new: int = 1
    """The measurements that the gate's figure is made from."""


def gates() -> tuple[Gate, ...]:
    """Return all gates, in the order in which they are shown."""
    return (*_changed(), *_worse(), *_images(), *_fairness(), *_speed())


STARTS = ("nerf", "nerf_matched", "nerf_fine", "qnerf", "qnerf_stirred", "qnerf_listing4", "qnerf_repaired")
"""The trainings whose first steps are recorded (`harness.gate.early`)."""


def _changed() -> list[Gate]:
    found = [
        Gate("changed.settings", "changed", "settings of the profiles that are not the stored ones", "", "none_differs")
    ]
    for precision in ("double", "single"):
        for start in STARTS:
            what = f"{start}: largest relative deviation of the first losses and renders, in {precision} precision"
            found.append(Gate(f"changed.{precision}.{start}", "changed", what, "", "of_class"))
    return found


def _worse() -> list[Gate]:
    found = []
    for method in ("all", *TRAINED_METHODS):
        for score, unit in SCORES.items():
            of = "all methods" if method == "all" else method
            what = f"{score} of {of}, cell by cell against the stored one of the same seed, mean over cells"
            found.append(Gate(f"worse.{method}.{score}", "worse", what, unit, "of_class"))
    for method, against in HEADLINES:
        what = f"PSNR of {method} less that of {against} over scenes, against the stored one"
        found.append(Gate(f"worse.headline.{method}_{against}", "worse", what, "dB", "of_class"))
    what = "numbers of the stored cells' comparisons that the comparer now gives otherwise"
    return [*found, Gate("worse.headline.statistics", "worse", what, "", "none_differs")]


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
    def gate(name: str, what: str) -> Gate:
        return Gate(f"fairness.{name}", "fairness", what, "", "none_differs")

    return [
        gate("first_weights", "first weights that differ where methods share name and shape"),
        gate("batches", "batches that are not those of the first method at the same step"),
        *(
            gate(f"copies.{method}", f"weights and scores in which two copies of {method} differ")
            for method in TRAINED_METHODS
        ),
        gate("compared_copies", "comparisons of copies that see a difference"),
    ]


def _speed() -> list[Gate]:
    def gate(name: str, what: str) -> Gate:
        return Gate(f"speed.{name}", "speed", f"{what}, times as long as when it was stored", "×", "of_class")

    return [
        *(gate(f"train.{method}", f"a training step of {method} beside a plain one") for method in TRAINED_METHODS),
        *(gate(f"render.{method}", f"a view of {method} beside a plain one") for method in ("nerf", "qnerf")),
        gate("score", "all scores of a view beside a fixed filter"),
    ]


def settings_of(kind: Kind) -> dict[str, Any]:
    """Return the settings that limits of a kind are only valid for, as JSON, without those whose change shows as a
    failing gate.
    """
    found: dict[Kind, dict[str, Any]] = {
        "changed": {"starts": list(STARTS)},
        "worse": {
            "steps": STEPS,
            "resolution": RESOLUTION,
            "scenes": list(TRAINED_SCENES),
            "methods": list(TRAINED_METHODS),
            "seeds": list(GATE_SEEDS),
            "draws": DRAWS,
        },
        "images": {
            "view": IMAGE_VIEW,
            "resolution": IMAGE_RESOLUTION,
            "spp": IMAGE_SPP,
            "reference_batches": REFERENCE_BATCHES,
        },
        "speed": {"repeats": SPEED_REPEATS},
    }
    return found.get(kind, {})
