"""Image gates: renders by Mitsuba, in a process of its own, against the stored mean and variance.

Images are `[batches, height, width, 4]`, linear and premultiplied; a batch is one independent render.
"""

import hashlib
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.gate.gates import (
    IMAGE_BATCHES,
    IMAGE_RESOLUTION,
    IMAGE_SCENES,
    IMAGE_SPP,
    IMAGE_VIEW,
    REFERENCE_BATCHES,
    RENEWAL_BLOCKS,
    Gate,
)
from harness.gate.outcome import GateContext, Pictures, Sample
from scenes.files.errors import InputError
from scenes.view_sets.images import read_channels, write_channels
from scenes.view_sets.pixels import display_from_linear, over_white

LARGEST_SQUARE = 25.0
"""The value at which a pixel's squared deviation is cut, so that the mean is about all pixels; single ones have a test
of their own.
"""


@dataclass(frozen=True)
class Reference:
    """The stored appearance of a scene."""

    mean: np.ndarray
    """The mean, float64 [height, width, 4]."""
    variance: np.ndarray
    """The variance of one render of `spp` samples, float64 [height, width, 4]."""
    batches: int
    """The renders that both were made of."""
    spp: int

    def __post_init__(self) -> None:
        """Raises `ValueError` for a reference that nothing can be compared with."""
        if not (np.isfinite(self.mean).all() and np.isfinite(self.variance).all() and (self.variance >= 0).all()):
            raise ValueError("mean or variance is not finite, or a variance is below 0")
        if self.mean.shape != self.variance.shape or not self.mean[..., :3].any():
            raise ValueError(f"mean {self.mean.shape} and variance {self.variance.shape} do not fit, or all is black")

    @staticmethod
    def of(renders: np.ndarray, spp: int) -> "Reference":
        x = np.asarray(renders, dtype=np.float64)
        return Reference(x.mean(axis=0), x.var(axis=0, ddof=1), len(x), spp)

    def variances(self) -> np.ndarray:
        """Return the stored variance as if one sample more, as bright as the brightest pixel, had hit every pixel once.

        A pixel that a surface touches by a hair may have been missed by all samples of the reference: its variance
        is then 0, and the first hit would be infinitely unlikely.
        """
        return self.variance + (self.mean.max() / self.spp) ** 2 / self.batches


