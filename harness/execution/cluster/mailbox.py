"""The mailbox where nodes leave messages, on the driver's node, so that it outlives every other node."""

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from harness.execution.cluster.view_set_files import Listing, piece
from harness.records.cells import CellRecord

Key = tuple[str, int]
"""The scene and seed of a group."""


@dataclass(frozen=True)
class Message:
    """An event of an attempt at a group: one of the optional fields is set, with or without `files`."""

    group: Key
    attempt: int
    node: str | None = None
    """The node on which the group now trains."""
    share: float | None = None
    """The finished share of the work of this attempt."""
    cell: CellRecord | None = None
    """A cell that has ended; `files` are its checkpoint and pictures."""
    notice: str | None = None
    files: dict[str, bytes] = field(default_factory=dict, repr=False)
    """Map path inside the output folder → content; without a `cell`, these are snapshots of cells in training."""


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
"""The handle of an actor, for which Ray has no type."""
