"""The gates: a table made from a few literal settings."""

from dataclasses import dataclass
from typing import Literal, cast, get_args

Kind = Literal["changed", "worse", "families", "images", "fairness", "speed"]
KINDS: tuple[Kind, ...] = get_args(Kind)

TRAINED_SCENES = ("lego", "drums", "hotdog")
TRAINED_METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_repaired")
HEADLINES = (("qnerf", "nerf"), ("qnerf", "nerf_matched"))
SCORES = {"psnr": "dB", "ssim": "", "depth_rmse": "half boxes"}
STEPS = 150
RESOLUTION = 40
GATE_SEEDS = (1000, 1001, 1002, 1003)
OTHER_SEEDS = (1004, 1005, 1006, 1007)
"""The seeds that only a renewal trains, for the spread of seeds."""
DRAWS = 8
"""The trainings of each cell at renewal, which differ in the last bit of their first weights: the rounding spread."""

Scatter = Literal["rounding", "change", "seeds"]
FALSE_ALARMS: dict[Scatter, float] = {"rounding": 0.01, "change": 0.05, "seeds": 0.05}
"""The scatter by which `worse` is judged → the share of harmless changes in which one of its gates fails."""
LOSS_OVER_ALL = 0.05
LOSS_OF_ONE = 0.15
"""The losses in dB, over all cells and of one method on one scene, whose probability of detection is printed."""
TOLERANCES = {"double": 1e-6, "single": 1e-2}
"""Precision → the largest allowed deviation of the first steps: 1e4 times and ten times the measured effect of other
orders of sums, processors or numbers of threads.
"""
SLOWER_FOUND = 1.5
"""The slowdown that must be detected; the limit is its square root."""

FAMILIES = ("planes", "planes_phi", "hash_grid", "hash_grid_phi", "splats", "ellipsoids", "voxels_drjit")
FAMILY_SCENE = "lego"
FAMILY_SEEDS = (900, 901)
FAMILY_RENEWAL = tuple(range(1000, 1012))
"""The seeds of a gate's trainings, and of those from which its limits are made."""

IMAGE_SCENES = ("lego", "drums", "hotdog", "materials")
IMAGE_VIEW = 30
"""The index of the view among the 200 test views."""
IMAGE_RESOLUTION = 48
IMAGE_SPP = 256
IMAGE_BATCHES = 16
"""The independent renders of `IMAGE_SPP` samples per pixel that a gate examines."""
REFERENCE_BATCHES = 96
"""The renders from which the stored mean and variance are made."""
RENEWAL_BLOCKS = 10
"""The number of further sets of `IMAGE_BATCHES` renders, from which limits are made."""

SPEED_REPEATS = 25
RENEWAL_PROCESSES = 4


@dataclass(frozen=True)
class Start:
    method: str
    fine_bins: int = 0
    stirred: bool = False
    """Whether the amplifier starts at values at which it acts, and raw densities at several units."""


STARTS = {
    "nerf": Start("nerf"),
    "nerf_matched": Start("nerf_matched"),
    "nerf_fine": Start("nerf", fine_bins=16),
    "qnerf": Start("qnerf"),
    "qnerf_stirred": Start("qnerf", stirred=True),
    "qnerf_listing4": Start("qnerf_listing4"),
    "qnerf_repaired": Start("qnerf_repaired"),
}


@dataclass(frozen=True)
class Gate:
    """A figure that is compared with limits."""

    name: str
    """The kind, then what identifies the gate within the kind, joined by dots."""
    what: str
    unit: str = ""
    new: int = 1
    """The number of measurements that make up the gate's figure."""

    @property
    def kind(self) -> Kind:
        return cast("Kind", self.name.partition(".")[0])

    @property
    def is_largest(self) -> bool:
        """Return whether its figure is the largest measurement; otherwise it is their mean."""
        return self.name.endswith(".largest")


