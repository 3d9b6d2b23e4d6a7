"""Watches the head of the cluster: without it Ray ends this process after a minute, without a message."""

import threading
import time
from collections.abc import Callable
from typing import Generic, TypeVar

from scenes.files.errors import InputError

LOOK_SECONDS = 2.0
SILENCE_SAID_SECONDS = 15.0
LONGEST_SILENCE_SECONDS = 45.0
"""The longest wait for a head that restarts; Ray's timeout (`gcs_rpc_server_reconnect_timeout_s`) is 60."""

T = TypeVar("T")


class Head(Generic[T]):
    """A context in which another thread calls `ask`, because a call to a vanished head blocks."""

    def __init__(self, ask: Callable[[], T], clock: Callable[[], float] = time.monotonic) -> None:
        self._ask, self._clock = ask, clock
        self._answered = clock()
        self._said = False
        self._left = threading.Event()
        self.is_lost = False
        self.answer: T | None = None

    def __enter__(self) -> "Head[T]":
        threading.Thread(target=self._ask_repeatedly, daemon=True).start()
        return self

    def __exit__(self, *error: object) -> None:
        self._left.set()

    def listen(self) -> str | None:
        """Return a line if the head has become silent; raises `InputError` if it has been silent for too long."""
        silent = self._clock() - self._answered
        if silent > LONGEST_SILENCE_SECONDS:
            self.is_lost = True
            raise InputError(
                f"--executor ray: the head of the Ray cluster has not answered for {silent:.0f} s; finished cells are "
                "kept: start Ray again and resume with --resume"
            )
        was_said, self._said = self._said, silent > SILENCE_SAID_SECONDS
        if self._said and not was_said:
            return f"Ray: the head of the cluster does not answer; waiting up to {LONGEST_SILENCE_SECONDS:g} s"
        return None

    def _ask_repeatedly(self) -> None:
        while not self._left.wait(LOOK_SECONDS):
            try:
                self.answer = self._ask()
            except Exception:
                continue
            self._answered = self._clock()
