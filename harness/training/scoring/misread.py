"""Whether pictures of other programs seem to be in another order, colour space or orientation than they are read in.

A wrong reading costs 5 to 20 dB, which is not the method's fault. So the usual mistakes are tried, and pictures that
would fit the truth far better if one was made are not scored silently.
"""

from collections.abc import Callable, Sequence

import numpy as np

from harness.training.scoring.evaluate import spread_indices
from harness.training.scoring.metrics import mse
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.pixels import area_average, encode_srgb, over_white

FAR = 2.0
"""The factor of the mean squared error, 3 dB, by which another reading must be nearer to the truth."""
FITS = 0.01
"""The mean squared error, 20 dB, that the other reading must reach: a method's failure must not pass as a mistake."""
FAR_ALONE = 8.0
"""The factor for a single view, if the others are read correctly."""
IDENTICAL = 2e-6
"""The mean squared error, 57 dB, below which pictures are copies of the truth; rounding to 8 bits gives 1.3e-6."""
MOST_TRIED = 12
THUMBNAIL = 32
"""The width of the pictures with which views are distinguished."""


Images = ImageStack | Sequence[np.ndarray]
Reading = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A picture [h, w, 3 or 4] and the truth [h, w, 4] → the two colours that are compared, [h, w, 3] each."""


def as_read(picture: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both in display colour over white; a picture without alpha counts as over white already."""
    return (picture if picture.shape[-1] == 3 else over_white(picture)), over_white(truth)


def _over_black(picture: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return picture[..., :3], truth[..., :3] * truth[..., 3:]


def _premultiplied(picture: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return picture[..., :3] + (1.0 - picture[..., 3:]), over_white(truth)


def _changed(change: Callable[[np.ndarray], np.ndarray]) -> Reading:
    def reading(picture: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        image, white = as_read(picture, truth)
        return change(image), white

    return reading


READINGS: dict[str, Reading] = {
    "rendered over black: render over white, or save alpha": _over_black,
    "premultiplied by alpha: save straight alpha, or put them over white": _premultiplied,
    "linear light: encode them as sRGB": _changed(encode_srgb),
    "blue, green, red: save red first": _changed(lambda image: image[..., ::-1]),
    "upside down: turn them over": _changed(lambda image: image[::-1]),
    "mirrored: turn them over": _changed(lambda image: image[:, ::-1]),
}
"""The mistake with its remedy → how pictures are compared if it was made. Encoding twice is not among them, as a method
whose density is too low looks the same.
"""


def likely_mistake(pictures: Images, truths: Images) -> str | None:
    """Return what the pictures seem to be instead, with the remedy; None if they are nearest to the truth as read."""
    tried = spread_indices(MOST_TRIED, len(truths))
    own = np.array([mse(*as_read(pictures[view], truths[view])) for view in tried])
    if own.max() < IDENTICAL:
        return "seem to be copies of the truth: give the rendered ones"
    impossible = _premultiplied if pictures[0].shape[-1] == 3 else _over_black
    for mistake, reading in READINGS.items():
        if reading is impossible:
            continue
        errors = np.array([mse(*reading(pictures[view], truths[view])) for view in tried])
        if errors.mean() < FITS and (FAR * errors < own).mean() > 0.9:
            return f"seem to be {mistake}"
        if len(odd := np.flatnonzero((errors < FITS) & (FAR_ALONE * errors < own))):
            return f"of {len(odd)} of {len(tried)} views, such as view {tried[int(odd[0])]}, seem to be {mistake}"
    return _other_order(pictures, truths, tried)


def _other_order(pictures: Images, truths: Images, tried: list[int]) -> str | None:
    """Return a message if most pictures show other views, and different ones: an empty picture is near to only one."""
    white = [_small(over_white(truths[view])) for view in range(len(truths))]
    nearest = []
    for view in tried:
        small = _small(as_read(pictures[view], truths[view])[0])
        errors = [mse(small, other) for other in white]
        far = min(errors) < FITS and FAR * min(errors) < errors[view]
        nearest.append(int(np.argmin(errors)) if far else view)
    moved = [(view, other) for view, other in zip(tried, nearest, strict=True) if view != other]
    if 2 * len(moved) <= len(tried) or 2 * len({other for _, other in moved}) <= len(moved):
        return None
    view, other = moved[0]
    return f"seem to be in another order, the picture of view {view} shows view {other}: name them as the views are"


def _small(image: np.ndarray) -> np.ndarray:
    return area_average(image, min(THUMBNAIL, image.shape[1]))
