"""Scores of pictures that another program rendered of a view set's test views, by our metrics."""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from harness.records.metric_table import METRICS
from harness.records.scored_pictures import ScoredPictures
from harness.training.scoring.evaluate import View, mean_scores, view_scores
from harness.training.scoring.lpips import lpips_of
from harness.training.scoring.misread import as_read, likely_mistake
from scenes.files.errors import InputError
from scenes.view_sets.formats.rendered_pictures import of_views, pictures_in, read_picture
from scenes.view_sets.images import display_image
from scenes.view_sets.view_set import ViewSet, read_view_set

SCORED = tuple(name for name, metric in METRICS.items() if metric.compares in ("colour", "features"))


class _Pictures:
    """Pictures that are read when they are asked for: two hundred need not be in memory."""

    def __init__(self, files: Sequence[Path], width: int, height: int) -> None:
        self.files, self.width, self.height = files, width, height

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> np.ndarray:
        file = self.files[index]
        pixels = read_picture(file, self.width)
        if pixels.shape[:2] != (self.height, self.width):
            shape, held = f"{pixels.shape[1]} × {pixels.shape[0]}", f"{self.width} × {self.height}"
            raise InputError(f"{file}: {shape} pixels, the test views have {held}; render the view set's own cameras")
        return pixels


def score_pictures(
    folder: Path,
    view_set: Path,
    method: str,
    *,
    scene: str | None = None,
    seed: int = 0,
    seconds: float | None = None,
    resolution: int | None = None,
    as_they_are: bool = False,
    lpips: Path | None = None,
    each: Callable[[int, int], None] = lambda done, total: None,
) -> ScoredPictures:
    """Return the scores of the pictures in `folder` at `resolution` pixels of width (default: their own).

    `each` is told how many of the views are done. Raises `InputError` for pictures that are not those of the test
    views, and for those that seem to be meant otherwise than they are read, unless they are to be scored
    `as_they_are`. `lpips` is the file of its weights.
    """
    distance = None if lpips is None else lpips_of(lpips)
    found = pictures_in(folder)
    width = resolution or display_image(found[0]).shape[1]
    views = read_view_set(view_set, width, splits=("test",), geometry=())
    if not len(views.test.rgba):
        raise InputError(f"{view_set}: has no test view; nothing can be scored")
    files = of_views(found, views.test.names)
    pictures = _Pictures(files, views.width, views.height)
    if not as_they_are and (mistake := likely_mistake(pictures, views.test.rgba)):
        raise InputError(f"{files[0].parent}: the pictures {mistake}; if they are meant as they are, --as-they-are")
    rows = []
    for index, view in enumerate(_as_views(pictures, views)):
        rows.append(view_scores(view, views.test, index, SCORED, distance))
        each(index + 1, len(files))
    scores = {name: score for name, score in mean_scores(rows).items() if name in SCORED}
    return ScoredPictures(
        scene=scene or views.name,
        method=method,
        seed=seed,
        seconds=seconds,
        views=rows,
        made={
            "pictures": str(folder),
            "digest": _digest(files),
            "view_set": str(view_set),
            "width": views.width,
            "as_they_are": as_they_are,
            "lpips": None if distance is None else distance.digest,
        },
        **scores,
    )


def _as_views(pictures: _Pictures, views: ViewSet) -> Iterator[View]:
    nothing = np.zeros((views.height, views.width), dtype=np.float32)
    for index, truth in enumerate(views.test.rgba):
        yield View(as_read(pictures[index], truth)[0], nothing, nothing)


def _digest(files: Sequence[Path]) -> str:
    """Return the SHA-256 of the pictures' bytes in the order of the views."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()