def gates() -> tuple[Gate, ...]:
    table = [Gate("changed.settings", "settings of the profiles that differ from the stored ones")]
    what = "largest relative deviation of the first losses and renders"
    for precision in TOLERANCES:
        table += [Gate(f"changed.{precision}.{name}", f"{name}: {what}, in {precision} precision") for name in STARTS]
    what = "difference from the stored cell of the same seed, mean over cells"
    for method in ("all", *TRAINED_METHODS):
        of = "all methods" if method == "all" else method
        table += [Gate(f"worse.{method}.{score}", f"{score} of {of}, {what}", unit) for score, unit in SCORES.items()]
    for method in TRAINED_METHODS:
        what = "difference from the stored cells of the same seeds"
        table += [
            Gate(f"worse.{method}.{scene}.psnr", f"psnr of {method} on {scene}, {what}", "dB")
            for scene in TRAINED_SCENES
        ]
    for method, against in HEADLINES:
        what = f"PSNR of {method} − PSNR of {against} over scenes, difference from the stored value"
        table.append(Gate(f"worse.headline.{method}_{against}", what, "dB"))
    what = "numbers in the comparison of stored cells that now differ"
    table.append(Gate("worse.headline.statistics", what))
    what = f"a short training on {FAMILY_SCENE}, mean PSNR of {len(FAMILY_SEEDS)} seeds"
    table += [Gate(f"families.{name}", f"{name}: {what}", "dB", len(FAMILY_SEEDS)) for name in FAMILIES]
    for scene in IMAGE_SCENES:
        what = f"{scene}: brightness − the reference's, pixels weighted by their precision"
        table.append(Gate(f"images.{scene}.bias", what, "%", IMAGE_BATCHES))
        what = f"{scene}: mean squared deviation of pixels in standard errors, each square cut at 25"
        table.append(Gate(f"images.{scene}.pixels", what))
        what = f"{scene}: largest deviation of a pixel of one render, in standard deviations"
        table.append(Gate(f"images.{scene}.largest", what, "σ", IMAGE_BATCHES))
    what = "all scenes: brightness − the reference's, scenes weighted by their precision"
    table.append(Gate("images.all.bias", what, "%", IMAGE_BATCHES))
    table.append(Gate("fairness.first_weights", "first weights that differ in tensors of the same name and shape"))
    table.append(Gate("fairness.batches", "batches that differ from the first method's at the same step"))
    for method in TRAINED_METHODS:
        what = f"weights and scores in which two copies of {method} differ"
        table.append(Gate(f"fairness.copies.{method}", what))
    table.append(Gate("fairness.compared_copies", "comparisons of copies that find a difference"))
    timed = {f"train.{method}": f"a training step of {method} relative to a plain one" for method in TRAINED_METHODS}
    timed |= {f"render.{method}": f"a view of {method} relative to a plain one" for method in ("nerf", "qnerf")}
    timed["score"] = "all scores of a view relative to those by other libraries"
    table += [Gate(f"speed.{name}", f"{what}, divided by the stored value", "×") for name, what in timed.items()]
    return tuple(table)


def settings_of(kind: Kind) -> dict[str, object]:
    """Return, as JSON, the settings for which the stored values of a kind are valid."""
    settings: dict[Kind, dict[str, object]] = {
        "changed": {"starts": list(STARTS)},
        "worse": {
            "steps": STEPS,
            "resolution": RESOLUTION,
            "scenes": list(TRAINED_SCENES),
            "methods": list(TRAINED_METHODS),
            "seeds": list(GATE_SEEDS),
            "other_seeds": list(OTHER_SEEDS),
            "draws": DRAWS,
        },
        "families": {"steps": STEPS, "resolution": RESOLUTION, "scene": FAMILY_SCENE, "seeds": list(FAMILY_RENEWAL)},
        "images": {
            "view": IMAGE_VIEW,
            "resolution": IMAGE_RESOLUTION,
            "spp": IMAGE_SPP,
            "reference_batches": REFERENCE_BATCHES,
        },
        "speed": {"repeats": SPEED_REPEATS},
    }
    return settings.get(kind, {})