def biases(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Return how much brighter each render is than the reference, in % [batches]: the least-squares slope of its colour
    over the reference's, pixels weighted by their precision, minus 1.
    """
    r = reference.mean[..., :3]
    weighted = r / reference.variances()[..., :3]
    difference = np.asarray(renders, dtype=np.float64)[..., :3] - r
    return 100.0 * np.einsum("hwc,bhwc->b", weighted, difference) / float((weighted * r).sum())


def mean_square(renders: np.ndarray, reference: Reference) -> float:
    """Return the mean over pixels and channels of the squared deviation of the renders' mean, in standard errors, each
    cut at 25.

    Well below 1 where nothing differs: empty pixels and the opacity of full ones count and do not deviate, and the
    floor of `variances` makes dark ones deviate by less. What is usual for a scene is measured, not derived.
    """
    z2 = standardised(renders, reference) ** 2
    # a pixel that is not finite makes the whole so: np.minimum hands NaN on
    return float(np.minimum(z2, LARGEST_SQUARE).mean())


def standardised(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Return the deviation of the renders' mean from the reference's [height, width, 4], in standard errors of both."""
    x = np.asarray(renders, dtype=np.float64)
    return (x.mean(axis=0) - reference.mean) / np.sqrt(reference.variances() * (1 / len(x) + 1 / reference.batches))


def largest(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Return the largest deviation of any pixel of each render [batches], in standard deviations of one render."""
    x = np.asarray(renders, dtype=np.float64)
    z = np.abs(x - reference.mean) / np.sqrt(reference.variances() * (1 + 1 / reference.batches))
    return z.max(axis=(1, 2, 3))


def pooled(by_scene: list[np.ndarray], spreads: list[float]) -> np.ndarray:
    """Pool the biases [batches] of several scenes, weighted by their precision."""
    weights = np.array(spreads, dtype=np.float64) ** -2.0
    return np.asarray(np.einsum("s,sb->b", weights / weights.sum(), np.stack(by_scene)))


Renders = dict[str, np.ndarray]
"""Scene → [batches, height, width, 4], linear and premultiplied."""


def scenes_of(gates: Iterable[Gate]) -> tuple[str, ...]:
    """Return the scenes whose renders these gates need."""
    names = {gate.name.split(".")[1] for gate in gates}
    return tuple(scene for scene in IMAGE_SCENES if scene in names or "all" in names)


def measure(situation: GateContext, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    """Render and compare. Raises `InputError` as `references_for`."""
    scenes = scenes_of(gates)
    references = references_for(situation, gates)
    shown = rendered(scenes, "gate", IMAGE_BATCHES, situation.out)
    spreads = {
        scene: limit.spread
        for scene in scenes
        if (limit := situation.limits.limits.get(f"images.{scene}.bias")) is not None and limit.spread
    }
    return samples(gates, shown, references, spreads)


def references_for(situation: GateContext, gates: tuple[Gate, ...]) -> dict[str, Reference]:
    """Read the references. Raises `InputError` for one that is missing, damaged or not the one of the limits."""
    return {scene: stored(situation, scene) for scene in scenes_of(gates)}


def samples(
    gates: Iterable[Gate], renders: Renders, references: dict[str, Reference], spreads: dict[str, float]
) -> dict[str, Sample]:
    """Return one sample for each gate; `spreads` of the biases weigh the scenes."""
    shifts = {scene: biases(renders[scene], references[scene]) for scene in renders}
    found = {}
    for gate in gates:
        _, scene, test = gate.name.split(".")
        if scene == "all":
            known = sorted(spreads)
            if set(known) != set(renders):
                found[gate.name] = Sample([], "the scenes' own limits, which weigh them, are missing")
            else:
                found[gate.name] = Sample(
                    pooled([shifts[one] for one in known], [spreads[one] for one in known]).tolist()
                )
            continue
        values = values_of(test, renders[scene], references[scene])
        found[gate.name] = Sample(values, pictures=pictures_of(renders[scene], references[scene], test))
    return found


def values_of(test: str, renders: np.ndarray, reference: Reference) -> list[float | None]:
    """Return the figures of one test: one per render, or one of all."""
    if test == "bias":
        return list(biases(renders, reference))
    if test == "largest":
        return list(largest(renders, reference))
    return [mean_square(renders, reference)]


def renew(situation: GateContext) -> dict[str, list[float]]:
    """Render references anew, store them, and measure further renders against them, which limits are made of.

    All scenes are renewed together: an image and its limits belong together.
    """
    reference_renders = rendered(IMAGE_SCENES, "reference", REFERENCE_BATCHES, situation.out)
    further = rendered(IMAGE_SCENES, "renewal", RENEWAL_BLOCKS * IMAGE_BATCHES, situation.out)
    found: dict[str, list[float]] = {}
    shifts, references = {}, {}
    for scene in IMAGE_SCENES:
        # as it is read back, in single precision
        references[scene] = reference = store(situation.images, scene, reference_renders[scene])
        shifts[scene] = biases(further[scene], reference)
        found[f"images.{scene}.bias"] = shifts[scene].tolist()
        found[f"images.{scene}.largest"] = largest(further[scene], reference).tolist()
        found[f"images.{scene}.pixels"] = [
            mean_square(block, reference) for block in np.split(further[scene], RENEWAL_BLOCKS)
        ]
    spreads = [float(shifts[scene].std(ddof=1)) for scene in sorted(shifts)]
    found["images.all.bias"] = pooled([shifts[scene] for scene in sorted(shifts)], spreads).tolist()
    return found


def rendered(scenes: tuple[str, ...], stream: str, count: int, out: Path) -> Renders:
    """Render by `python -m scenes repeats`. Raises `InputError` with its error output; if Dr.Jit ends the process, what
    is missing is rendered with `scalar_rgb`.
    """
    folder = out / "renders" / stream
    folder.mkdir(parents=True, exist_ok=True)
    ended = _render(scenes, stream, count, folder, ())
    if ended.returncode < 0:
        ended = _render(scenes, stream, count, folder, ("--variant", "scalar_rgb"))
    if ended.returncode == 2:
        raise InputError(ended.stderr.strip().removeprefix("scenes: "))
    if ended.returncode:
        raise RuntimeError(f"rendering ended with exit code {ended.returncode}: {ended.stderr[-2000:]}")
    return {scene: np.load(folder / f"{scene}.npy", allow_pickle=False).astype(np.float64) for scene in scenes}


def _render(
    scenes: tuple[str, ...], stream: str, count: int, folder: Path, options: tuple[str, ...]
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "scenes", "repeats", str(folder), *scenes, "--stream", stream]
    for name, value in {"view": IMAGE_VIEW, "resolution": IMAGE_RESOLUTION, "spp": IMAGE_SPP, "count": count}.items():
        command += [f"--{name}", str(value)]
    return subprocess.run([*command, *options], capture_output=True, text=True, check=False)


def store(folder: Path, scene: str, renders: np.ndarray) -> Reference:
    """Write mean and variance and return them as they are read back."""
    folder.mkdir(parents=True, exist_ok=True)
    reference = Reference.of(renders, IMAGE_SPP)
    channels = {name: reference.mean[..., i] for i, name in enumerate("RGBA")}
    channels |= {f"V.{name}": reference.variance[..., i] for i, name in enumerate("RGBA")}
    write_channels(folder / f"{scene}.exr", channels)
    return read_reference(folder, scene)


def read_reference(folder: Path, scene: str) -> Reference:
    """Read a reference. Raises `InputError` for a file that is missing or damaged."""
    file = folder / f"{scene}.exr"
    channels = read_channels(file)
    remedy = "get it back from version control, or renew with `python -m harness gate --renew --only images`"
    try:
        mean, variance = (
            np.stack([channels[f"{prefix}{name}"] for name in "RGBA"], axis=-1).astype(np.float64)
            for prefix in ("", "V.")
        )
        if mean.shape[:2] != (IMAGE_RESOLUTION, IMAGE_RESOLUTION):
            raise ValueError(f"{mean.shape[1]} × {mean.shape[0]} pixels, {IMAGE_RESOLUTION} are rendered")
        return Reference(mean, variance, REFERENCE_BATCHES, IMAGE_SPP)
    except (KeyError, ValueError) as error:
        raise InputError(f"{file}: no mean and variance of renders ({error}); {remedy}") from error


def stored(situation: GateContext, scene: str) -> Reference:
    """Return the reference that the limits were measured against; raises `InputError` for another one."""
    facts = situation.limits.kinds.get("images")
    reference = read_reference(situation.images, scene)
    name = f"{scene}.exr"
    if facts is not None and facts.files.get(name) != digest(situation.images / name):
        raise InputError(
            f"{situation.images / name}: not the image that the limits were measured against; get both back from "
            "version control, or renew both with `python -m harness gate --renew --only images`"
        )
    return reference


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def pictures_of(renders: np.ndarray, reference: Reference, test: str) -> Pictures:
    """Return the renders' mean, or for `largest` the render that deviates most; the difference is in standard
    deviations, grey if nothing differs, black and white at ± 5.
    """
    if test == "largest":
        image = renders[int(np.argmax(largest(renders, reference)))]
        z = (image - reference.mean) / np.sqrt(reference.variances() * (1 + 1 / reference.batches))
    else:
        image, z = renders.mean(axis=0), standardised(renders, reference)
    first, second = (over_white(display_from_linear(np.nan_to_num(one))) for one in (image, reference.mean))
    return Pictures(first, second, np.clip(0.5 + np.nan_to_num(z[..., :3]) / 10.0, 0.0, 1.0))
