"""Workers that die at the worst moments, for `harness.execution.local_executor._work`; quick, as they train nothing."""

import os
import signal
import struct
from multiprocessing.connection import Connection
from typing import Any

from harness.execution.group_loop import End


def after_its_last_word(connection: Connection, *_: Any) -> None:
    """Die at seed 0, after the end of a task, before the next one."""
    while (task := connection.recv()) is not None:
        connection.send(0.5)
        connection.send(End())
        if task.seed == 0:
            os.kill(os.getpid(), signal.SIGKILL)


def at_qnerf_in_the_middle_of_a_message(connection: Connection, *_: Any) -> None:
    """Die at tasks with qnerf, 1000 bytes into a message of 50000."""
    while (task := connection.recv()) is not None:
        if "qnerf" in task.methods:
            os.write(connection.fileno(), struct.pack("!i", 50_000) + bytes(1000))
            os.kill(os.getpid(), signal.SIGKILL)
        connection.send(End())
