"""A coarse frame, every region once, the plain picture at the end; then the cache; no rendering beyond the request."""

from typing import Any

import numpy as np
import pytest

from harness.playback.run_loader import TrainedCell
from harness.playback.store import ViewStore
from harness.training.batches import Camera
from harness.training.scoring.evaluate import render_view
from harness.training.scoring.metrics import psnr
from harness.training.trainer import Diverged
from harness.viewer.attended import Attention
from harness.viewer.engine import NOT_BY_REGIONS, FreshPixels, MethodView, frames
from harness.viewer.requests import Orbit
from tests.harness.patching import preceded
from tests.harness.tiny import CPU

ORBIT = Orbit((0.0, 0.0, 0.0), 0.7, 0.4, 4.0311)
PLAIN, FOVEAL = Attention("none"), Attention("foveal", 0.2, 0.8)


@pytest.fixture
def camera(cells: list[TrainedCell]) -> Camera:
    return cells[0].camera(ORBIT.pose())


@pytest.fixture
def seats(cells: list[TrainedCell]) -> list[MethodView]:
    return [MethodView.of(cell, ViewStore()) for cell in cells]


def of(shown: list[FreshPixels], method: str) -> list[FreshPixels]:
    return [frame for frame in shown if frame.method == method]


@pytest.mark.parametrize("kind", ["foveal", "point", "gradients", "error", "none"])
def test_a_view_is_coarse_then_refined_by_pixels_and_in_the_end_the_plain_one(
    seats: list[MethodView], camera: Camera, kind: str
) -> None:
    shown = list(frames(seats, camera, Attention(kind, 0.2, 0.8)))
    for seat in seats:
        first, *parts, last = of(shown, seat.name)
        assert (first.state, {part.state for part in parts}, last.state) == ("coarse", {"refining"}, "whole")
        assert (first.stride or 0) >= 2
        pixels = np.concatenate([part.pixels for part in parts])
        assert np.array_equal(np.sort(pixels), np.arange(camera.width * camera.height))
        assert [part.share for part in parts] == sorted(part.share for part in parts)
        assert parts[-1].share == 1.0
        by_regions = seat.name == "nerf" and kind != "none"
        looks = 2 if by_regions and kind == "error" else 1  # an estimate of error is another coarse frame
        assert last.rays == camera.width * camera.height + looks * first.rays
        assert last.evaluations == parts[-1].evaluations > 0
        plain = render_view(seat.learner, camera.cameras(CPU), 0, seat.chunk)
        for name in ("colour", "opacity", "depth"):
            pieces, whole = np.concatenate([getattr(part, name) for part in parts]), getattr(last, name)
            assert np.array_equal(pieces, whole[pixels])
            expected = getattr(plain, name).reshape(whole.shape)
            np.testing.assert_allclose(whole, expected, rtol=0, atol=2e-5 if by_regions else 0)
        note = NOT_BY_REGIONS if seat.name == "qnerf" and kind != "none" else ""
        assert {frame.note for frame in of(shown, seat.name)} == {note}


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


def test_nothing_is_rendered_that_is_not_asked_for(
    seats: list[MethodView], camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[object] = []
    for seat in seats:
        preceded(monkeypatch, seat.learner, "render", lambda rays, *_: calls.append(rays))
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
