"""The samples per pixel of ground truth, chosen from the noise of a few views that are rendered with few samples.

The noise of n samples is a / n, from light and materials, plus b / n^1.5, from edges and textures, where the sampler's
strata help; two numbers of samples give a and b. These views have separate seeds, so the choice is reproducible with
the same variant. Another variant may choose the next number up or down; the manifest records it.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from scenes.rendering.order import NoiseTarget
from scenes.rendering.render import LoadedScene, RenderError, display_noise, seed_from

PILOT_SPP = (4, 16)
PILOT_VIEWS = 6


def chosen_samples(
    scene: LoadedScene, spp: Mapping[str, int | NoiseTarget], poses: Mapping[str, np.ndarray]
) -> tuple[dict[str, int], dict[str, dict[str, object]]]:
    """Return the samples per pixel of each split, and facts about each choice for the manifest.

    `poses` holds the cameras [n, 4, 4] of each split. Splits with equal targets share their views and the choice.
    Raises `RenderError` for an image that is not finite.
    """
    numbers = {split: value for split, value in spp.items() if isinstance(value, int)}
    facts: dict[str, dict[str, object]] = {}
    for target in dict.fromkeys(value for value in spp.values() if isinstance(value, NoiseTarget)):
        splits = [split for split, value in spp.items() if value == target]
        cameras = np.concatenate([poses[split] for split in splits])
        number, about = min(target.least, target.most), asdict(target)
        if len(cameras) and number < target.most:
            noise = pilot_noise(scene, cameras)
            number = samples_for(target, *noise)
            about["pilot_mse"] = {f"{count} samples": mse for count, mse in zip(PILOT_SPP, noise, strict=True)}
        numbers |= dict.fromkeys(splits, number)
        facts |= {split: about for split in splits if len(poses[split])}
    return {split: numbers[split] for split in spp}, facts


def samples_for(target: NoiseTarget, few: float, more: float) -> int:
    """Return the samples per pixel, from the mean square noise with the smaller and the larger of `PILOT_SPP`.

    The result is 2 k² or 2 k (k + 1), which fill the sampler's grid of strata in both halves of an image, or a limit.
    """
    a, b = noise_curve(few, more)
    allowed = 10.0 ** (-target.ceiling_db / 10.0)
    grids = (2 * columns * rows for columns in range(1, target.most) for rows in (columns, columns + 1))
    enough = (spp for spp in grids if spp >= target.least and a / spp + b / spp**1.5 <= allowed)
    return min(next(enough, target.most), target.most)


def noise_curve(few: float, more: float) -> tuple[float, float]:
    """Return a and b, not negative, of a / n + b / n^1.5 through `few` and `more` at `PILOT_SPP`; only through `more`
    where noise falls faster or more slowly than such a curve can, as with rare bright samples.
    """
    n, m = PILOT_SPP
    b = (few * n - more * m) / (n**-0.5 - m**-0.5)
    b = min(max(b, 0.0), more * m**1.5)
    return more * m - b * m**-0.5, b


def pilot_noise(scene: LoadedScene, cameras: np.ndarray) -> tuple[float, float]:
    """Return the mean square noise of a display image with each of `PILOT_SPP`: means over `PILOT_VIEWS` views spread
    evenly over `cameras` [n, 4, 4].
    """
    places = sorted({round(place) for place in np.linspace(0, len(cameras) - 1, PILOT_VIEWS)})
    few, more = (
        float(np.mean([_noise(scene, cameras[place], spp, place) for place in places])) for spp in PILOT_SPP
    )  # fmt: skip
    return few, more


def _noise(scene: LoadedScene, camera: np.ndarray, spp: int, place: int) -> float:
    noise = display_noise(*(scene.colour(camera, spp // 2, seed_from("pilot", spp, place, half)) for half in "ab"))
    if not math.isfinite(noise):
        raise RenderError(f"view {place}, rendered to learn its noise, has pixels that are not finite; fix the scene")
    return noise
