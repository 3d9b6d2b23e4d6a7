"""Messages on a cluster that lacks room, is busy, or has lost its head, and the errors that end a run."""

from typing import Any

import pytest

from harness.execution.cluster.head import LONGEST_SILENCE_SECONDS, SILENCE_SAID_SECONDS, Head
from harness.execution.cluster.room import LONGEST_WAIT_SECONDS, Room, fits, needs_of
from scenes.files.errors import InputError


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


def test_the_wait_for_a_large_enough_node_is_limited() -> None:
    clock = Clock()
    room = Room(needs_of(2, "cuda"), clock)
    apart = [node(CPU=8), node(CPU=1, GPU=1), node(alive=False, CPU=8, GPU=8)]
    said = room.look(apart, {}, 0)
    assert "takes 2 cores and 1 GPUs, and none of the 2 nodes alive has that (the most of one: 8 cores and 1" in said
    clock.now = LONGEST_WAIT_SECONDS
    assert room.look(apart, {}, 0) is None, "once"
    clock.now += 1
    with pytest.raises(InputError, match=r"takes 2 cores and 1 GPUs.*resume with --resume"):
        room.look(apart, {}, 0)


def test_a_node_that_joins_in_time_ends_the_wait() -> None:
    clock = Clock()
    room = Room(needs_of(1, "cpu"), clock)
    assert room.look([node(alive=False, CPU=1)], {}, 0)
    clock.now = LONGEST_WAIT_SECONDS
    assert room.look([node(CPU=1)], {}, 1) is None
    clock.now += 10
    assert room.look([], {}, 0), "lost again: reported again, and waited for as long as before"


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
