"""A trained method behind a cache (Listing 5)."""

import numpy as np

from harness.playback.keys import camera_key, method_digest, plain_calls, switches
from harness.playback.store import Place, ViewStore
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View

CHANNELS = 5
"""Red, green, blue; opacity; depth."""


class CachedMethod:
    """The views of a method that were rendered before, bit-identical, as read-only arrays (`torch.tensor` copies them).

    The key includes the weights, which are hashed once, and again after a training step or a change of torch's
    switches; no other change of weights is noticed.
    """

    def __init__(self, learner: Learner, store: ViewStore, chunk: int) -> None:
        self.learner = learner
        self.store = store
        self.chunk = chunk
        self._known: tuple[tuple[object, ...], bytes] | None = None

    def key(self, camera: Camera, calls: str | None = None) -> str:
        """Return the key of a view; `calls` says how rays are put into chunks, by default as `render_view` does."""
        return camera_key(self._method_digest(), camera, calls or plain_calls(self.chunk))

    def lookup(self, camera: Camera, calls: str | None = None) -> tuple[View, Place] | None:
        """Return a stored view and its place, or None; nothing is rendered."""
        hit = self.store.get(self.key(camera, calls), (camera.height, camera.width, CHANNELS))
        return None if hit is None else (view_of(hit[0]), hit[1])

    def keep(self, camera: Camera, view: View, calls: str | None = None) -> None:
        """Store a view of this camera, rendered with the present weights."""
        self.store.store(self.key(camera, calls), picture_of(view))

    def _method_digest(self) -> bytes:
        now = self.learner.step, switches(self.learner.device.type == "cuda")
        if self._known is None or self._known[0] != now:
            self._known = now, method_digest(self.learner)
        return self._known[1]


def picture_of(view: View) -> np.ndarray:
    """Return colour, opacity and depth as one read-only [height, width, 5]; raises `TypeError` unless float32."""
    parts = [view.colour, view.opacity[..., None], view.depth[..., None]]
    picture = np.concatenate(parts, axis=-1, dtype=np.float32, casting="equiv")
    picture.setflags(write=False)
    return picture


def view_of(picture: np.ndarray) -> View:
    """Invert `picture_of`; nothing is copied."""
    return View(picture[..., :3], picture[..., 3], picture[..., 4])
