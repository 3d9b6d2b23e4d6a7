"""The head of the cluster, asked from time to time: without it Ray ends this process after a minute, without any
message.
"""

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Generic, TypeVar

from scenes.files.errors import InputError

LOOK_SECONDS = 2.0
SILENCE_SAID_SECONDS = 15.0
LONGEST_SILENCE_SECONDS = 45.0
"""The longest silence, less than Ray's own patience (`gcs_rpc_server_reconnect_timeout_s`, 60): a head that is
restarted is waited for, and finished cells are reported.
"""

T = TypeVar("T")


class Head(Generic[T]):
    """A context in which a thread calls `ask`, because a thread that asks a vanished head is stuck."""

    def __init__(self, ask: Callable[[], T], clock: Callable[[], float] = time.monotonic) -> None:
        self._ask = ask
        self._clock = clock
        self._answered = clock()
        self._said = False
        self._left = threading.Event()
        self.is_lost = False
        self.answer: T | None = None
        """The last answer."""

    def __enter__(self) -> "Head[T]":
        threading.Thread(target=self._go_on, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._left.set()

    def listen(self) -> str | None:
        """Return a line for a reader if it has become silent; raises `InputError` if it has been silent
        for too long.
        """
        silent = self._clock() - self._answered
        if silent > LONGEST_SILENCE_SECONDS:
            self.is_lost = True
            raise InputError(
                f"--executor ray: the head of the Ray cluster has not answered for {silent:.0f} s; finished cells are "
                "kept: start Ray again and go on with --resume"
            )
        if silent <= SILENCE_SAID_SECONDS:
            self._said = False
        elif not self._said:
            self._said = True
            return f"Ray: the head of the cluster does not answer; waiting up to {LONGEST_SILENCE_SECONDS:g} s"
        return None

    def _go_on(self) -> None:
        while not self._left.wait(LOOK_SECONDS):
            try:
                self.answer = self._ask()
            except Exception:
                continue
            self._answered = self._clock()
