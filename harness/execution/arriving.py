"""The scenes of the catalogue, rendered in another process while the groups of those that are ready train.

The renderer takes the place of some workers, so that no core waits for it and the first scores come early. Cells train
beside other work throughout the run: first beside the renderer, later beside other cells.
"""

import multiprocessing
import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from harness.execution.ground_truth import render_view_sets
from harness.execution.progress import RenderProgress
from harness.machine.device import available_cores
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine, Plan


@dataclass(frozen=True)
class Arrival:
    """Progress of the renderer, and the groups that can train from now on, each with its place in the plan."""

    rendered: RenderProgress | None
    """None after the last."""
    tasks: list[tuple[int, GroupTask]]


class Arriving:
    """The view sets of a plan that are still to come."""

    def __init__(
        self, plan: Plan, cache: Path, machine: Machine, ready: Callable[[str, Path], list[GroupTask]]
    ) -> None:
        """Begin to render or check the view sets; `ready` is called once for each complete one, in the thread that
        receives its arrival, and returns its groups.
        """
        self._places = max(1, machine.workers // 2)
        """The number of workers in whose place the renderer runs."""
        self._ready = ready
        self._order = {group: place for place, group in enumerate(plan.groups())}
        threads = self._places * machine.threads if machine.workers > 1 else available_cores()
        self.connection, self._sending = multiprocessing.Pipe(duplex=False)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._send, args=(plan, cache, threads), daemon=True)
        self._thread.start()

    @property
    def places(self) -> int:
        """Return the number of workers that must wait; 0 after the last arrival."""
        return 0 if self.connection.closed else self._places

    def receive(self) -> Arrival:
        """Wait for the next arrival. Raises what the renderer raised."""
        message = self.connection.recv()
        if not isinstance(message, RenderProgress):
            self.connection.close()
            if message is not None:
                raise message
            return Arrival(None, [])
        tasks = [] if message.path is None else self._ready(message.scene, message.path)
        return Arrival(message, [(self._order[task.scene, task.seed], task) for task in tasks])

    def stop(self) -> None:
        """End the renderer after its current view, which is kept for the next run."""
        self._stopped.set()
        self.connection.close()

    def _send(self, plan: Plan, cache: Path, threads: int) -> None:
        sending: Connection = self._sending
        events = render_view_sets(plan.scenes, plan.views, cache, threads=threads)
        try:
            for event in events:
                if self._stopped.is_set():
                    return
                sending.send(event)
            sending.send(None)
        except Exception as error:
            if not self._stopped.is_set():
                sending.send(error)
        finally:
            events.close()
