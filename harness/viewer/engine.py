"""One view of several trained methods as a stream of frames, from the view cache or refined in order of attention.

Nothing here knows of HTTP. A caller stops the rendering by taking no more frames.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from baselines.numerics.attention.priorities import is_equal
from baselines.numerics.attention.regions import Regions
from harness.playback.cached import CachedMethod
from harness.playback.keys import plain_calls
from harness.playback.progressive import Canvas, coarse, estimated_error, refine, why_plain
from harness.playback.run_loader import TrainedCell
from harness.playback.store import Place, ViewStore
from harness.records.metric_table import LARGEST_PSNR
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View
from harness.training.scoring.metrics import psnr
from harness.training.trainer import Diverged
from harness.viewer.attended import Attention, attention_map

COARSE_SECONDS = 0.1
FINEST_STRIDE, COARSEST_STRIDE = 2, 16
REGION = 16
"""The minimum side of a region in pixels: smaller chunks cost too much."""
REGIONS_PER_SIDE = 12
NOT_BY_REGIONS = "Refined plainly: its density depends on which points share a chunk."
"""The short version, for the page, of `harness.playback.progressive.why_plain`."""

State = Literal["coarse", "refining", "whole", "failed"]


@dataclass
class MethodView:
    name: str
    learner: Learner
    cached: CachedMethod
    chunk: int
    rays_per_second: float = 20_000.0

    @staticmethod
    def of(cell: TrainedCell, store: ViewStore) -> "MethodView":
        return MethodView(cell.cell.method, cell.learner, CachedMethod(cell.learner, store, cell.chunk), cell.chunk)

    def learn(self, rays: int, seconds: float) -> None:
        """Replace the pace by its geometric mean with a new measurement."""
        if rays > 0 and seconds > 0.0:
            self.rays_per_second = math.sqrt(self.rays_per_second * rays / seconds)

    def stride(self, pixels: int) -> int:
        """Return the stride of a coarse frame that takes about `COARSE_SECONDS`."""
        affordable = max(self.rays_per_second * COARSE_SECONDS, 1.0)
        return min(max(math.ceil(math.sqrt(pixels / affordable)), FINEST_STRIDE), COARSEST_STRIDE)

    def warm_up(self, camera: Camera) -> None:
        """Let the method allocate its memory, and measure its pace."""
        for _ in range(2):
            began = time.perf_counter()
            _, rays, _ = coarse(self.learner, camera, COARSEST_STRIDE // 2, self.chunk)
            self.rays_per_second = rays / max(time.perf_counter() - began, 1e-6)


@dataclass(frozen=True)
class FreshPixels:
    """Newly rendered pixels of one method: `pixels` int64 [n] are their indices, numbered row by row, `colour`
    float32 [n, 3], `opacity` float32 [n], and `depth` float32 [n] the distance along the ray in scene units.
    """

    method: str
    state: State
    pixels: np.ndarray
    colour: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray
    share: float
    """The share of the picture's rays at full resolution that are done."""
    seconds: float
    """The seconds since the request; methods take turns."""
    work: float
    """The part of these spent on this method."""
    rays: int = 0
    """The rays so far, including those of the coarse frame and of an estimate of its error."""
    evaluations: int = 0
    """The network evaluations so far, without those of the coarse frame, with those of an estimate of its error."""
    stride: int | None = None
    cached: Place | None = None
    """The place in the view cache of a complete picture; None if it was rendered."""
    psnr: float | None = None
    """In dB, if there is ground truth for exactly this view; not while refining."""
    note: str = ""


def frames(
    methods: Sequence[MethodView],
    camera: Camera,
    attention: Attention,
    truth: np.ndarray | None = None,
    asked_at: float | None = None,
) -> Iterator[FreshPixels]:
    """Yield for each method either one complete picture from the cache, or a coarse one, its refined parts, and a last
    frame with the complete picture.

    `truth` [h, w, 3] is the reference. `asked_at` is a time of `time.perf_counter`. Pictures from the cache come first.
    Then each turn, one chunk of rays, goes to the method that has had the least time. Rendering continues only when the
    next frame is requested. A method whose picture is not finite ends with the state `failed`.
    """
    start = time.perf_counter() if asked_at is None else asked_at
    waiting = []
    for method in methods:
        turn = _Turn(method, camera, attention, truth, start)
        if (cached := turn.from_cache()) is not None:
            yield cached
        else:
            waiting.append((turn, turn.rendered()))
    while waiting:
        turn, rendering = min(waiting, key=lambda pair: pair[0].work)
        frame = next(rendering, None)
        if frame is None:
            waiting.remove((turn, rendering))
        else:
            yield frame


