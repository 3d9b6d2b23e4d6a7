"""Latencies and confusions of the view cache, with known answers and planted faults."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from harness.playback.cached import CachedMethod
from harness.playback.run_loader import TrainedCell
from harness.playback.store import Place, ViewStore
from harness.records.study import Check
from harness.studies.serving.serving_context import Clock, ServingContext, plain
from harness.studies.serving.view_cache import (
    HITS,
    Variant,
    WrongHit,
    confusions,
    findings_of,
    hit_check,
    latencies,
    variants,
)
from harness.training.batches import Camera
from harness.training.scoring.evaluate import View
from harness.training.scoring.metrics import mse
from tests.harness.patching import preceded
from tests.harness.tiny import same, weights


def test_every_level_is_timed_as_often_as_requested(context: ServingContext, cell: TrainedCell, ticks: Clock) -> None:
    seconds = latencies(context, cell, ticks)
    rounds, hits = context.sizes.rounds, context.sizes.hits
    counts = {"render": rounds, **dict.fromkeys(HITS, rounds * hits)}
    assert {name: len(calls) for name, calls in seconds.items()} == counts
    assert {second for calls in seconds.values() for second in calls} == {1.0}, "nothing else is on the clock"


@pytest.mark.parametrize(
    ("name", "slower", "status"),
    [
        ("memory.0", 1.0, "pass"),
        ("memory.0", 100.0, "inconclusive"),
        ("memory.0", 300.0, "fail"),
        ("disk.warm", 300.0, "pass"),
    ],
)
def test_a_target_is_judged_by_opposite_quartiles(cell: TrainedCell, name: str, slower: float, status: str) -> None:
    rendering = [40.0, 10.0, 20.0, 30.0, 50.0]
    check = hit_check(cell, name, [slower * 1e-3 * x for x in (0.1, 0.2, 0.3, 0.4, 0.5)], rendering)
    assert check.value == pytest.approx(1e5 / slower)
    assert check.spread == (pytest.approx(20.0 / 0.4e-3 / slower), pytest.approx(40.0 / 0.2e-3 / slower))
    assert (check.status, check.repeats, check.is_broken) == (status, 5, False)


def test_a_hit_with_another_picture_is_an_error(
    context: ServingContext, cell: TrainedCell, ticks: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def darker(self: CachedMethod, camera: Camera) -> tuple[View, Place]:
        view = plain(self.learner, camera, self.chunk)
        return replace(view, colour=np.nextafter(view.colour, np.float32(-1.0))), "memory"

    monkeypatch.setattr(CachedMethod, "lookup", darker)
    with pytest.raises(WrongHit, match="not the picture"):
        latencies(context, cell, ticks)


def test_nothing_reads_a_file_before_it_is_timed(
    context: ServingContext, cell: TrainedCell, ticks: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    reads: list[object] = []
    preceded(monkeypatch, ViewStore, "_read", lambda *arguments: reads.append(arguments))
    latencies(context, cell, ticks)
    assert len(reads) == context.sizes.rounds * context.sizes.hits, "one per hit"


def test_a_key_of_the_pose_alone_is_stale_wherever_something_else_changed(
    context: ServingContext, cell: TrainedCell
) -> None:
    rows = confusions(context, cell, variants(context, cell))
    assert [row.changed.split(" ")[-1] for row in rows] == ["nerf", "long", "width", "together"]
    for row in rows:
        assert (row.stale, row.caught) == (row.views, row.views)
        assert row.rmse is None if row.changed == "half the width" else 0.0 < row.rmse < 1.0


def test_the_error_is_that_of_the_picture_that_would_have_come(context: ServingContext, cell: TrainedCell) -> None:
    wider = Variant("focal", cell.learner, cell.chunk, lambda camera: replace(camera, focal=2.0 * camera.focal))
    row = confusions(context, cell, [wider])[0]
    squares = []
    for pose in context.orbit(cell.scene, row.views):
        camera = context.camera(cell, pose)
        asked = plain(cell.learner, replace(camera, focal=2.0 * camera.focal), cell.chunk)
        squares.append(mse(plain(cell.learner, camera, cell.chunk).colour, asked.colour))
    assert row.rmse == pytest.approx(np.sqrt(np.mean(squares)))


def test_the_same_method_again_is_not_stale(context: ServingContext, cell: TrainedCell) -> None:
    row = confusions(context, cell, [Variant("nothing", cell.learner, cell.chunk)])[0]
    assert (row.stale, row.caught, row.rmse) == (0, 0, 0.0)
    assert not any(check.is_broken for check in findings_of([row]) if isinstance(check, Check))


def test_a_planted_key_that_forgets_something_is_found(
    context: ServingContext, cell: TrainedCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_the_pose_alone(self: CachedMethod, camera: Camera, calls: str | None = None) -> str:
        return camera.camera_to_world.tobytes().hex()

    monkeypatch.setattr(CachedMethod, "key", of_the_pose_alone)
    rows = confusions(context, cell, variants(context, cell))
    assert {row.caught for row in rows} == {0}
    assert [row.id for row in findings_of(rows) if isinstance(row, Check) and row.is_broken] == ["key.ours"]


@pytest.fixture(autouse=True)
def learners_are_not_trained(context: ServingContext) -> Iterator[None]:
    """No study may train what others are going to render."""
    cells = [context.trained(context.scenes[0], method) for method in ("nerf", "qnerf")]
    learners = [cell.learner for cell in cells if cell]
    before = [weights(learner) for learner in learners]
    yield
    assert all(same(weights(learner), unchanged) for learner, unchanged in zip(learners, before, strict=True))
