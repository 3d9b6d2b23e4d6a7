"""Image gates: renders by Mitsuba, in a separate process, against the stored mean and variance.

Images are `[batches, height, width, 4]`, linear and premultiplied; a batch is one independent render.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec import structs

from harness.execution.ground_truth import scenes_output
from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import (
    IMAGE_BATCHES,
    IMAGE_RESOLUTION,
    IMAGE_SCENES,
    IMAGE_SPP,
    IMAGE_VIEW,
    REFERENCE_BATCHES,
    RENEWAL_BLOCKS,
)
from harness.gate.limits import Limit, judge
from harness.records.study import Check
from scenes.files.digest import file_digest
from scenes.files.errors import InputError
from scenes.view_sets.images import read_channels, write_channels, write_png
from scenes.view_sets.pixels import display_from_linear, over_white

LARGEST_SQUARE = 25.0
"""The value at which a pixel's squared deviation is cut, so that single pixels do not dominate the mean."""
ENLARGED = 6
"""The side of an image's pixel in a picture, in pixels."""


@dataclass(frozen=True)
class Reference:
    """The stored appearance of a scene: mean and variance of `batches` renders, float64 [height, width, 4]."""

    mean: np.ndarray
    variance: np.ndarray
    """The variance of one render of `spp` samples."""
    batches: int
    spp: int

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mean).all() and np.isfinite(self.variance).all() and (self.variance >= 0).all()):
            raise ValueError("mean or variance is not finite, or a variance is below 0")
        if self.mean.shape != self.variance.shape or not self.mean[..., :3].any():
            raise ValueError(f"mean {self.mean.shape} and variance {self.variance.shape} do not match, or all is black")

    @staticmethod
    def of(renders: np.ndarray, spp: int) -> "Reference":
        x = np.asarray(renders, dtype=np.float64)
        return Reference(x.mean(axis=0), x.var(axis=0, ddof=1), len(x), spp)

    def variances(self) -> np.ndarray:
        """Return the stored variance as if one more sample, as bright as the brightest pixel, had hit every pixel.

        All samples of the reference may miss a surface that barely touches a pixel. Its variance is then 0, and the
        first hit would be infinitely unlikely.
        """
        variances: np.ndarray = self.variance + (self.mean.max() / self.spp) ** 2 / self.batches
        return variances


