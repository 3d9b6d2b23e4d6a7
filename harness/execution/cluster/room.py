"""Watches whether the cluster has room for a group: a lack is reported at once, and the wait for room is limited."""

import time
from collections.abc import Callable, Mapping
from typing import TypedDict

from scenes.files.errors import InputError

LONGEST_WAIT_SECONDS = 300.0
"""The longest wait for a large enough node to join: a cluster that grows by itself takes minutes."""
IDLE_SECONDS = 60.0
"""The seconds without a group in training before the reason is reported; a node's first process imports torch."""


class Node(TypedDict):
    """The part of an entry of `ray.nodes()` that is used here."""

    NodeID: str
    Alive: bool
    Resources: dict[str, float]


def needs_of(threads: int, device: str) -> dict[str, int]:
    """Return what Ray reserves for a group: processor cores, and a GPU of either vendor if it trains on one."""
    return {"CPU": threads, "GPU": 1} if device == "cuda" else {"CPU": threads}


def fits(needs: Mapping[str, int], node: Node) -> bool:
    """Return whether `node` is alive and could hold `needs` if it were idle."""
    return node["Alive"] and all(node["Resources"].get(name, 0) >= need for name, need in needs.items())


def lack(needs: Mapping[str, int], nodes: list[Node]) -> str:
    """Return why no node holds `needs`, with the maximum that a living node offers."""
    alive = [node["Resources"] for node in nodes if node["Alive"]]
    most = {name: max((resources.get(name, 0) for resources in alive), default=0) for name in needs}
    return (
        f"a group of cells takes {_listed(needs)}, and none of the {len(alive)} nodes alive has that "
        f"(the most of one: {_listed(most)})"
    )


class Room:
    """A watch of the cluster, which reports what a waiting user should know."""

    def __init__(self, needs: Mapping[str, int], clock: Callable[[], float] = time.monotonic) -> None:
        self._needs, self._clock = needs, clock
        self._lacking_since: float | None = None
        self._idle_since: float | None = None
        self._idle_said = False

    def look(self, nodes: list[Node], free: Mapping[str, float], in_training: int) -> str | None:
        """Return a line on a lack of room. Raises `InputError` if no node was large enough for too long a time."""
        now = self._clock()
        if not any(fits(self._needs, node) for node in nodes):
            if self._lacking_since is None:
                self._lacking_since = now
                return f"Ray: {lack(self._needs, nodes)}; waiting up to {LONGEST_WAIT_SECONDS:g} s for one that joins"
            if now - self._lacking_since > LONGEST_WAIT_SECONDS:
                raise InputError(
                    f"--executor ray: {lack(self._needs, nodes)}; finished cells are kept: start Ray on more nodes and "
                    "resume with --resume"
                )
            return None
        self._lacking_since = None
        if in_training:
            self._idle_since = None
            return None
        self._idle_since = now if self._idle_since is None else self._idle_since
        if self._idle_said or now - self._idle_since < IDLE_SECONDS:
            return None
        self._idle_said = True
        total = {name: sum(node["Resources"].get(name, 0) for node in nodes if node["Alive"]) for name in self._needs}
        return (
            f"Ray: no group is in training yet; of the cluster's {_listed(total)} are free: "
            f"{_listed({name: free.get(name, 0) for name in self._needs})}"
        )


def _listed(resources: Mapping[str, float]) -> str:
    names = {"CPU": "cores", "GPU": "GPUs"}
    return " and ".join(f"{amount:g} {names.get(name, name)}" for name, amount in resources.items())
