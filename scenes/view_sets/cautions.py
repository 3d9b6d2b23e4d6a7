"""What a reader of scores on a view set must know about its images and cameras."""

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.sight import LEAST_COVERED, Sight, likely_cause
from scenes.view_sets.view_set import ViewSet

THIN = (0.1, 0.4)
"""The range of alphas that straight colours often exceed, and premultiplied colours never."""
LEAST_THIN = 100
"""The minimum number of such pixels, of all training views, for a conclusion."""
BRIGHT = 0.5
"""The median of the largest channel of opaque pixels below which straight colours seldom exceed their alpha."""
HARDLY = 0.5
"""The share of covered pixels below which poses are refused if another reading of them sees the box."""
NOTHING = "no training view has a covered pixel"
ELSE = "choose a box around the object, in the units of the poses (--bounds)"


def cautions(views: ViewSet, sight: Sight) -> list[str]:
    """Return sentences for a reader of scores on these views.

    Raises `InputError`, with the likely cause, if no training ray or no covered pixel meets the box, or only a few do
    and another reading of the poses would see it.
    """
    sentences = []
    box = " ".join(f"{value:.3g}" for value in views.bounds.ravel())
    if sight.share == 0.0 or (sight.covered is not None and sight.covered < LEAST_COVERED):
        pixels = "training rays" if sight.covered is None else "covered pixels"
        where = f"the box {box} between {views.near:.3g} and {views.far:.3g} from the camera"
        cause = likely_cause(views)
        seen = f"{sight.share:.0%} of the {pixels} see {where}; {cause or ELSE}"
        if sight.share == 0.0 or (cause and sight.share < HARDLY):
            raise InputError(f"{views.path}: {seen}")
        sentences.append(f"only {seen}")
    if not any(image[..., 3].any() for image in views.train.rgba):
        if not views.rendered:
            raise InputError(
                f"{views.path}: {NOTHING}; save the object's silhouette as their alpha, or leave alpha out"
            )
        sentences.append(NOTHING)
    if is_premultiplied(views):
        sentences.append(
            "colours of half covered pixels never exceed their alpha: they seem premultiplied, straight is read"
        )
    if views.repeated_views:
        more = len(views.repeated_views) - 1
        sentences.append(f"cameras repeat: {views.repeated_views[0]}{f', and {more} more' if more else ''}")
    return sentences


def is_premultiplied(views: ViewSet) -> bool:
    """Return whether colours look multiplied by their alpha: bright where a pixel is opaque, and nowhere larger than
    alpha where it is thin.
    """
    thin, beyond, bright = 0, 0, []
    for image in views.train.rgba:
        largest, alpha = image[..., :3].max(axis=-1), image[..., 3]
        some = (alpha > THIN[0]) & (alpha < THIN[1])
        thin += int(some.sum())
        beyond += int((largest[some] > alpha[some] + 1 / 255).sum())
        if (opaque := alpha == 1.0).any():
            bright.append(float(np.median(largest[opaque])))
    return thin >= LEAST_THIN and not beyond and bool(bright) and float(np.median(bright)) > BRIGHT
