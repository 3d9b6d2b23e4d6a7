"""A trained method behind a cache (Listing 5)."""

from typing import Any

import numpy as np

from harness.playback.disk import frozen as frozen_picture
from harness.playback.keys import camera_key, method_digest, plain_calls, switches
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, render_view

CHANNELS = 5
"""The number of channels: red, green, blue; opacity; depth."""


class CachedMethod:
    """A method that renders views, or returns those rendered before: the same bits, as arrays that cannot be written,
    also if they were rendered just now; `torch.from_numpy` warns of them, `torch.tensor` copies.

    Weights are part of the key. They are hashed once, and again after a training step or under another switch of torch:
    nobody may change them otherwise.
    """

    def __init__(self, learner: Learner, store: ViewStore, chunk: int, levels: tuple[int, ...] = (1, 2)) -> None:
        self.learner = learner
        self.store = store
        self.chunk = chunk
        self.levels = levels
        self._plain = plain_calls(chunk)
        self._known: tuple[tuple[Any, ...], bytes] | None = None

    def render(self, camera: Camera) -> View:
        """Return the view; rendered and kept if it is not in the store. Raises `Diverged` on a pixel not finite."""
        key = self.key(camera)
        if (hit := self._lookup(key, camera)) is not None:
            return hit[0]
        picture = picture_of(render_view(self.learner, camera.cameras(self.learner.device), 0, self.chunk))
        if self.key(camera) == key:  # nobody has trained it meanwhile
            self.store.store(key, picture, self.levels)
        return view_of(picture)

    def key(self, camera: Camera, calls: str | None = None) -> str:
        """Return the key of a view with rays put into chunks as `calls` describes, by default those of rendering."""
        return camera_key(self._method_digest(), camera, calls or self._plain)

    def lookup(self, camera: Camera, calls: str | None = None) -> tuple[View, int] | None:
        """Return the view and the level at which it was found; nothing is rendered."""
        return self._lookup(self.key(camera, calls), camera)

    def keep(self, camera: Camera, view: View, calls: str | None = None) -> None:
        """Store a view of this camera that the caller has rendered with the method as it is now."""
        self.store.store(self.key(camera, calls), picture_of(view), self.levels)

    def _lookup(self, key: str, camera: Camera) -> tuple[View, int] | None:
        picture, level = self.store.get_with_level(key) or (None, 0)
        if picture is None or picture.shape != (camera.height, camera.width, CHANNELS):
            return None
        return view_of(picture), level

    def _method_digest(self) -> bytes:
        now = self.learner.step, switches(self.learner.device.type == "cuda")
        if self._known is None or self._known[0] != now:
            self._known = now, method_digest(self.learner)
        return self._known[1]


def picture_of(view: View) -> np.ndarray:
    """Return colour, opacity and depth as one read-only float32 [height, width, 5]; errors as those of `frozen`."""
    return frozen_picture(np.concatenate([view.colour, view.opacity[..., None], view.depth[..., None]], axis=-1))


def view_of(picture: np.ndarray) -> View:
    """Return views into a picture of `picture_of`; nothing is copied."""
    return View(picture[..., :3], picture[..., 3], picture[..., 4])
