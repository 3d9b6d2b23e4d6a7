"""Scenes that are rendered while others train: their order, the workers whose place they take, and their failures."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from harness.execution import ground_truth
from harness.execution.ground_truth import Arriving
from harness.execution.group_loop import Attempt, End, run_at
from harness.execution.progress import RenderProgress
from harness.plan.group_task import GroupTask
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine
from scenes.files.errors import InputError

PLAN = replace(PROFILES["smoke"], scenes=("hotdog", "lego"), methods=("nerf",), seeds=(0, 1), extras=())
TWO = Machine("cpu", 2, 1)


class OneByOne:
    """An executor that ends an attempt as soon as it is asked, and notes the order."""

    refusal = ""

    def __init__(self, arriving: Arriving, workers: int) -> None:
        self.arriving, self.workers = arriving, workers
        self.order: list[tuple[str, int]] = []
        self.at_once: list[int] = []
        self.rendering: list[int] = []
        """The workers' places that the renderer has, at each submission."""
        self.running: list[Attempt] = []

    @property
    def room(self) -> int:
        return self.workers - self.arriving.places

    @property
    def expecting(self) -> bool:
        return self.arriving.places > 0

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        self.order.append((task.scene, task.seed))
        self.running.append(attempt)
        self.at_once.append(len(self.running))
        self.rendering.append(self.arriving.places)

    def poll(self, running: list[Attempt]) -> Iterator[object]:
        if self.expecting:
            yield self.arriving.receive()
        elif self.running:
            yield self.running.pop(0), End()

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        return [], lost

    def cancel(self, running: list[Attempt]) -> None:
        self.arriving.stop()


def rendering(monkeypatch: pytest.MonkeyPatch, *events: RenderProgress | Exception, wait: float = 0.0) -> list[int]:
    """Replace the renderer; return the list that gets its threads."""
    used: list[int] = []

    def render(*_: object, threads: int) -> Iterator[RenderProgress]:
        used.append(threads)
        for event in events:
            time.sleep(wait)
            if isinstance(event, Exception):
                raise event
            yield event

    monkeypatch.setattr(ground_truth, "render_view_sets", render)
    return used


def arriving(tmp_path: Path, machine: Machine = TWO) -> Arriving:
    return Arriving(PLAN, tmp_path, machine, lambda scene, folder: PLAN.tasks({scene: folder}, machine, tmp_path))


def ready(scene: str) -> RenderProgress:
    return RenderProgress(scene, 27, 27, Path("sets", scene))


def test_groups_train_in_the_order_of_the_plan_whichever_scene_is_ready_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = rendering(monkeypatch, ready("lego"), RenderProgress("hotdog", 3, 27), ready("hotdog"))
    executor = OneByOne(arriving(tmp_path), 2)
    events = list(run_at(executor, []))
    # lego's first group begins beside the renderer; then the plan's order is kept
    assert executor.order == [("lego", 0), ("hotdog", 0), ("hotdog", 1), ("lego", 1)]
    assert [event.rendered.scene for event in events if event.rendered] == ["lego", "hotdog", "hotdog"]
    assert executor.at_once[0] == 1
    assert max(executor.at_once) == 2
    assert threads == [1]


def test_one_worker_waits_for_all_scenes_which_all_cores_render(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ground_truth, "available_cores", lambda: 5)
    threads = rendering(monkeypatch, ready("hotdog"), ready("lego"))
    executor = OneByOne(arriving(tmp_path, Machine("cpu", 1, 1)), 1)
    assert len([event for event in run_at(executor, []) if event.share == 1.0]) == 4
    assert executor.rendering == [0, 0, 0, 0]
    assert threads == [5]


def test_a_fault_of_the_renderer_ends_the_run_in_its_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendering(monkeypatch, ready("hotdog"), InputError("sets: the disk is full"))
    with pytest.raises(InputError, match="the disk is full"):
        list(run_at(OneByOne(arriving(tmp_path), 2), []))


def test_a_stopped_run_renders_no_further(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendering(monkeypatch, *(RenderProgress("hotdog", view, 1000) for view in range(1000)), wait=0.01)
    coming = arriving(tmp_path)
    assert coming.receive().rendered == RenderProgress("hotdog", 0, 1000)
    coming.stop()
    assert coming.places == 0
    coming._thread.join(5.0)
    assert not coming._thread.is_alive()
