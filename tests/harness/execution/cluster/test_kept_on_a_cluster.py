"""Snapshots of cells in training are sent to the driver, and with the next attempt to another node; without Ray."""

import os
from pathlib import Path

import pytest

from harness.execution.cluster.mailbox import Message
from harness.execution.cluster.node_work import _kept_since
from harness.execution.group_loop import Attempt
from harness.execution.ray_executor import _unfinished, news_of
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from tests.harness.cells import cell, checkpoint
from tests.harness.tiny import SCORE, TRAIN, VIEWS

KEY = ("ball", 0)
NERF, QNERF = (f"unfinished/ball.{method}.0.safetensors" for method in ("nerf", "qnerf"))


@pytest.fixture
def task(tmp_path: Path) -> GroupTask:
    budget = Budget(24, None)
    return GroupTask("ball", 0, ("nerf", "qnerf"), TRAIN, SCORE, budget, tmp_path, tmp_path / "v", VIEWS)


def told(task: GroupTask, *messages: Message) -> list[str]:
    """Deliver messages during the second attempt; return the notices."""
    return [news for _, news in news_of(list(messages), [Attempt(task, 2)], {}) if isinstance(news, str)]


def test_what_a_node_keeps_is_kept_by_the_driver_and_goes_with_the_next_attempt(task: GroupTask) -> None:
    said = told(
        task,
        Message(KEY, 2, files={NERF: b"old", QNERF: b"q"}),
        Message(KEY, 2, notice="goes on"),
        Message(KEY, 2, files={NERF: b"new"}),
    )
    assert said == ["goes on"]
    assert _unfinished(task) == {NERF: b"new", QNERF: b"q"}


def test_a_lost_attempt_overwrites_nothing(task: GroupTask) -> None:
    told(task, Message(KEY, 2, files={NERF: b"new"}))
    assert told(task, Message(KEY, 1, files={NERF: b"late"}), Message(KEY, 1, notice="late")) == []
    assert _unfinished(task) == {NERF: b"new"}


def test_a_delivered_cell_is_no_longer_kept(task: GroupTask) -> None:
    done = cell("ball", "nerf", 0, [checkpoint(24, 1.0, 20.0)])
    told(task, Message(KEY, 2, files={NERF: b"n", QNERF: b"q"}), Message(KEY, 2, cell=done, files={}))
    assert _unfinished(task) == {QNERF: b"q"}
    assert (task.out / "records/cells/ball.nerf.0.json").is_file()


def test_a_node_sends_each_state_once(tmp_path: Path) -> None:
    times: dict[Path, int] = {}
    assert _kept_since(tmp_path, times) == {}
    file = tmp_path / NERF
    file.parent.mkdir()
    (file.parent / f".{file.name}.7.part").write_bytes(b"half")
    file.write_bytes(b"one")
    assert _kept_since(tmp_path, times) == {NERF: b"one"}
    assert _kept_since(tmp_path, times) == {}
    file.write_bytes(b"two")
    os.utime(file, ns=(1, 1))
    assert _kept_since(tmp_path, times) == {NERF: b"two"}
