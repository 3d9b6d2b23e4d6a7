"""A trained method behind a cache (Listing 5)."""

from typing import Any

import numpy as np
from torch import Tensor, nn

from harness.playback.float_exr import frozen as frozen_picture
from harness.playback.keys import camera_key, method_digest, plain_calls, switches
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.checkpoints import weights_digest
from harness.training.evaluate import View, render_view
from harness.training.learner import Learner

CHANNELS = 5
"""The number of channels: red, green, blue; opacity; depth."""


class CachedMethod:
    """A method that renders views, or returns those rendered before: the same bits, as arrays that cannot be written,
    also if they were rendered just now; `torch.from_numpy` warns of them, `torch.tensor` copies.

    Weights are part of the key, and hashed at every call. With `frozen` the caller promises that nobody trains the
    method: they are then hashed once, and again if a step, a weight that was replaced or written through torch's or
    Dr.Jit's operations, or another switch of torch shows that it was changed all the same. A write through `.data`, or
    through a NumPy array that shares memory, does not show; neither does one by a fused optimiser, but for its step.
    """

    def __init__(
        self, learner: Learner, store: ViewStore, chunk: int, frozen: bool = False, levels: tuple[int, ...] = (1, 2)
    ) -> None:
        self.learner = learner
        self.store = store
        self.chunk = chunk
        self.frozen = frozen
        self.levels = levels
        self._plain = plain_calls(chunk)
        self._modules = _modules_of(learner)
        self._known: tuple[_Fingerprint, bytes] | None = None

    def render(self, camera: Camera, use_cache: bool = True) -> View:
        """Return the view; rendered, and kept, if it is not in the store or shall not be taken from there.

        Raises `harness.training.trainer.Diverged` on a pixel that is not finite.
        """
        key = self.key(camera)
        if use_cache and (found := self._found(key, camera)) is not None:
            return found[0]
        picture = picture_of(render_view(self.learner, camera.cameras(self.learner.device), 0, self.chunk))
        if self.key(camera) == key:  # nobody has trained it meanwhile
            self._store(key, picture)
        return view_of(picture)

    def key(self, camera: Camera, calls: str | None = None) -> str:
        """Return the key of a view with rays put into chunks as `calls` describes; None means those of
        plain rendering.
        """
        return camera_key(self._method_digest(), camera, calls or self._plain)

    def lookup(self, camera: Camera, calls: str | None = None) -> tuple[View, int] | None:
        """Return the view and the level at which it was found; nothing is rendered."""
        return self._found(self.key(camera, calls), camera)

    def keep(self, camera: Camera, view: View, calls: str | None = None) -> None:
        """Store a view that the caller has rendered with the method as it is now.

        Raises `TypeError` and `ValueError` if it is no complete view of this camera.
        """
        picture = picture_of(view)
        if picture.shape[:2] != (camera.height, camera.width):
            raise ValueError(f"a view of {picture.shape[:2]} pixels for a camera of {camera.height} × {camera.width}")
        self._store(self.key(camera, calls), picture)

    def _found(self, key: str, camera: Camera) -> tuple[View, int] | None:
        found = self.store.get_with_level(key)
        if found is None or found[0].shape != (camera.height, camera.width, CHANNELS):
            return None
        return view_of(found[0]), found[1]

    def _store(self, key: str, picture: np.ndarray) -> None:
        self.store.store(key, picture, self.levels)

    def _method_digest(self) -> bytes:
        if not self.frozen:
            return method_digest(self.learner, weights_digest(self.learner))
        now, known = _Fingerprint(self.learner, self._modules), self._known
        if known is None or not known[0].same(now):
            self._modules = _modules_of(self.learner)
            now = _Fingerprint(self.learner, self._modules)
            now.keep_values()
            self._known = known = now, method_digest(self.learner, weights_digest(self.learner))
        return known[1]


def _modules_of(learner: Learner) -> list[nn.Module]:
    return list(learner.fields.modules()) if isinstance(learner.fields, nn.Module) else []


class _Fingerprint:
    """A fingerprint that shows within microseconds that a method may have changed: attributes of the learner that are
    other objects, tensors that are other ones or lie elsewhere, versions that torch counts, and variables of Dr.Jit.
    """

    __slots__ = ("held", "kept", "numbers", "values")

    def __init__(self, learner: Learner, modules: list[nn.Module]) -> None:
        tensors: list[Tensor | None] = [one for module in modules for one in module._parameters.values()]
        tensors += [one for module in modules for one in module._buffers.values()]
        tensors += [one for one in vars(learner).values() if isinstance(one, Tensor)]
        if learner.grid is not None:
            tensors.append(learner.grid.occupied)
        self.values: list[Any] = list(getattr(learner.field, "values", {}).values())
        """The Dr.Jit arrays of a field of voxels."""
        self.held: list[Any] = [*tensors, *self.values, *vars(learner).values()]
        """The objects, held so that none of them can be freed and leave its address to another."""
        self.kept: list[Any] = []
        self.numbers = (
            [(one._version, one.data_ptr()) for one in tensors if one is not None],
            [(one.index, one.index_ad) for one in self.values],
            learner.step,
            switches(learner.device.type == "cuda"),
        )

    def keep_values(self) -> None:
        """Keep second names for the variables of Dr.Jit: as long as there are any, every write makes another variable,
        and no other one is given the number of this.
        """
        self.kept = [type(one)(one) for one in self.values]

    def same(self, other: "_Fingerprint") -> bool:
        return (
            self.numbers == other.numbers
            and len(self.held) == len(other.held)
            and all(one is another for one, another in zip(self.held, other.held, strict=True))
        )


def picture_of(view: View) -> np.ndarray:
    """Return colour, opacity and depth as one read-only float32 [height, width, 5]; raises `TypeError` for another
    type, whose bits would not come back, and `ValueError` if shapes do not belong together or a value is not finite.
    """
    parts = view.colour, view.opacity[..., None], view.depth[..., None]
    if any(part.dtype != np.float32 for part in parts):
        raise TypeError(f"a view is of float32, not {' '.join(str(part.dtype) for part in parts)}")
    if (
        view.opacity.ndim != 2
        or view.colour.shape != (*view.opacity.shape, 3)
        or view.depth.shape != view.opacity.shape
    ):
        raise ValueError(f"a view of shapes {' '.join(str(part.shape) for part in parts)}")
    return frozen_picture(np.concatenate(parts, axis=-1))


def view_of(picture: np.ndarray) -> View:
    """Return views into a picture of `picture_of`; nothing is copied."""
    return View(picture[..., :3], picture[..., 3], picture[..., 4])
