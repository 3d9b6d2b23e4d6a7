"""Whether pictures of others seem to be in another order, colour space or orientation than they are read in.

A wrong reading costs a method 5 to 20 dB that are not the method's. So every usual mistake is tried, and a picture that
fits the truth far better under one is not scored in silence.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from harness.training.scoring.metrics import mse
from scenes.view_sets.pixels import area_average, encode_srgb, over_white

FAR = 2.0
"""The factor of the mean square error, 3 dB, by which another reading must be nearer to the truth."""
FITS = 0.01
"""The mean square error, 20 dB, that the other reading must reach: a method that fails is not to be explained away."""
MOST_TRIED = 12
THUMBNAIL = 32
"""The width of the pictures in which views are told from one another."""


class Images(Protocol):
    """Images by number: a list, or files that are read one at a time."""

    def __len__(self) -> int: ...
    def __getitem__(self, index: int, /) -> np.ndarray: ...


Reading = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""A picture [h, w, 3 or 4] and the truth [h, w, 4] → what of them is compared, [h, w, 3] each."""


def as_read(picture: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both in display colour over white; a picture without alpha is taken to be over white already."""
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
"""What the pictures seem to be and the remedy → how they are compared then. Encoding twice is not among them: so does a
method look whose density is too low."""


def likely_mistake(pictures: Images, truths: Images) -> str | None:
    """Return what the pictures [h, w, 3 or 4] of the views seem to be instead, with the remedy; None if they are
    nearest to the truth [h, w, 4] as they are read.
    """
    tried = np.unique(np.linspace(0, len(truths) - 1, min(MOST_TRIED, len(truths))).round().astype(int))
    own = np.array([mse(*as_read(pictures[int(view)], truths[int(view)])) for view in tried])
    for mistake, reading in READINGS.items():
        if reading is _premultiplied and pictures[0].shape[-1] == 3:
            continue
        if reading is _over_black and pictures[0].shape[-1] == 4:
            continue
        errors = np.array([mse(*reading(pictures[int(view)], truths[int(view)])) for view in tried])
        if errors.mean() < FITS and (FAR * errors < own).mean() > 0.9:
            return f"seem to be {mistake}"
    return _other_order(pictures, truths, tried)


def _other_order(pictures: Images, truths: Images, tried: np.ndarray) -> str | None:
    """Return that most pictures show other views, each another one: a picture of nothing is near to one view alone."""
    white = [_small(over_white(truths[view])) for view in range(len(truths))]
    nearest = []
    for view in tried:
        small = _small(as_read(pictures[int(view)], truths[int(view)])[0])
        errors = [mse(small, other) for other in white]
        far = min(errors) < FITS and FAR * min(errors) < errors[view]
        nearest.append(int(np.argmin(errors)) if far else int(view))
    moved = [(int(view), other) for view, other in zip(tried, nearest, strict=True) if view != other]
    if 2 * len(moved) <= len(tried) or 2 * len({other for _, other in moved}) <= len(moved):
        return None
    view, other = moved[0]
    return f"seem to be in another order, the picture of view {view} shows view {other}: name them as the views are"


def _small(image: np.ndarray) -> np.ndarray:
    return area_average(image, min(THUMBNAIL, image.shape[1]))
