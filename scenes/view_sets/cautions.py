"""What a reader of scores on a view set must know about its images and cameras."""

from hashlib import blake2b

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.view_set import Split, ViewSet
from scenes.view_sets.visibility import LEAST_COVERED, Visibility, likely_cause, visibility_of

THIN = (0.1, 0.4)
"""The range of alphas that straight colours often exceed, and premultiplied colours never."""
LEAST_THIN = 100
"""The minimum number of such pixels, of all training views, for a conclusion."""
BRIGHT = 0.5
"""The median of the largest channel of opaque pixels below which straight colours seldom exceed their alpha."""
HARDLY = 0.5
"""The share of covered pixels below which poses are refused if another reading of them sees the box, and below which a
single camera is named if the others see it.
"""
INVERTED = 0.9
"""The mean alpha at the border, and transparency in the middle, of all pictures, from which alpha seems inverted."""
NOTHING = "no training view has a covered pixel"
ELSE = "choose a box around the object, in the units of the poses (--bounds)"


def cautions(views: ViewSet, visible: Visibility) -> list[str]:
    """Return sentences for a reader of scores on these views, whose training cameras see as `visible` says.

    Raises `InputError`, with the likely cause, if no ray or no covered pixel of training or test meets the box, or only
    a few do and another reading of the poses would see it.
    """
    sentences = _of_cameras(views, views.train, visible, "training")
    if len(views.test.names):
        sentences += _of_cameras(views, views.test, visibility_of(views, views.test), "test")
    if not any(image[..., 3].any() for image in views.train.rgba):
        if not views.rendered:
            raise InputError(
                f"{views.path}: {NOTHING}; save the object's silhouette as their alpha, or leave alpha out"
            )
        sentences.append(NOTHING)
    elif not views.rendered:
        sentences += _of_alpha(views)
    if is_premultiplied(views):
        sentences.append(
            "colours of half covered pixels never exceed their alpha: they seem premultiplied, straight is read"
        )
    if views.repeated_views:
        sentences.append(f"cameras repeat: {views.repeated_views[0]}{_and_more(len(views.repeated_views) - 1)}")
    if same := _in_both(views):
        (trained, tested), more = same[0], _and_more(len(same) - 1)
        sentences.append(f"test pictures are training pictures: {tested} shows what {trained} shows{more}")
    return sentences


def _and_more(count: int) -> str:
    return f", and {count} more" if count else ""


def _in_both(views: ViewSet) -> list[tuple[str, str]]:
    """Return training and test views with equal pixels, of more than one colour."""

    def digests(split: Split) -> list[bytes]:
        return [blake2b(image.data).digest() if np.ptp(image) > 0.0 else b"" for image in split.rgba]

    trained = dict(zip(digests(views.train), views.train.names, strict=True))
    tested = zip(digests(views.test), views.test.names, strict=True)
    return [(trained[digest], name) for digest, name in tested if digest and digest in trained]


def _of_cameras(views: ViewSet, split: Split, seen: Visibility, what: str) -> list[str]:
    """Return what the cameras of a split do not see; raises `InputError` as `cautions`."""
    box = " ".join(f"{value:.3g}" for value in views.bounds.ravel())
    if seen.share == 0.0 or (seen.covered is not None and seen.covered < LEAST_COVERED):
        pixels = f"{what} rays" if seen.covered is None else f"covered {what} pixels"
        where = f"the box {box} between {views.near:.3g} and {views.far:.3g} from the camera"
        cause = likely_cause(views, split)
        sees = f"{seen.share:.0%} of the {pixels} see {where}; {cause or ELSE}"
        if seen.share == 0.0 or (cause and seen.share < HARDLY):
            raise InputError(f"{views.path}: {sees}")
        return [f"only {sees}"]
    least = 1e-9 if seen.covered is None else HARDLY
    off = np.flatnonzero(seen.views < least)
    if not len(off):
        return []
    names = ", ".join(split.names[number] for number in off[:3])
    more = f" and {len(off) - 3} more" if len(off) > 3 else ""
    pixels = "rays" if seen.covered is None else "covered pixels"
    return [f"{len(off)} of {len(split.names)} {what} cameras see little or nothing of the box with their {pixels}, "
            f"others see it: {names}{more}"]  # fmt: skip


def _of_alpha(views: ViewSet) -> list[str]:
    height, width = views.height, views.width
    middle = np.s_[2 * height // 5 : 3 * height // 5 + 1, 2 * width // 5 : 3 * width // 5 + 1]
    border = np.ones((height, width), dtype=bool)
    border[1:-1, 1:-1] = False
    alphas = (image[..., 3] for image in views.train.rgba)  # one at a time: all of them may not fit into memory
    of_views = [(alpha.min(), alpha[border].mean(), alpha[middle].mean()) for alpha in alphas]
    least, outside, inside = zip(*of_views, strict=True)
    if min(least) == 1.0:
        caution = "no training view has a transparent pixel: the background counts as a part of the object"
        return [] if any("without alpha" in note for note in views.notes) else [caution]
    if np.mean(outside) > INVERTED and np.mean(inside) < 1.0 - INVERTED:
        return ["alpha seems inverted: the middle of the pictures is transparent, their border is not"]
    return []


def is_premultiplied(views: ViewSet) -> bool:
    """Return whether colours look multiplied by their alpha: bright where opaque, and never above alpha where thin."""
    thin, beyond, bright = 0, 0, []
    for image in views.train.rgba:
        largest, alpha = image[..., :3].max(axis=-1), image[..., 3]
        some = (alpha > THIN[0]) & (alpha < THIN[1])
        thin += int(some.sum())
        beyond += int((largest[some] > alpha[some] + 1 / 255).sum())
        if (opaque := alpha == 1.0).any():
            bright.append(float(np.median(largest[opaque])))
    return thin >= LEAST_THIN and not beyond and bool(bright) and float(np.median(bright)) > BRIGHT
