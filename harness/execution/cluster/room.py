"""Room on a cluster for a group: a permanent lack is reported at once, and the wait for it is limited."""

import time
from collections.abc import Callable, Mapping
from typing import TypedDict

from scenes.files.errors import InputError

LONGEST_WAIT_SECONDS = 300.0
"""The longest wait for a large enough node to join if none is left: a cluster that grows by itself takes minutes."""
IDLE_SECONDS = 60.0
"""The seconds without any group in training before the reason is reported; a node's first process imports torch
meanwhile.
"""


class Node(TypedDict):
    """What is read of a node in `ray.nodes()`."""

    NodeID: str
    Alive: bool
    Resources: dict[str, float]


def needs_of(threads: int, device: str) -> dict[str, int]:
    """Return what Ray reserves for a group: processor cores, and the GPU that it trains on, of either vendor."""
    return {"CPU": threads, "GPU": 1} if device == "cuda" else {"CPU": threads}


def fits(needs: Mapping[str, int], node: Node) -> bool:
    """Return whether `node` is alive and could hold `needs` if it were idle."""
    return node["Alive"] and all(node["Resources"].get(name, 0) >= least for name, least in needs.items())


def lack(needs: Mapping[str, int], nodes: list[Node]) -> str:
    """Return why no node holds `needs`, in words: the most that a living one offers."""
    alive = [node["Resources"] for node in nodes if node["Alive"]]
    most = {name: max((resources.get(name, 0) for resources in alive), default=0) for name in needs}
    return (
        f"a group of cells takes {_in_words(needs)}, and none of the {len(alive)} nodes alive has that "
        f"(the most of one: {_in_words(most)})"
    )


class Room:
    """A watch of the cluster, which reports what a waiting reader should know."""

    def __init__(self, needs: Mapping[str, int], clock: Callable[[], float] = time.monotonic) -> None:
        self._needs = needs
        self._clock = clock
        self._lacking_since: float | None = None
        self._idle_since: float | None = None
        self._idle_said = False

    def look(self, nodes: list[Node], free: Mapping[str, float], in_training: int) -> str | None:
        """Return a line if there is news on `nodes`, on the `free` part of their sum, and on how many of our groups are
        in training. Raises `InputError` if no node was large enough for too long.
        """
        now = self._clock()
        if not any(fits(self._needs, node) for node in nodes):
            if self._lacking_since is None:
                self._lacking_since = now
                return f"Ray: {lack(self._needs, nodes)}; waiting up to {LONGEST_WAIT_SECONDS:g} s for one that joins"
            if now - self._lacking_since > LONGEST_WAIT_SECONDS:
                raise InputError(
                    f"--executor ray: {lack(self._needs, nodes)}; finished cells are kept: start Ray on more nodes and "
                    "go on with --resume"
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
        all_in_all = {
            name: sum(node["Resources"].get(name, 0) for node in nodes if node["Alive"]) for name in self._needs
        }
        return (
            f"Ray: no group is in training yet; of the cluster's {_in_words(all_in_all)} are free: "
            f"{_in_words({name: free.get(name, 0) for name in self._needs})}"
        )


def _in_words(resources: Mapping[str, float]) -> str:
    names = {"CPU": "cores", "GPU": "GPUs"}
    return " and ".join(f"{amount:g} {names.get(name, name)}" for name, amount in resources.items())
