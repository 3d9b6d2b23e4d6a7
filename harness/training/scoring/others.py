"""Scores of pictures that another program rendered of a view set's test views."""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import torch

from harness.records.metric_table import METRICS
from harness.records.scored_pictures import ScoredPictures
from harness.training.kinds.given_splats import given_gaussians
from harness.training.scoring.evaluate import View, cameras_of, mean_scores, view_scores
from harness.training.scoring.lpips import lpips_of
from harness.training.scoring.misread import as_read, likely_mistake
from scenes.files.digest import file_digest
from scenes.files.errors import InputError
from scenes.view_sets.formats.rendered_pictures import of_views, pictures_in, read_picture
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.images import display_image
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet, read_view_set

SCORED = tuple(name for name, metric in METRICS.items() if metric.compares in ("colour", "features"))


def _picture(file: Path, views: ViewSet) -> np.ndarray:
    pixels = read_picture(file, views.width)
    if pixels.shape[:2] != (views.height, views.width):
        shape, held = f"{pixels.shape[1]} × {pixels.shape[0]}", f"{views.width} × {views.height}"
        raise InputError(f"{file}: {shape} pixels, the test views have {held}; render the view set's own cameras")
    return pixels


def _alike(pictures: Iterable[np.ndarray]) -> Iterator[np.ndarray]:
    """Yield each with or without alpha as the first one is: programs that write PNG leave out an opaque alpha."""
    channels = None
    for picture in pictures:
        channels = channels or picture.shape[2]
        if picture.shape[2] > channels:
            yield over_white(picture)
        elif picture.shape[2] < channels:
            yield np.dstack((picture, np.ones_like(picture[..., :1])))
        else:
            yield picture


def _drawn(file: Path, views: ViewSet) -> ImageStack:
    """Draw the Gaussians of a .ply file once from each test camera."""
    field = given_gaussians(file, views.focal)
    cameras = cameras_of(views, views.test, torch.device("cpu"))
    drawn = (field.render(cameras.all_rays(index)).colour for index in range(len(cameras)))
    return ImageStack.of(colour.numpy().reshape(views.height, views.width, 3) for colour in drawn)


def _checked(pictures: Sequence[np.ndarray]) -> list[np.ndarray]:
    given = [np.asarray(picture) for picture in pictures]
    first = given[0].shape if given else ()
    if len(first) != 3 or 0 in first or first[2] not in (3, 4):
        raise InputError(f"pictures of shape {first}: give one [height, width, 3 or 4] of each test view")
    for view, picture in enumerate(given):
        if picture.shape != first:
            raise InputError(f"picture {view}: has the shape {picture.shape}, the first {first}")
        if picture.dtype != np.uint8 and not (picture.min() >= 0.0 and picture.max() <= 1.0):
            ends = f"{picture.min():g} to {picture.max():g}"
            raise InputError(f"picture {view}: has values from {ends}; give uint8, or floats from 0 to 1")
    return given


def score_pictures(
    pictures: Path | Sequence[np.ndarray],
    view_set: Path,
    method: str,
    *,
    resolution: int | None = None,
    as_they_are: bool = False,
    lpips: Path | None = None,
    each: Callable[[int, int], None] = lambda done, total: None,
) -> ScoredPictures:
    """Return the scores of pictures of the test views, under the name of the view set and seed 0.

    `pictures` is a folder, compared at `resolution` pixels of width (default: their own width); a .ply of Gaussians,
    drawn at that width (default: that of the view set) in its units; or the images in the order of the views: display
    colour [h, w, 3], or [h, w, 4] with straight alpha, uint8 or floats from 0 to 1. `lpips` is the file of its weights;
    `each` gets the numbers of scored and of all views. Raises `InputError` for pictures of other views and, unless
    `as_they_are`, for pictures that seem to be misread.
    """
    distance = None if lpips is None else lpips_of(lpips)
    images, digest, views, where = _read(pictures, view_set, resolution)
    if not as_they_are and (mistake := likely_mistake(images, views.test.rgba)):
        raise InputError(f"{where}: the pictures {mistake}; if they are meant as they are, --as-they-are")
    rows, nothing = [], np.zeros((views.height, views.width), dtype=np.float32)
    for index, truth in enumerate(views.test.rgba):
        view = View(as_read(images[index], truth)[0], nothing, nothing)
        rows.append(view_scores(view, views.test, index, SCORED, distance))
        each(index + 1, len(images))
    scores = {name: score for name, score in mean_scores(rows).items() if name in SCORED}
    return ScoredPictures(
        scene=views.name,
        method=method,
        seed=0,
        views=rows,
        made={
            "pictures": str(pictures) if isinstance(pictures, Path) else "arrays",
            "digest": digest,
            "view_set": str(view_set),
            "width": views.width,
            "as_they_are": as_they_are,
            "lpips": None if distance is None else distance.digest,
            "lpips_network": None if distance is None else distance.network,
        },
        **scores,
    )


def _read(
    pictures: Path | Sequence[np.ndarray], view_set: Path, resolution: int | None
) -> tuple[ImageStack, str, ViewSet, Path]:
    """Return the pictures with their digest, the truth at their size, and the folder that an error names."""
    if isinstance(pictures, Path) and pictures.suffix.lower() == ".ply":
        views = _truth(view_set, resolution)
        return _drawn(pictures, views), file_digest(pictures), views, pictures
    if isinstance(pictures, Path):
        paths = pictures_in(pictures)
        views = _truth(view_set, resolution or display_image(paths[0]).shape[1])
        files = of_views(paths, views.test.names)
        images = ImageStack.of(_alike(_picture(file, views) for file in files))
        return images, _digest(file.read_bytes() for file in files), views, files[0].parent
    arrays = _checked(pictures)
    shape = (len(arrays), *arrays[0].shape[:2])
    views = _truth(view_set, shape[2])
    if shape != views.test.rgba.shape[:3]:
        raise InputError(
            f"{view_set}: its test views are {views.test.rgba.shape[:3]} (views, height, width), the pictures "
            f"{shape}; give one of each view, in their order"
        )
    images = ImageStack.of(array.astype(np.float32) / (255.0 if array.dtype == np.uint8 else 1.0) for array in arrays)
    return images, _digest(np.ascontiguousarray(array).tobytes() for array in arrays), views, view_set


def _truth(view_set: Path, width: int | None) -> ViewSet:
    views = read_view_set(view_set, width, splits=("test",), geometry=())
    if not len(views.test.rgba):
        raise InputError(f"{view_set}: has no test view; nothing can be scored")
    return views


def _digest(parts: Iterable[bytes]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()
