"""The mailbox where nodes leave messages, on the driver's own node: it outlives every other node."""

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from harness.execution.cluster.view_set_files import Listing, piece
from harness.records.cells import CellRecord

Key = tuple[str, int]
"""The (scene, seed) of a group."""


@dataclass(frozen=True)
class Began:
    """A group is in training at a node, which may be another one than before."""

    group: Key
    attempt: int
    node: str


@dataclass(frozen=True)
class TrainedShare:
    """The share of the work of this attempt at a group that is trained."""

    group: Key
    attempt: int
    share: float


@dataclass(frozen=True)
class Delivered:
    """A cell has ended."""

    group: Key
    attempt: int
    cell: CellRecord
    files: dict[str, bytes] = field(repr=False)
    """Map path inside the output folder → content: checkpoint and pictures."""


@dataclass(frozen=True)
class Kept:
    """Snapshots of cells in the middle of their training."""

    group: Key
    attempt: int
    files: dict[str, bytes] = field(repr=False)
    """The files as in `Delivered`; each replaces the one before."""


@dataclass(frozen=True)
class Said:
    """A note that a reader of the run should know."""

    group: Key
    attempt: int
    text: str


Message = Began | TrainedShare | Delivered | Kept | Said


class Mailbox:
    """Messages in the order of their arrival, until the driver takes them."""

    def __init__(self) -> None:
        self._waiting: deque[Message] = deque()

    def put(self, message: Message) -> bool:
        """Add a message; returns True, so that a sender can wait until it has arrived."""
        self._waiting.append(message)
        return True

    def take(self) -> list[Message]:
        taken = list(self._waiting)
        self._waiting.clear()
        return taken


class Files:
    """An actor that returns the pieces of listed view sets to nodes that do not share the driver's disk."""

    def __init__(self, listings: dict[str, Listing]) -> None:
        self._listings = listings

    def piece(self, digest: str, relative: str, offset: int) -> bytes:
        return piece(self._listings[digest], relative, offset)


Handle = Any
"""The handle of an actor: Ray gives it no type."""
