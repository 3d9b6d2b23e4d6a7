"""A cluster without Ray: snapshots go to the driver and to the next node, waits are limited, view sets are fetched."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.execution.cluster import view_set_files
from harness.execution.cluster.head import LONGEST_SILENCE_SECONDS, SILENCE_SAID_SECONDS, Head
from harness.execution.cluster.mailbox import Message
from harness.execution.cluster.node_work import _kept_since
from harness.execution.cluster.room import LONGEST_WAIT_SECONDS, Room, fits, needs_of
from harness.execution.cluster.view_set_files import listed, node_folder, on_this_node, piece
from harness.execution.group_loop import Attempt
from harness.execution.ray_executor import _unfinished, news_of
from harness.machine import provenance
from harness.machine.provenance import changed_since, differences, versions
from harness.plan.group_task import GroupTask
from scenes.files.errors import InputError
from scenes.files.lock import is_held
from tests.harness.cells import cell, checkpoint
from tests.harness.execution.on_two_executors import tasks
from tests.harness.tiny import SCORE
from tests.scenes.captures import flip

KEY = ("ball", 0)
NERF, QNERF = (f"unfinished/ball.{method}.0.safetensors" for method in ("nerf", "qnerf"))


@pytest.fixture
def task(tmp_path: Path) -> GroupTask:
    return tasks(tmp_path / "v", tmp_path, 1, SCORE)[0]


def told(task: GroupTask, *messages: Message) -> list[str]:
    """Deliver messages during the second attempt; return the notices."""
    return [news for _, news in news_of(list(messages), [Attempt(task, 2)], {}) if isinstance(news, str)]


def test_the_driver_keeps_the_last_snapshots_for_the_next_attempt_until_their_cells_are_delivered(
    task: GroupTask,
) -> None:
    said = told(
        task,
        Message(KEY, 2, files={NERF: b"old", QNERF: b"q"}),
        Message(KEY, 2, notice="goes on"),
        Message(KEY, 2, files={NERF: b"new"}),
    )
    assert said == ["goes on"]
    assert _unfinished(task) == {NERF: b"new", QNERF: b"q"}
    assert told(task, Message(KEY, 1, files={NERF: b"late"}), Message(KEY, 1, notice="late")) == []
    assert _unfinished(task) == {NERF: b"new", QNERF: b"q"}, "a lost attempt overwrites nothing"
    done = cell("ball", "nerf", 0, [checkpoint(24, 1.0, 20.0)])
    told(task, Message(KEY, 2, cell=done, files={}))
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


# a cluster that lacks room, is busy, or has lost its head


class Clock:
    """A clock that stands still until it is set."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def node(alive: bool = True, **resources: float) -> dict[str, Any]:
    return {"Alive": alive, "Resources": resources}


def test_a_group_takes_its_threads_and_one_gpu_of_one_node() -> None:
    assert needs_of(2, "cpu") == {"CPU": 2}
    assert needs_of(2, "cuda") == {"CPU": 2, "GPU": 1}
    assert fits({"CPU": 2, "GPU": 1}, node(CPU=2, GPU=1))
    assert not fits({"CPU": 2, "GPU": 1}, node(CPU=4))
    assert not fits({"CPU": 2}, node(CPU=1, GPU=8))
    assert not fits({"CPU": 1}, node(alive=False, CPU=4))


def test_the_wait_for_a_large_enough_node_is_limited_and_ends_with_one_that_joins() -> None:
    clock = Clock()
    room = Room(needs_of(2, "cuda"), clock)
    apart = [node(CPU=8), node(CPU=1, GPU=1), node(alive=False, CPU=8, GPU=8)]
    wait = "takes 2 cores and 1 GPUs, and none of the 2 nodes alive has that (the most of one: 8 cores and 1"
    assert wait in (room.look(apart, {}, 0) or "")
    clock.now = LONGEST_WAIT_SECONDS
    assert room.look(apart, {}, 0) is None, "once"
    assert room.look([node(CPU=2, GPU=1)], {}, 1) is None
    clock.now += 10
    assert wait in (room.look(apart, {}, 0) or ""), "lost again: reported again, and waited for as long as before"
    clock.now += LONGEST_WAIT_SECONDS + 1
    with pytest.raises(InputError, match=r"takes 2 cores and 1 GPUs.*resume with --resume"):
        room.look(apart, {}, 0)


def test_a_silent_head_is_waited_for_and_then_given_up() -> None:
    clock = Clock()
    head: Head[None] = Head(lambda: None, clock)
    clock.now = SILENCE_SAID_SECONDS
    assert head.listen() is None
    clock.now += 1
    assert "does not answer; waiting up to" in (head.listen() or "")
    assert head.listen() is None, "once"
    clock.now = LONGEST_SILENCE_SECONDS + 1
    assert not head.is_lost
    with pytest.raises(InputError, match=r"has not answered for 46 s; finished cells are kept.*--resume"):
        head.listen()
    assert head.is_lost


