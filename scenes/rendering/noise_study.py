"""The noise of a render: stored views compared with new renders of them, over white, as in scores."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.catalog.entries import scene_named
from scenes.files.errors import InputError
from scenes.rendering.render import LoadedScene, display_noise, seed_from
from scenes.rendering.variant import Variant
from scenes.view_sets.formats.transforms import read_transforms
from scenes.view_sets.images import read_channels
from scenes.view_sets.manifest import checked, read_manifest
from scenes.view_sets.pixels import display_from_linear, over_white


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
        halves.append(display_noise(a, b))
    # the variance of a sample is half of the mean square difference of its pairs
    return float(np.var(images, axis=0, ddof=1).mean()), float(np.mean(halves))


def as_scored(linear: np.ndarray) -> np.ndarray:
    """Map linear premultiplied [h, w, 4] to display colour over white, as a score sees a stored view."""
    return over_white(display_from_linear(linear)).astype(np.float64)
