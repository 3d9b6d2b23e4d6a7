"""The loop over the groups of a run, which is the same for all executors: submit, poll, cancel."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from harness.execution.ground_truth import Arrival
from harness.execution.group import failed_cells, missing_methods
from harness.execution.progress import RenderProgress
from harness.plan.group_task import GroupTask
from harness.records.cells import CellRecord


@dataclass(frozen=True)
class Event:
    """Training of a group advanced, a cell ended, or there is a notice; or the renderer advanced, of no group."""

    task: GroupTask | None
    share: float | None = None
    cell: CellRecord | None = None
    notice: str | None = None
    rendered: RenderProgress | None = None


@dataclass(eq=False)
class Attempt:
    task: GroupTask
    """The task as given, with all methods that were missing at first."""
    number: int = 1
    ended: int = 0
    """The number of its methods that had ended before it."""
    handle: Any = None
    place: int = -1
    """Its place in the plan; attempts that follow a lost one come first."""


@dataclass(frozen=True)
class End:
    """The end of an attempt."""

    lost: str | None = None
    """The reason if some of its cells have not ended."""
    refused: bool = False
    """Whether it was not begun, for that reason, so that another worker may take it."""


News = float | str | CellRecord | End
"""The trained share, a notice, a cell that has ended, or the end."""


class Executor(Protocol):
    refusal: str
    """Why no more are taken."""

    @property
    def room(self) -> int:
        """Return the maximum number of simultaneous attempts; 0 if no more are taken."""

    @property
    def expecting(self) -> bool:
        """Return whether groups may still arrive."""

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        """Begin an attempt at `task`, its task without the methods that have ended."""

    def poll(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News] | Arrival]:
        """Wait for news and arrivals and yield them; raises errors that end the run."""

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        """Return the attempts that follow a lost one and a notice, or no attempt and the reason for its records."""

    def cancel(self, running: list[Attempt]) -> None:
        """End the running attempts and the executor's resources."""


def run_at(executor: Executor, tasks: list[GroupTask]) -> Iterator[Event]:
    """Yield the events of all groups. A lost attempt is followed by others, for the methods that had not ended, or
    recorded as errors; a program error is recorded by its group and not retried. Closing the generator (Ctrl-C) cancels
    running attempts; ended cells are on disk. Groups that arrive wait in the order of the plan.
    """
    waiting = [Attempt(task) for task in tasks]
    running: list[Attempt] = []

    def submit() -> None:
        while waiting and len(running) < executor.room:
            attempt = waiting.pop(0)
            missing = missing_methods(attempt.task)
            attempt.ended = len(attempt.task.methods) - len(missing)
            executor.submit(attempt, replace(attempt.task, methods=missing))
            running.append(attempt)

    try:
        submit()
        while running or executor.expecting:
            for message in executor.poll(running):
                if isinstance(message, Arrival):
                    waiting += [Attempt(task, place=place) for place, task in message.tasks if missing_methods(task)]
                    waiting.sort(key=lambda attempt: attempt.place)
                    submit()
                    if message.rendered is not None:
                        yield Event(None, rendered=message.rendered)
                    continue
                attempt, news = message
                if isinstance(news, End):
                    running.remove(attempt)
                    events = _after(executor, attempt, news, waiting)
                    submit()  # before the events, as a consumer may take its time
                    yield from events
                else:
                    yield _event(attempt, news)
        for attempt in waiting:
            yield from _failed(attempt.task, executor.refusal)
    finally:
        executor.cancel(running)


def _event(attempt: Attempt, news: float | str | CellRecord) -> Event:
    if isinstance(news, float):
        every = len(attempt.task.methods)
        return Event(attempt.task, share=(attempt.ended + news * (every - attempt.ended)) / every)
    if isinstance(news, str):
        return Event(attempt.task, notice=news)
    return Event(attempt.task, cell=news)


def _after(executor: Executor, attempt: Attempt, end: End, waiting: list[Attempt]) -> list[Event]:
    if end.refused:
        waiting.insert(0, attempt)
        return []
    missing = missing_methods(attempt.task)
    if end.lost is None or not missing:
        return [Event(attempt.task, share=1.0)]
    following, notice = executor.again(attempt, end.lost, missing)
    waiting[:0] = following
    return [Event(attempt.task, notice=notice)] if following else _failed(attempt.task, notice)


def _failed(task: GroupTask, reason: str) -> list[Event]:
    return [*(Event(task, cell=cell) for cell in failed_cells(task, reason)), Event(task, share=1.0)]
