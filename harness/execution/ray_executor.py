"""Groups of cells on a Ray cluster: placed by their needs, retried if a node dies, written here alone."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.execution.cluster.connection import give_up
from harness.execution.cluster.head import Head
from harness.execution.cluster.mailbox import Files, Handle, Key, Mailbox, Message
from harness.execution.cluster.node_work import GroupOrder, group_on_node
from harness.execution.cluster.room import Room, needs_of
from harness.execution.cluster.view_set_files import Listing, listed
from harness.execution.group import failed_cells, missing_methods
from harness.execution.local_executor import Event
from harness.machine.provenance import versions
from harness.plan.group_task import GroupTask
from harness.records.cells import cell_path, write_cell
from harness.records.snapshot import drop_ended, unfinished_path
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError

MOST_ATTEMPTS = 6
"""The most attempts at one group, counting those ended by a dying node or worker; then its cells are recorded as
errors.
"""
POLL_SECONDS = 0.2

Look = tuple[list[dict[str, Any]], dict[str, float]]
"""A view of the cluster: its nodes, and the free part of all their resources."""


@dataclass
class _Running:
    """An attempt at a group."""

    task: GroupTask
    """The task as it was given, with all methods that were missing at first."""
    attempt: int
    node: str | None = None
    """The node where it is in training; None until it is."""
    missing: int = 0
    """The number of methods of this attempt."""


def run_on_ray(tasks: list[GroupTask], commit: str) -> Iterator[Event]:
    """Run all tasks on the cluster that `harness.execution.cluster.connection.connect` has joined, as many as it has
    room for.

    A group takes `threads` cores, and one GPU if it trains on one. If its node or process dies, it is retried elsewhere
    without the methods that had ended, to the same bits; an error of ours is recorded and not retried. Raises the
    `OSError` of a disk that accepts nothing, here or on a node, and `InputError` if a node has other packages, if none
    is left that is large enough, and if the cluster as a whole is lost. Closing the generator (Ctrl-C) cancels running
    groups; ended cells are on disk.
    """
    import ray

    if not tasks:
        return
    with Head(lambda: (ray.nodes(), ray.available_resources())) as head:
        try:
            yield from _run(tasks, commit, head)
        except ray.exceptions.RayError as error:
            cause = error.cause if isinstance(error, ray.exceptions.RayTaskError) else error
            if not isinstance(cause, ray.exceptions.RayError):
                raise
            why = " ".join(f"{type(cause).__name__}: {cause}".split())[:300]
            if isinstance(cause, _lost_clusters()):
                why = (
                    f"the cluster is lost ({type(cause).__name__}): its head or this node's Ray ended; start Ray again"
                )
            raise InputError(f"--executor ray: {why}; finished cells are kept: go on with --resume") from error
        finally:
            if head.is_lost:
                give_up()


def _lost_clusters() -> tuple[type[Exception], ...]:
    """Return the errors that Ray raises if there is nobody left to talk to."""
    from ray import exceptions

    return exceptions.RaySystemError, exceptions.RpcError, exceptions.LocalRayletDiedError, exceptions.ActorDiedError


def _run(tasks: list[GroupTask], commit: str, head: Head[Look]) -> Iterator[Event]:
    import ray

    listings = {task.view_set: listed(task.view_set) for task in tasks}
    mailbox, files = _beside_us(list(listings.values()))
    running: dict[Any, _Running] = {}
    room = Room(needs_of(tasks[0].threads, tasks[0].device))

    def submit(task: GroupTask, attempt: int) -> None:
        missing = missing_methods(task)
        given = replace(task, methods=missing)
        order = GroupOrder(given, attempt, listings[task.view_set], versions(), commit, _unfinished(given))
        reference = ray.remote(group_on_node).options(**_resources(task)).remote(order, mailbox, files)
        running[reference] = _Running(task, attempt, missing=len(missing))

    def told() -> Iterator[Event]:
        taken = mailbox.take.remote()
        while not ray.wait([taken], timeout=POLL_SECONDS)[0]:
            if line := head.listen():
                yield Event(tasks[0], notice=line)
        yield from _told(ray.get(taken), running)

    try:
        for task in tasks:
            submit(task, 1)
        while running:
            ended, _ = ray.wait(list(running), num_returns=1, timeout=POLL_SECONDS)
            yield from told()
            in_training = sum(attempt.node is not None for attempt in running.values())
            for line in (head.listen(), head.answer and room.look(*head.answer, in_training)):
                if line:
                    yield Event(tasks[0], notice=line)
            for reference in ended:
                attempt = running[reference]
                lost = _lost(reference)
                # everything that it delivered before its end has arrived by now
                yield from told()
                del running[reference]
                if lost is None or not missing_methods(attempt.task):
                    yield Event(attempt.task, share=1.0)
                elif attempt.attempt < MOST_ATTEMPTS:
                    left = len(missing_methods(attempt.task))
                    kept = len(attempt.task.methods) - left
                    yield Event(attempt.task, notice=_notice(attempt, lost, left, kept))
                    submit(attempt.task, attempt.attempt + 1)
                else:
                    reason = f"{lost}, {attempt.attempt} times in a row"
                    for cell in failed_cells(attempt.task, reason):
                        yield Event(attempt.task, cell=cell)
                    yield Event(attempt.task, share=1.0)
    finally:
        if not head.is_lost:  # else these would wait for it
            with suppress(ray.exceptions.RayError):
                for reference in running:
                    ray.cancel(reference, force=True)
                for actor in (mailbox, files):
                    ray.kill(actor)


def _beside_us(listings: list[Listing]) -> tuple[Handle, Handle]:
    """Return mailbox and files as actors of the node that this process is on."""
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    mailbox = ray.remote(Mailbox).options(num_cpus=0, scheduling_strategy=here).remote()
    by_digest = {listing.digest: listing for listing in listings}
    return mailbox, ray.remote(Files).options(num_cpus=0, scheduling_strategy=here, max_concurrency=4).remote(by_digest)


def _resources(task: GroupTask) -> dict[str, Any]:
    """Return what Ray reserves; it shows a process the GPU that it has, of either vendor. Retries are ours."""
    needs = needs_of(task.threads, task.device)
    return {
        "num_cpus": needs["CPU"],
        "num_gpus": needs.get("GPU", 0),
        "max_retries": 0,
        "scheduling_strategy": "SPREAD",
    }


def _unfinished(task: GroupTask) -> dict[str, bytes]:
    """Return the snapshots of its cells, path inside the output folder → content."""
    return {file.relative_to(task.out).as_posix(): file.read_bytes() for file in _kept_files(task)}


def _kept_files(task: GroupTask) -> list[Path]:
    files = [unfinished_path(task.out, task.scene, name, task.seed) for name in task.methods]
    return [file for file in files if file.is_file()]


def _told(messages: list[Message], running: dict[Any, _Running]) -> Iterator[Event]:
    """Write delivered cells, record last, and yield the other events; late messages of a lost attempt are dropped."""
    by_group: dict[Key, _Running] = {(attempt.task.scene, attempt.task.seed): attempt for attempt in running.values()}
    for message in messages:
        attempt = by_group.get(message.group)
        if attempt is None:
            continue
        task, cell = attempt.task, message.cell
        if cell is None and message.attempt != attempt.attempt:
            continue
        known = cell is not None and cell_path(task.out, cell.scene, cell.method, cell.seed).exists()
        for relative, content in message.files.items() if not known else ():
            write_atomically(task.out / relative, content)
        if cell is not None:
            if not known:
                write_cell(task.out, cell)  # last: a record says that its files are there
            drop_ended(task.out, cell)
            if not known:
                yield Event(task, cell=cell)
        if message.notice is not None:
            yield Event(task, notice=message.notice)
        if message.node is not None:
            attempt.node = message.node
        if message.share is not None:
            before = len(task.methods) - attempt.missing
            share = (before + message.share * attempt.missing) / len(task.methods)
            yield Event(task, share=share)


def _lost(reference: Any) -> str | None:
    """Return why an attempt ended without an end of its own; None if it had one. Raises errors that end the run."""
    import ray
    from ray import exceptions as crashed

    try:
        refusal = ray.get(reference)
    except crashed.NodeDiedError:
        return "the node died"
    except (
        ray.exceptions.WorkerCrashedError,
        ray.exceptions.OutOfMemoryError,
        ray.exceptions.ObjectLostError,
    ) as error:
        return f"the worker process died ({type(error).__name__}; out of memory, perhaps)"
    except crashed.RayTaskError as error:
        if isinstance(error.cause, OSError):
            raise OSError(error.cause.errno, error.cause.strerror, error.cause.filename) from error
        raise
    if refusal is not None:
        raise InputError(refusal)
    return None


def _notice(attempt: _Running, lost: str, left: int, kept: int) -> str:
    kept_files = _kept_files(replace(attempt.task, methods=missing_methods(attempt.task)))
    known = f", {len(kept_files)} of them kept on their way" if kept_files else ""
    has = f"; {kept} of its cells had ended and are kept" if kept else ""
    return (
        f"{attempt.task.scene} seed {attempt.task.seed}: {lost} (node {attempt.node or 'unknown'}) at attempt "
        f"{attempt.attempt}{has}; {left} cells are trained again{known}"
    )
