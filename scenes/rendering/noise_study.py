"""The noise of a render: stored views compared with new renders of them, and error against samples per pixel.

Colours are compared over white, as in scores; `MEASURES` names the two measures.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.catalog.entries import scene_named
from scenes.files.errors import InputError
from scenes.rendering.render import LoadedScene, RenderError, seed_from
from scenes.rendering.store import check_resolution
from scenes.rendering.variant import Variant
from scenes.view_sets.formats.transforms import read_transforms
from scenes.view_sets.images import read_channels
from scenes.view_sets.manifest import checked, read_manifest
from scenes.view_sets.pixels import decode_srgb, display_from_linear, over_white
from scenes.view_sets.viewpoints import all_poses

MEASURES = ("display", "linear")
"""Display colour over white, as in PSNR, and the same in linear light, as in `rmse_linear`."""


@dataclass(frozen=True)
class Rerender:
    """A stored view and renders of it with other random numbers, by the same procedure: two halves each."""

    scene: str
    view: str
    stored: float
    """The manifest's value: the mean square error of the display image over white that noise causes."""
    again: float
    """The measured noise of one of these images: half the mean square difference of two."""
    halves: float
    """The manifest's formula applied to the new renders."""
    spp: int
    variant: str


@dataclass(frozen=True)
class Errors:
    """The errors of renders of one view with `spp` samples per pixel."""

    scene: str
    spp: int
    seconds: list[float]
    """The seconds of each render after the first one, in which kernels may be compiled."""
    mse: dict[str, list[float]]
    """Map measure (`MEASURES`) → mean square error of each render, less the variance of the reference."""
    reference_spp: int
    reference_mse: dict[str, float]
    """Map measure → variance of the reference, from its two halves."""
    variant: str


def rerender(folder: Path, repeats: int, variant: Variant) -> Iterator[Rerender]:
    """Render every test view of a stored view set `repeats` times. Raises `InputError` for a foreign or damaged set."""
    if repeats < 1:
        raise InputError(f"--repeats {repeats}: choose 1 or more")
    manifest = read_manifest(folder)
    if not manifest:
        raise InputError(f"{folder}: not a rendered view set; name a folder that `python -m scenes render` has made")
    if not manifest["counts"]["test"]:
        raise InputError(f"{folder}: has no test views; render some with --test")
    scene, spp = scene_named(manifest["scene"]), int(manifest["spp"]["test"])
    loaded = LoadedScene.of(scene, variant, manifest["resolution"], integrator=manifest["integrator"])
    frames = read_transforms(folder, "test")
    for file, pose in zip(frames.files, frames.camera_to_world, strict=True):
        name = file.relative_to(folder.resolve()).with_suffix("").as_posix()
        channels = read_channels(checked(folder, file.with_suffix(".exr"), manifest))
        linear = np.stack([channels[channel] for channel in "RGBA"], axis=-1)
        noise, halves = rerender_noise(loaded, linear, pose, spp, repeats, name)
        stored = float(manifest["views"][name]["noise_mse"])
        yield Rerender(scene.name, name, stored, noise, halves, spp, variant.name)


def rerender_noise(
    loaded: LoadedScene, stored: np.ndarray, pose: np.ndarray, spp: int, repeats: int, name: str
) -> tuple[float, float]:
    """Return `Rerender.again` and `Rerender.halves` of a view: `stored` [h, w, 4] is linear and premultiplied."""
    images, halves = [as_scored(stored)], []
    for number in range(repeats):
        a, b = (loaded.colour(pose, math.ceil(spp / 2), seed_from("again", name, number, half)) for half in "ab")
        images.append(as_scored((a + b) / 2))
        halves.append(mean_square(as_scored(a) - as_scored(b)) / 4)
    # the variance of a sample is half of the mean square difference of its pairs
    return float(np.var(images, axis=0, ddof=1).mean()), float(np.mean(halves))


def errors(
    scene_name: str, resolution: int, spp: Sequence[int], reference_spp: int, repeats: int, variant: Variant
) -> Iterator[Errors]:
    """Measure a test view of a scene of the catalogue. Raises `InputError` for an unknown scene or invalid counts."""
    if not spp or min(spp) < 1 or repeats < 1:
        raise InputError(f"--spp {' '.join(map(str, spp))} --repeats {repeats}: choose 1 or more")
    if reference_spp < 2:
        raise InputError(f"--reference-spp {reference_spp}: two halves are needed to know its noise; choose 2 or more")
    check_resolution(resolution)
    scene = scene_named(scene_name)
    pose = all_poses("test", scene.view_from)[0]
    loaded = LoadedScene.of(scene, variant, resolution)
    yield from errors_of(loaded, scene.name, pose, spp, reference_spp, repeats, variant.name)


def errors_of(
    loaded: LoadedScene, name: str, pose: np.ndarray, spp: Sequence[int], reference_spp: int, repeats: int, variant: str
) -> Iterator[Errors]:
    """Measure a loaded scene. One render more than `repeats` is made, and not timed."""
    half = math.ceil(reference_spp / 2)
    a, b = (_finite(loaded.colour(pose, half, seed_from("reference", which))) for which in "ab")
    reference = {measure: in_measure((a + b) / 2, measure) for measure in MEASURES}
    own = {measure: mean_square(in_measure(a, measure) - in_measure(b, measure)) / 4 for measure in MEASURES}
    for count in spp:
        seconds: list[float] = []
        mse: dict[str, list[float]] = {measure: [] for measure in MEASURES}
        for repetition in range(repeats + 1):
            began = time.perf_counter()
            image = _finite(loaded.colour(pose, count, seed_from("work", count, repetition)))
            seconds.append(time.perf_counter() - began)
            for measure in MEASURES:
                mse[measure].append(mean_square(in_measure(image, measure) - reference[measure]) - own[measure])
        yield Errors(name, count, seconds[1:], mse, 2 * half, own, variant)


def in_measure(linear: np.ndarray, measure: str) -> np.ndarray:
    """Map linear premultiplied [h, w, 4] to colour over white [h, w, 3], float64."""
    display = as_scored(linear)
    return display if measure == "display" else decode_srgb(display)


def as_scored(linear: np.ndarray) -> np.ndarray:
    """Map linear premultiplied [h, w, 4] to display colour over white, as a score sees a stored view."""
    return over_white(display_from_linear(linear)).astype(np.float64)


def mean_square(difference: np.ndarray) -> float:
    return float(np.mean(difference**2))


def _finite(image: np.ndarray) -> np.ndarray:
    if not np.isfinite(image).all():
        raise RenderError(f"{int((~np.isfinite(image)).sum())} values of a render are not finite; fix the scene")
    return image