@dataclass
class _Turn:
    method: MethodView
    camera: Camera
    attention: Attention
    truth: np.ndarray | None
    start: float
    work: float = 0.0
    rays: int = 0
    evaluations: int = 0

    def __post_init__(self) -> None:
        camera, attends, plain = self.camera, self.attention.kind != "none", why_plain(self.method.learner)
        side = max(REGION, math.ceil(max(camera.width, camera.height) / REGIONS_PER_SIDE))
        self.regions = Regions(camera.height, camera.width, side)
        self.by_regions = attends and not plain
        self.note = NOT_BY_REGIONS if attends and plain else ""

    def from_cache(self) -> FreshPixels | None:
        """Return the picture that rendering would give, or the plain one, which differs only by rounding."""
        began = time.perf_counter()
        for calls in dict.fromkeys((self._calls(self.by_regions), plain_calls(self.method.chunk))):
            if (kept := self.method.cached.lookup(self.camera, calls)) is not None:
                view, place = kept
                self.work = time.perf_counter() - began
                return self._frame("whole", *_all(view), share=1.0, cached=place, psnr=self._psnr(view))
        return None

    def rendered(self) -> Iterator[FreshPixels]:
        try:
            yield from self._rendered()
        except Diverged as reason:
            none = np.zeros(0, np.float32)
            self.note = f"The picture is not finite: {reason}"
            yield self._frame("failed", np.zeros(0, np.int64), np.zeros((0, 3), np.float32), none, none, share=0.0)

    def _rendered(self) -> Iterator[FreshPixels]:
        method, camera, size = self.method, self.camera, self.camera.width * self.camera.height
        stride = method.stride(size)
        began = time.perf_counter()
        first, self.rays, _ = coarse(method.learner, camera, stride, method.chunk)
        self.work = passed = time.perf_counter() - began
        method.learn(self.rays, passed)
        yield self._frame("coarse", *_all(first), share=0.0, stride=stride, psnr=self._psnr(first))
        began = time.perf_counter()
        attended = self._attended(first, stride)
        canvas = Canvas(camera.height, camera.width)
        for done in refine(method.learner, camera, self.regions, attended, method.chunk):
            canvas.put(done)
            self.rays += len(done.pixels)
            self.evaluations += done.network_evaluations
            self.work += time.perf_counter() - began
            yield self._frame("refining", done.pixels, done.colour, done.opacity, done.depth, share=done.share)
            began = time.perf_counter()
        score = self._psnr(canvas.view)
        method.learn(size, self.work - passed)
        self.work += time.perf_counter() - began
        try:
            yield self._frame("whole", *_all(canvas.view), share=1.0, psnr=score)
        finally:  # even if the caller takes no more frames
            method.cached.keep(camera, canvas.view, self._calls(self.by_regions and not is_equal(attended)))

    def _attended(self, first: View, stride: int) -> np.ndarray:
        if not self.by_regions:
            return np.ones(self.regions.count)

        def error() -> np.ndarray:
            how = self.method.learner.rendered_by()
            bins = int(how.get("sampling", how)["bins"])  # samples per ray
            estimate = estimated_error(self.method.learner, self.camera, first, stride, self.method.chunk, bins)
            self.rays += estimate.rays
            self.evaluations += estimate.network_evaluations
            return estimate.error

        return attention_map(self.attention, self.regions, self.camera.focal, first.colour, error)

    def _calls(self, by_regions: bool) -> str:
        """Describe the chunks. The order of regions is left out, as it changes only rounding."""
        plain = plain_calls(self.method.chunk)
        return f"regions of {self.regions.tile} pixels, each {plain}" if by_regions else plain

    def _psnr(self, view: View) -> float | None:
        if self.truth is None or self.truth.shape != view.colour.shape:
            return None
        return min(psnr(view.colour, self.truth), LARGEST_PSNR)

    def _frame(
        self, state: State, pixels: np.ndarray, colour: np.ndarray, opacity: np.ndarray, depth: np.ndarray, **facts: Any
    ) -> FreshPixels:
        facts |= {"rays": self.rays, "evaluations": self.evaluations, "note": self.note}
        seconds = time.perf_counter() - self.start
        return FreshPixels(
            self.method.name, state, pixels, colour, opacity, depth, seconds=seconds, work=self.work, **facts
        )


def _all(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    size = view.opacity.size
    return np.arange(size), view.colour.reshape(size, 3), view.opacity.reshape(size), view.depth.reshape(size)