def test_a_head_that_answers_again_is_no_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.execution.cluster.head.LOOK_SECONDS", 0.0)
    clock = Clock()
    asked: list[int] = []

    def ask() -> int:
        asked.append(len(asked))
        if len(asked) < 3:
            raise RuntimeError("no answer")
        if len(asked) == 3:
            clock.now = LONGEST_SILENCE_SECONDS
        return len(asked)

    with Head(ask, clock) as head:
        while (head.answer or 0) < 4:
            pass
        clock.now += SILENCE_SAID_SECONDS
        assert head.listen() is None


# view sets on nodes without the driver's disk


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small view set, and provide a node with an empty temporary folder."""
    (tmp_path / "node").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "node"))
    monkeypatch.setattr(view_set_files, "PIECE_BYTES", 1000)
    made = tmp_path / "driver" / "ball"
    (made / "train").mkdir(parents=True)
    (made / "train" / "r_0.png").write_bytes(bytes(range(256)) * 10)
    (made / "empty.json").write_bytes(b"")
    (made / ".hidden").write_text("not part of it")
    return made


def fetching(listing: view_set_files.Listing, asked: list[str]) -> Callable[[str, int], bytes]:
    def fetch(relative: str, offset: int) -> bytes:
        asked.append(f"{relative} {offset}")
        return piece(listing, relative, offset)

    return fetch


def shared(folder: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)


def others(folder: Path) -> None:
    folder.mkdir()
    if os.geteuid() != 0:
        pytest.skip("only root gives a folder away")
    os.chown(folder, 65534, 65534)


def led_elsewhere(folder: Path) -> None:
    (folder.parent / "elsewhere").mkdir(mode=0o700)
    folder.symlink_to(folder.parent / "elsewhere")


@pytest.mark.parametrize("made", [shared, others, led_elsewhere, Path.touch])
def test_what_others_could_change_is_not_run_from(
    made: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    folder = node_folder()
    assert folder == node_folder(), "ours is taken again"
    folder.rmdir()
    made(folder)
    with pytest.raises(InputError, match="not a folder of this user only; remove it, or set TMPDIR"):
        node_folder()


def test_a_shared_folder_is_used_and_elsewhere_it_is_fetched_in_pieces_and_once_and_a_damaged_copy_again(
    folder: Path,
) -> None:
    here = listed(folder)
    asked: list[str] = []
    assert on_this_node(here, fetching(here, asked)) == folder
    assert asked == []
    there = replace(here, folder=Path("/not/on/this/node/ball"))
    copy = on_this_node(there, fetching(here, asked))
    assert copy.is_relative_to(node_folder())
    assert copy.name == "ball"
    assert listed(copy).digest == here.digest
    assert asked == ["train/r_0.png 0", "train/r_0.png 1000", "train/r_0.png 2000"]
    assert on_this_node(there, fetching(here, asked)) == copy
    assert len(asked) == 3
    assert not list((node_folder() / "view_sets").glob(".*")), "nothing unfinished stays"
    flip(copy / "train" / "r_0.png")
    assert listed(on_this_node(there, fetching(here, asked))).digest == here.digest


def test_while_a_cell_fetches_the_others_of_its_node_wait(folder: Path) -> None:
    here = listed(folder)

    def fetch(relative: str, offset: int) -> bytes:
        (lock,) = node_folder().glob("*.lock")
        assert is_held(lock)
        return piece(here, relative, offset)

    on_this_node(replace(here, folder=Path("/not/on/this/node/ball")), fetch)
    assert not list(node_folder().glob("*.lock"))


def test_another_content_at_the_same_path_is_not_taken_for_it(folder: Path) -> None:
    here = listed(folder)
    (folder / "train" / "r_0.png").write_bytes(bytes(reversed(range(256))) * 10)
    with pytest.raises(InputError, match="changed while it was copied"):
        on_this_node(here, fetching(here, []))
    assert not list((node_folder() / "view_sets").iterdir())


@pytest.mark.parametrize("path", ["../secret", "/etc/passwd", ".hidden", "train"])
def test_nothing_but_listed_files_is_given_away(folder: Path, path: str) -> None:
    (folder.parent / "secret").write_text("of the driver alone")
    with pytest.raises(KeyError):
        piece(listed(folder), path, 0)


def test_what_differs_between_two_machines_is_named() -> None:
    ours = versions()
    assert differences(ours, ours) == ""
    assert differences(ours, {**ours, "torch": "1.0"}) == f"torch 1.0 instead of {ours['torch']}"
    assert "this program unknown instead of" in differences({"this program": "ab"}, {})
    assert set(ours) >= {"Python", "torch", "numpy", "this program"}


def test_sources_are_read_again_where_that_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "one.py").write_text("A = 1")
    monkeypatch.setattr(provenance, "our_folders", lambda: [tmp_path])
    ours = versions.__wrapped__()  # not what this process was started with
    assert changed_since(ours) == ""
    (tmp_path / "one.py").write_text("A = 2")
    assert changed_since(ours).startswith("this program ")
