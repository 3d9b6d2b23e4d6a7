"""A coarse frame, every region once, the plain picture at the end; then the cache; no rendering beyond the request."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View, render_view
from harness.training.scoring.metrics import psnr
from harness.training.trainer import Diverged
from harness.viewer.attended import Attention
from harness.viewer.engine import FreshPixels, MethodView, frames
from harness.viewer.requests import Orbit

ORBIT = Orbit((0.0, 0.0, 0.0), 0.7, 0.4, 4.0311)
PLAIN, FOVEAL = Attention("none"), Attention("foveal", 0.2, 0.8)


@pytest.fixture
def camera(cells: list[TrainedCell]) -> Camera:
    return cells[0].camera(ORBIT.pose())


@pytest.fixture
def seats(cells: list[TrainedCell]) -> list[MethodView]:
    return [MethodView.of(cell, ViewStore()) for cell in cells]


def plain(seat: MethodView, camera: Camera) -> View:
    return render_view(seat.learner, camera.cameras(torch.device("cpu")), 0, seat.chunk)


def of(shown: list[FreshPixels], method: str) -> list[FreshPixels]:
    return [frame for frame in shown if frame.method == method]


@pytest.mark.parametrize("kind", ["foveal", "point", "gradients", "error", "none"])
def test_a_view_is_coarse_then_refined_by_pixels_and_whole(seats: list[MethodView], camera: Camera, kind: str) -> None:
    shown = list(frames(seats, camera, Attention(kind)))
    for method in ("nerf", "qnerf"):
        first, *parts, last = of(shown, method)
        assert (first.state, {part.state for part in parts}, last.state) == ("coarse", {"refining"}, "whole")
        assert (first.stride or 0) >= 2
        pixels = np.concatenate([part.pixels for part in parts])
        assert np.array_equal(np.sort(pixels), np.arange(camera.width * camera.height))
        assert [part.share for part in parts] == sorted(part.share for part in parts)
        assert parts[-1].share == 1.0
        looks = 2 if kind == "error" and method == "nerf" else 1  # an estimate of error is another coarse frame
        assert last.rays == camera.width * camera.height + looks * first.rays
        assert last.evaluations == parts[-1].evaluations > 0
        for name in ("colour", "opacity", "depth"):
            pieces = np.concatenate([getattr(part, name) for part in parts])
            assert np.array_equal(pieces, getattr(last, name)[pixels])


@pytest.mark.parametrize("attention", [PLAIN, FOVEAL])
def test_the_last_picture_is_the_plain_one(seats: list[MethodView], camera: Camera, attention: Attention) -> None:
    shown = list(frames(seats, camera, attention))
    for seat in seats:
        last, wanted = of(shown, seat.name)[-1], plain(seat, camera)
        exactly = attention is PLAIN or not seat.learner.field.pointwise
        for name in ("colour", "opacity", "depth"):
            expected = getattr(wanted, name).reshape(getattr(last, name).shape)
            np.testing.assert_allclose(getattr(last, name), expected, rtol=0, atol=0 if exactly else 2e-5)


def test_what_is_not_pointwise_is_refined_plainly_and_says_why(seats: list[MethodView], camera: Camera) -> None:
    shown = list(frames(seats, camera, FOVEAL))
    assert [seat.learner.field.pointwise for seat in seats] == [True, False]
    assert {frame.note for frame in of(shown, "nerf")} == {""}
    assert all("share a chunk" in frame.note for frame in of(shown, "qnerf"))
    assert all(frame.note == "" for frame in frames(seats, camera, PLAIN))


def test_the_second_time_it_is_out_of_the_cache(seats: list[MethodView], camera: Camera) -> None:
    first = {frame.method: frame for frame in frames(seats, camera, FOVEAL) if frame.state == "whole"}
    again = list(frames(seats, camera, Attention("point", 0.9, 0.1)))
    found = [(frame.method, frame.state, frame.cached) for frame in again]
    assert found == [("nerf", "whole", "memory"), ("qnerf", "whole", "memory")]
    for frame in again:
        assert np.array_equal(frame.colour, first[frame.method].colour)
        assert (frame.rays, frame.evaluations) == (0, 0)
    assert {frame.cached for frame in frames(seats, camera, FOVEAL)} == {"memory"}
    # a picture by regions is not bit-identical with the plain one, and is not returned for it
    assert [frame.method for frame in frames(seats, camera, PLAIN) if frame.cached is not None] == ["qnerf"]
    elsewhere = camera.at(Orbit((0.0, 0.0, 0.0), np.nextafter(0.7, 1.0), 0.4, 4.0311).pose())
    assert {frame.cached for frame in frames(seats, elsewhere, FOVEAL)} == {None}


def test_the_cache_outlives_the_program(cells: list[TrainedCell], camera: Camera, tmp_path: Path) -> None:
    for place in (None, "disk"):
        seat = MethodView.of(cells[0], ViewStore(1 << 24, tmp_path / "views", 1 << 24))
        assert list(frames([seat], camera, FOVEAL))[-1].cached == place


def test_nothing_is_rendered_that_is_not_asked_for(
    seats: list[MethodView], camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    for seat in seats:
        render = seat.learner.render

        def counted(rays: Any, *rest: Any, render: Any = render) -> Any:
            calls.append(len(rays))
            return render(rays, *rest)

        monkeypatch.setattr(seat.learner, "render", counted)
    shown = frames(seats, camera, FOVEAL)
    assert calls == []
    for taken in range(1, 4):
        next(shown)
        assert len(calls) == taken
    shown.close()
    assert len(calls) == 3
    assert all(seat.cached.lookup(camera, None) is None for seat in seats)


def test_psnr_is_that_of_the_whole_picture(seats: list[MethodView], camera: Camera) -> None:
    truth = np.random.default_rng(0).random((camera.height, camera.width, 3), np.float32)
    shown = list(frames(seats[:1], camera, FOVEAL, truth))
    assert shown[-1].psnr == psnr(shown[-1].colour.reshape(truth.shape), truth)
    assert shown[0].psnr is not None
    assert {frame.psnr for frame in shown[1:-1]} == {None}
    assert next(frames(seats[:1], camera, FOVEAL, truth)).psnr == shown[-1].psnr
    # a truth of another size does not count
    assert next(frames(seats[:1], camera, FOVEAL, truth[:10])).psnr is None


def test_a_picture_that_is_not_finite_fails_alone(
    seats: list[MethodView], camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> None:
        raise Diverged(3, "rendered colour of ray 7")

    monkeypatch.setattr(seats[0].learner, "render", broken)
    shown = list(frames(seats, camera, FOVEAL))
    assert [frame.state for frame in of(shown, "nerf")] == ["failed"]
    assert "ray 7" in of(shown, "nerf")[0].note
    assert of(shown, "qnerf")[-1].state == "whole"