def biases(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Return the excess brightness of each render over the reference, in % [batches]: the least-squares slope of its
    colour over the reference's, pixels weighted by their precision, minus 1.
    """
    r = reference.mean[..., :3]
    weighted = r / reference.variances()[..., :3]
    difference = np.asarray(renders, dtype=np.float64)[..., :3] - r
    percent: np.ndarray = 100.0 * np.einsum("hwc,bhwc->b", weighted, difference) / float((weighted * r).sum())
    return percent


def mean_square(renders: np.ndarray, reference: Reference) -> float:
    """Return the mean over pixels and channels of the squared deviation of the renders' mean, in standard errors, each
    square cut at 25.

    It is well below 1 without a difference: empty pixels and the opacity of full pixels do not deviate, and the floor
    of `variances` reduces the deviation of dark pixels. So the usual value of a scene is measured, not derived.
    """
    x = np.asarray(renders, dtype=np.float64)
    z2 = standardised(x.mean(axis=0), reference, len(x)) ** 2
    # np.minimum passes NaN on, so that a single NaN makes the mean NaN
    return float(np.minimum(z2, LARGEST_SQUARE).mean())


def standardised(images: np.ndarray, reference: Reference, count: int = 1) -> np.ndarray:
    """Return the deviation of means of `count` renders [..., height, width, 4] in joint standard errors."""
    x = np.asarray(images, dtype=np.float64)
    deviations: np.ndarray = (x - reference.mean) / np.sqrt(reference.variances() * (1 / count + 1 / reference.batches))
    return deviations


def largest(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Return the largest deviation of any pixel of each render [batches], in standard deviations of one render."""
    return np.asarray(np.abs(standardised(renders, reference)).max(axis=(1, 2, 3)))


Renders = dict[str, np.ndarray]
"""Scene → [batches, height, width, 4], linear and premultiplied."""


def scenes_of(names: Iterable[str]) -> tuple[str, ...]:
    named = {name.split(".")[1] for name in names}
    return tuple(scene for scene in IMAGE_SCENES if scene in named or "all" in named)


def references_for(context: GateContext) -> dict[str, Reference]:
    """Read the references of the limits; raises `InputError` if one is missing or was changed."""
    facts, references = context.limits.kinds.get("images"), {}
    for scene in scenes_of(context.of_kind("images")):
        references[scene], file = read_reference(context.images, scene), context.images / f"{scene}.exr"
        if facts is not None and facts.files.get(file.name) != file_digest(file):
            raise InputError(
                f"{file}: not the image that the limits were measured against; get both back from version control, or "
                "renew both with `python -m harness gate --renew --only images`"
            )
    return references


@complete("images")
def measure(context: GateContext) -> Iterator[Check]:
    """Render and compare, and leave pictures of failures; raises the errors of `references_for`."""
    references = references_for(context)
    renders = rendered(tuple(references), "gate", IMAGE_BATCHES, context.scratch)
    figures = figures_of(renders, references, context.limits.limits)
    for name, gate in context.of_kind("images").items():
        if name not in figures:
            yield judge(gate, [], "the limits of the scenes, which weight them, are missing")
            continue
        check = judge(gate, figures[name], context.limits.limit_of(gate))
        _, scene, test = name.split(".")
        if check.is_broken and scene in renders:
            folder = context.out / "failed" / name
            leave_pictures(folder, renders[scene], references[scene], test)
            check = structs.replace(check, why="; ".join(filter(None, (check.why, f"pictures: {folder}"))))
        yield check


def figures_of(
    renders: Renders, references: dict[str, Reference], limits: Mapping[str, Limit] | None = None
) -> dict[str, list[float]]:
    """Return the measurements for each gate of these scenes; every `IMAGE_BATCHES` renders are those of one run. The
    scenes are weighted by the spreads of the biases' limits, or of the biases themselves without limits.
    """
    figures = {}
    for scene, images in renders.items():
        blocks = np.split(images, len(images) // IMAGE_BATCHES)
        figures[f"images.{scene}.bias"] = biases(images, references[scene]).tolist()
        figures[f"images.{scene}.pixels"] = [mean_square(block, references[scene]) for block in blocks]
        figures[f"images.{scene}.largest"] = largest(images, references[scene]).tolist()
    shifts = {name: np.array(figures[name]) for name in (f"images.{scene}.bias" for scene in sorted(renders))}
    if limits is None:
        spreads = [float(shift.std(ddof=1)) for shift in shifts.values()]
    else:
        spreads = [limits[name].spread or 0.0 if name in limits else 0.0 for name in shifts]
    if spreads and all(spreads):
        weights = np.array(spreads, dtype=np.float64) ** -2.0
        pooled = np.einsum("s,sb->b", weights / weights.sum(), np.stack(list(shifts.values())))
        figures["images.all.bias"] = pooled.tolist()
    return figures


def renew(context: GateContext) -> dict[str, list[float]]:
    """Render and store new references, and return the measurements of further renders, from which limits are made.
    All scenes are renewed together, as an image and its limits belong together.
    """
    reference_renders = rendered(IMAGE_SCENES, "reference", REFERENCE_BATCHES, context.scratch)
    further = rendered(IMAGE_SCENES, "renewal", RENEWAL_BLOCKS * IMAGE_BATCHES, context.scratch)
    references = {scene: store(context.images, scene, reference_renders[scene]) for scene in IMAGE_SCENES}
    return figures_of(further, references)


def rendered(scenes: tuple[str, ...], stream: str, count: int, out: Path) -> Renders:
    """Render with `python -m scenes repeats`, with the errors of `scenes_output`."""
    folder = out / "renders" / stream
    size = {"view": IMAGE_VIEW, "resolution": IMAGE_RESOLUTION, "spp": IMAGE_SPP}
    scenes_output("repeats", str(folder), *scenes, stream=stream, count=count, **size)
    return {scene: np.load(folder / f"{scene}.npy", allow_pickle=False).astype(np.float64) for scene in scenes}


def store(folder: Path, scene: str, renders: np.ndarray) -> Reference:
    """Write mean and variance, and return them as read back, in single precision."""
    folder.mkdir(parents=True, exist_ok=True)
    reference = Reference.of(renders, IMAGE_SPP)
    channels = {name: reference.mean[..., i] for i, name in enumerate("RGBA")}
    channels |= {f"V.{name}": reference.variance[..., i] for i, name in enumerate("RGBA")}
    write_channels(folder / f"{scene}.exr", channels)
    return read_reference(folder, scene)


def read_reference(folder: Path, scene: str) -> Reference:
    """Read a reference; raises `InputError` for a missing or damaged file."""
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


def leave_pictures(folder: Path, renders: np.ndarray, reference: Reference, test: str) -> None:
    """Write PNGs of the renders' mean (for `largest`, of the render that deviates most), the reference, and their
    difference in standard deviations: grey at 0, black and white at ± 5.
    """
    worst = renders[int(np.argmax(largest(renders, reference)))]
    image, count = (worst, 1) if test == "largest" else (renders.mean(axis=0), len(renders))
    z = standardised(image, reference, count)
    shown, expected = (over_white(display_from_linear(np.nan_to_num(pixels))) for pixels in (image, reference.mean))
    difference = 0.5 + np.nan_to_num(z[..., :3]) / 10.0
    folder.mkdir(parents=True, exist_ok=True)
    for name, pixels in {"image": shown, "reference": expected, "difference": difference}.items():
        enlarged = np.clip(pixels, 0.0, 1.0).repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)
        opaque = np.ones((*enlarged.shape[:2], 1))
        write_png(folder / f"{name}.png", np.concatenate([enlarged, opaque], axis=-1))
