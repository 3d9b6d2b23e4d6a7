"""Latencies, paths and confusions of the view cache, on paths whose answer is known by hand and with faults planted."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.playback import cached as cached_module
from harness.playback import disk
from harness.playback.cached import CachedMethod
from harness.playback.camera_paths import walk
from harness.playback.run_loader import TrainedCell
from harness.studies.serving import cache_study
from harness.studies.serving.cache_confusions import Variant, confusions, copied, pose_hash, variants
from harness.studies.serving.cache_latency import ROOM, WrongHit, latencies
from harness.studies.serving.cache_study import Route, followed, hit_rate, routes
from harness.studies.serving.serving_context import ServingContext, plain
from harness.training.batches import Camera
from harness.training.evaluate import View
from harness.training.metrics import mse
from harness.training.trainer import Trainer
from tests.harness.studies.serving.conftest import Ticks
from tests.harness.trained_runs import SIZE

VIEW_BYTES = SIZE * SIZE * 5 * 4
KINDS_OF_HITS = ["level 0", "level 1", "level 2", "level 0 hashed", "level 2 cold"]


def test_every_level_is_timed_as_often_as_asked(situation: ServingContext, cell: TrainedCell, ticks: Ticks) -> None:
    found = {one.source: one for one in latencies(situation, cell, ticks)}
    rounds, hits = situation.sizes.rounds, situation.sizes.hits
    assert {source: one.calls for source, one in found.items()} == {
        "render": rounds, **dict.fromkeys(KINDS_OF_HITS, rounds * hits)
    }  # fmt: skip
    assert {one.seconds for one in found.values()} == {1.0}, "one tick each: nothing else is on the clock"
    assert {one.ratio for source, one in found.items() if source != "render"} == {1.0}


def test_a_hit_that_is_another_picture_is_no_hit(
    situation: ServingContext, cell: TrainedCell, ticks: Ticks, monkeypatch: pytest.MonkeyPatch
) -> None:
    def darker(self: CachedMethod, camera: Camera, use_cache: bool = True) -> View:
        view = plain(self.learner, camera, self.chunk)
        return replace(view, colour=np.nextafter(view.colour, np.float32(-1.0)))

    monkeypatch.setattr(CachedMethod, "render", darker)
    with pytest.raises(WrongHit, match="not the picture"):
        latencies(situation, cell, ticks)


def test_nothing_reads_a_file_before_it_is_timed(
    situation: ServingContext, cell: TrainedCell, ticks: Ticks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """But for the views that a path has to find."""
    reads: list[float] = []
    read = disk.read_exr

    def noted(file: Path) -> np.ndarray:
        reads.append(ticks.now)
        return read(file)

    monkeypatch.setattr(disk, "read_exr", noted)
    latencies(situation, cell, ticks)
    assert len(reads) == 2 * situation.sizes.rounds * situation.sizes.hits, "one a hit, warm or cold"
    poses = situation.orbit(cell.scene, 2)[[0, 1, 0]]
    followed(situation, cell, Route("by hand", poses, VIEW_BYTES, ROOM), 0, ticks)
    assert len(reads) == 2 * situation.sizes.rounds * situation.sizes.hits + 1


def test_weights_are_hashed_at_the_calls_that_say_so(
    situation: ServingContext, cell: TrainedCell, ticks: Ticks, monkeypatch: pytest.MonkeyPatch
) -> None:
    hashed: list[int] = []
    digest = cached_module.weights_digest

    def noted(learner: Any) -> str:
        hashed.append(len(began))
        return digest(learner)

    began: list[float] = []

    def clock() -> float:
        began.append(ticks())
        return began[-1]

    monkeypatch.setattr(cached_module, "weights_digest", noted)
    latencies(situation, cell, clock)
    inside = [count for count in hashed if count % 2]
    assert len(inside) == situation.sizes.rounds * situation.sizes.hits, "of level 0 hashed alone"


@pytest.mark.parametrize(
    ("places", "memory", "disk", "hits"),
    [
        ([0, 1, 0, 1, 0], ROOM, 0, {"render": 2, "level 1": 2, "level 0": 1}),
        # one view fits: each pushes the other out
        ([0, 1, 0, 1, 0], VIEW_BYTES, 0, {"render": 5}),
        ([0, 0, 1, 1], VIEW_BYTES, 0, {"render": 2, "level 1": 2}),
        ([0, 1, 0, 1, 0], VIEW_BYTES, ROOM, {"render": 2, "level 2": 3}),
    ],
)
def test_views_come_from_where_they_must(
    situation: ServingContext, cell: TrainedCell, ticks: Ticks, places: list[int], memory: int, disk: int,
    hits: dict[str, int],
) -> None:  # fmt: skip
    poses = situation.orbit(cell.scene, 2)[places]
    found = followed(situation, cell, Route("by hand", poses, memory, disk), 0, ticks)
    assert found is not None
    assert {source: many for source, many in found.hits.items() if many} == hits
    assert (found.views, found.seconds, found.seconds_without) == (len(places), len(places), len(places))
    assert found.hit_rate == pytest.approx(1 - hits["render"] / len(places))


def test_paths_are_what_their_words_say(situation: ServingContext, cell: TrainedCell) -> None:
    orbit, walked, little, on_disk, spiral = routes(situation, cell, VIEW_BYTES)
    count = situation.sizes.orbit
    assert (orbit.path, len(orbit.poses)) == (f"an orbit of {count} views, three times", 3 * count)
    np.testing.assert_array_equal(orbit.poses[:count], orbit.poses[2 * count :])
    assert len(walked.poses) == 2 * count
    radius = float(np.linalg.norm(orbit.poses[0][:3, 3]))
    every = [walked.poses, *walked.others]
    assert len(every) == situation.sizes.walks
    for seed, poses in enumerate(every):
        np.testing.assert_array_equal(poses, walk(2 * count, seed, radius))
    assert len({pose.tobytes() for pose in spiral.poses}) == count, "none twice"
    assert little.memory_bytes == on_disk.memory_bytes < count * VIEW_BYTES
    assert (little.disk_bytes, on_disk.disk_bytes) == (0, ROOM)
    np.testing.assert_array_equal(little.poses, on_disk.poses)


@pytest.mark.parametrize(
    ("places", "memory", "rate"), [([0, 1, 0, 1, 0], ROOM, 0.6), ([0, 1, 0, 1, 0], VIEW_BYTES, 0.0), ([0], ROOM, 0.0)]
)
def test_hits_are_counted_without_rendering(
    situation: ServingContext, cell: TrainedCell, ticks: Ticks, places: list[int], memory: int, rate: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    poses = situation.orbit(cell.scene, 2)[places]
    found = followed(situation, cell, Route("by hand", poses, memory, 0, [poses]), 0, ticks)
    assert found is not None
    assert found.other_hit_rates == [found.hit_rate] == [pytest.approx(rate)]
    monkeypatch.setattr("harness.studies.serving.cache_study.plain", None)
    assert hit_rate(situation, cell, poses, memory) == pytest.approx(rate)


def test_what_is_late_is_left_out_and_named(situation: ServingContext, cell: TrainedCell, ticks: Ticks) -> None:
    situation.deadline, situation.clock = 3.0, ticks
    route = Route("by hand", situation.orbit(cell.scene, 4), ROOM, 0)
    assert followed(situation, cell, route, 0, Ticks()) is None
    assert situation.left_out == ["by hand, with nerf: not measured, as the time for it was over"]
    assert situation.is_late
    ticks.now = 0.0
    first, *_ = latencies(situation, cell, Ticks())
    assert first.calls == 3, "the first two looks at the clock were in time"
    situation.left_out.clear()
    situation.deadline = ticks.now + 3
    assert len(confusions(situation, cell, variants(situation, cell))) == 2
    assert situation.left_out[-1].startswith("what a key of the pose alone would return for quadrature")


def test_a_key_of_the_pose_alone_is_stale_wherever_something_else_changed(
    situation: ServingContext, cell: TrainedCell
) -> None:
    found = confusions(situation, cell, variants(situation, cell))
    *others, last = found
    assert [one.changed.split(" ")[-1] for one in others] == [
        "training", "16", "midpoint", "float32", "white", "nerf", "long", "width", "together",
    ]  # fmt: skip
    for one in others:
        assert (one.stale, one.missed) == (one.views, one.views)
        assert 0.0 < one.rmse < 1.0
    assert last.changed == "a pose one unit in the last place away"
    assert (last.stale, last.missed, last.rmse) == (0, last.views, 0.0), "any key of all bits tells them apart"


def test_the_error_is_that_of_the_picture_that_would_have_come(situation: ServingContext, cell: TrainedCell) -> None:
    wider = Variant("focal", cell.learner, cell.chunk, lambda camera: replace(camera, focal=2.0 * camera.focal))
    found = confusions(situation, cell, [wider])[0]
    squares = []
    for pose in situation.orbit(cell.scene, found.views):
        camera = situation.camera(cell, pose)
        asked = plain(cell.learner, replace(camera, focal=2.0 * camera.focal), cell.chunk)
        squares.append(mse(plain(cell.learner, camera, cell.chunk).colour, asked.colour))
    assert found.rmse == pytest.approx(np.sqrt(np.mean(squares)))


def test_the_same_method_again_is_neither_stale_nor_missed(situation: ServingContext, cell: TrainedCell) -> None:
    assert isinstance(cell.learner, Trainer)
    found = confusions(situation, cell, [Variant("nothing", copied(cell.learner), cell.chunk)])[0]
    assert (found.stale, found.missed, found.rmse) == (0, 0, 0.0)


def test_a_planted_key_that_forgets_something_is_found(
    situation: ServingContext, cell: TrainedCell, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_the_pose_alone(self: CachedMethod, camera: Camera, calls: str | None = None) -> str:
        return pose_hash(camera.camera_to_world)

    monkeypatch.setattr(CachedMethod, "key", of_the_pose_alone)
    found = confusions(situation, cell, variants(situation, cell))
    resized = [one.changed == "half the width" for one in found[:-1]]
    wanted = [one.views if other_size else 0 for one, other_size in zip(found, resized, strict=False)]
    assert [one.missed for one in found[:-1]] == wanted, "a picture of another size is refused whatever the key"
    assert sum(resized) == 1
    assert found[-1].missed == found[-1].views


def test_methods_that_cannot_be_rendered_are_named(situation: ServingContext, monkeypatch: pytest.MonkeyPatch) -> None:
    situation.methods = ["qnerf", "voxels_drjit"]
    cells = cache_study.cells_of(situation)
    assert [cell.learner.method for cell in cells] == ["qnerf"]
    assert any("voxels_drjit" in sentence and "was not trained" in sentence for sentence in situation.left_out)


@pytest.fixture(autouse=True)
def learners_are_left_alone(situation: ServingContext) -> Iterator[None]:
    """No study may train what others are going to render."""
    cells = [situation.trained(situation.scenes[0], method) for method in ("nerf", "qnerf")]
    before = [
        {name: value.clone() for name, value in cell.learner.fields.state_dict().items()} for cell in cells if cell
    ]
    yield
    for cell, weights in zip([cell for cell in cells if cell], before, strict=True):
        for name, value in cell.learner.fields.state_dict().items():
            assert bool((value == weights[name]).all())
