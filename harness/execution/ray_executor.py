"""Executes groups of cells on a Ray cluster: placed by their needs, retried if a node dies, written only here."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

from harness.execution.cluster.connection import give_up
from harness.execution.cluster.head import Head
from harness.execution.cluster.mailbox import Files, Handle, Key, Mailbox, Message
from harness.execution.cluster.node_work import GroupOrder, group_on_node
from harness.execution.cluster.room import Node, Room, needs_of
from harness.execution.cluster.view_set_files import Listing, listed
from harness.execution.group_loop import Attempt, End, Event, News, run_at
from harness.machine.provenance import versions
from harness.plan.group_task import GroupTask
from harness.records.cells import cell_path, write_cell
from harness.records.snapshot import drop_ended, unfinished_path
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError, named

MOST_ATTEMPTS = 6
"""The maximum number of attempts at a group that a dying node or worker ends; then its cells are recorded as errors."""
POLL_SECONDS = 0.2

Look = tuple[list[Node], dict[str, float]]
"""The state of the cluster: its nodes, and the free part of their resources."""


def run_on_ray(tasks: list[GroupTask], commit: str) -> Iterator[Event]:
    """Run all tasks on the Ray cluster that this process has joined, as far as there is room.

    A group takes `threads` cores, and a GPU if it trains on one. If its node or process dies, it is retried elsewhere,
    with bit-identical results. Raises the `OSError` of a disk that cannot be written, here or on a node, and
    `InputError` if a node has other packages, none is large enough, or the cluster is lost.
    """
    import ray
    from ray import exceptions as errors

    if not tasks:
        return
    with Head(lambda: (ray.nodes(), ray.available_resources())) as head:
        try:
            yield from run_at(_Cluster(tasks, commit, head), tasks)
        except errors.RayError as error:
            cause = error.cause if isinstance(error, errors.RayTaskError) else error
            if not isinstance(cause, errors.RayError):
                raise
            why = named(cause)
            no_answer = errors.RaySystemError, errors.RpcError, errors.LocalRayletDiedError, errors.ActorDiedError
            if isinstance(cause, no_answer):
                why = (
                    f"the cluster is lost ({type(cause).__name__}): its head or this node's Ray ended; start Ray again"
                )
            raise InputError(f"--executor ray: {why}; finished cells are kept: resume with --resume") from error
        finally:
            if head.is_lost:
                give_up()


class _Cluster:
    """The cluster, which gets all groups at once; its nodes leave messages in a mailbox on this node."""

    def __init__(self, tasks: list[GroupTask], commit: str, head: Head[Look]) -> None:
        self.expecting = False
        self.room, self.refusal = len(tasks), ""
        self._commit, self._head = commit, head
        self._listings = {task.view_set: listed(task.view_set) for task in tasks}
        self._mailbox, self._files = _actors_here(list(self._listings.values()))
        self._watch = Room(needs_of(tasks[0].threads, tasks[0].device))
        self._nodes: dict[Attempt, str] = {}

    def submit(self, attempt: Attempt, task: GroupTask) -> None:
        import ray

        listing = self._listings[task.view_set]
        order = GroupOrder(task, attempt.number, listing, versions(), self._commit, _unfinished(task))
        needs = needs_of(task.threads, task.device)  # Ray shows a process its GPU of either vendor
        reserved = {"num_cpus": needs["CPU"], "num_gpus": needs.get("GPU", 0)}
        # `run_at` retries, not Ray
        work = ray.remote(group_on_node).options(**reserved, max_retries=0, scheduling_strategy="SPREAD")
        attempt.handle = work.remote(order, self._mailbox, self._files)

    def poll(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News]]:
        import ray

        by_handle = {attempt.handle: attempt for attempt in running}
        ended, _ = ray.wait(list(by_handle), num_returns=1, timeout=POLL_SECONDS)
        yield from self._deliver(running)
        in_training = sum(attempt in self._nodes for attempt in running)
        answer = self._head.answer
        for line in (self._head.listen(), answer and self._watch.look(*answer, in_training)):
            if line:
                yield running[0], line
        for handle in ended:
            lost = _lost(handle)
            # its messages before its end have arrived by now
            yield from self._deliver(running)
            yield by_handle[handle], End(lost)

    def _deliver(self, running: list[Attempt]) -> Iterator[tuple[Attempt, News]]:
        import ray

        taken = self._mailbox.take.remote()
        while not ray.wait([taken], timeout=POLL_SECONDS)[0]:
            if line := self._head.listen():
                yield running[0], line
        yield from news_of(ray.get(taken), running, self._nodes)

    def again(self, attempt: Attempt, lost: str, missing: tuple[str, ...]) -> tuple[list[Attempt], str]:
        task, node = attempt.task, self._nodes.pop(attempt, "unknown")
        if attempt.number == MOST_ATTEMPTS:
            return [], f"{lost}, {attempt.number} times in a row"
        kept, snapshots = len(task.methods) - len(missing), len(_unfinished(replace(task, methods=missing)))
        return [Attempt(task, attempt.number + 1)], (
            f"{task.scene} seed {task.seed}: {lost} (node {node}) at attempt {attempt.number}"
            f"{f'; {kept} of its cells had ended and are kept' if kept else ''}; {len(missing)} cells are trained again"
            f"{f', {snapshots} of them from their snapshots' if snapshots else ''}"
        )

    def cancel(self, running: list[Attempt]) -> None:
        import ray

        if not self._head.is_lost:  # else these calls would wait for it
            with suppress(ray.exceptions.RayError):
                for attempt in running:
                    ray.cancel(attempt.handle, force=True)
                for actor in (self._mailbox, self._files):
                    ray.kill(actor)


def _actors_here(listings: list[Listing]) -> tuple[Handle, Handle]:
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=False)
    mailbox = ray.remote(Mailbox).options(num_cpus=0, scheduling_strategy=here).remote()
    by_digest = {listing.digest: listing for listing in listings}
    return mailbox, ray.remote(Files).options(num_cpus=0, scheduling_strategy=here, max_concurrency=4).remote(by_digest)


def _unfinished(task: GroupTask) -> dict[str, bytes]:
    """Map path inside the output folder → content of each snapshot of the group."""
    files = [unfinished_path(task.out, task.scene, name, task.seed) for name in task.methods]
    return {file.relative_to(task.out).as_posix(): file.read_bytes() for file in files if file.is_file()}


def news_of(
    messages: list[Message], running: list[Attempt], nodes: dict[Attempt, str]
) -> Iterator[tuple[Attempt, News]]:
    """Write delivered cells, each record last; update `nodes`; yield the news, except late ones of lost attempts."""
    by_group: dict[Key, Attempt] = {(attempt.task.scene, attempt.task.seed): attempt for attempt in running}
    for message in messages:
        attempt = by_group.get(message.group)
        if attempt is None or (message.cell is None and message.attempt != attempt.number):
            continue
        out, cell = attempt.task.out, message.cell
        known = cell is not None and cell_path(out, cell.scene, cell.method, cell.seed).exists()
        for relative, content in message.files.items() if not known else ():
            write_atomically(out / relative, content)
        if cell is not None:
            if not known:
                write_cell(out, cell)  # last: a record promises its files
            drop_ended(out, cell)
        if message.node is not None:
            nodes[attempt] = message.node
        for news in (None if known else cell, message.notice, message.share):
            if news is not None:
                yield attempt, news


def _lost(reference: object) -> str | None:
    """Return why an attempt was lost; None if it ended regularly. Raises errors that end the run."""
    import ray
    from ray import exceptions

    try:
        refusal = ray.get(reference)
    except exceptions.NodeDiedError:
        return "the node died"
    except (exceptions.WorkerCrashedError, exceptions.OutOfMemoryError, exceptions.ObjectLostError) as error:
        return f"the worker process died ({type(error).__name__}; out of memory, perhaps)"
    except exceptions.RayTaskError as error:
        if isinstance(error.cause, OSError):
            raise OSError(error.cause.errno, error.cause.strerror, error.cause.filename) from error
        raise
    if refusal is not None:
        raise InputError(refusal)
    return None
