"""Standard output that never stops a command, though its reader has gone, it is closed, or its encoding is narrow."""

import io
import os
import sys
from typing import Any


class _Dropping(io.FileIO):
    """The file of a standard stream; once its reader has gone or its disk is full, further output is dropped."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            if not isinstance(error, BrokenPipeError):
                sys.stderr.write(f"error: {STREAMS[self.fileno()]}: {error.strerror}; nothing more is written to it\n")
            return len(data)


STREAMS = {1: "standard output", 2: "standard error"}


def go_on_unheard() -> None:
    """Keep this process running if its standard output or error fails: `| head` ends no run. Call it before anything
    that opens a file, which could get the number of a closed stream.
    """
    while (free := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(free)
    for number, name in enumerate(("stdout", "stderr"), start=1):
        stream = getattr(sys, name)
        if stream is not None and not isinstance(stream, io.TextIOWrapper):
            continue  # captured, as by pytest
        setattr(
            sys,
            name,
            io.TextIOWrapper(
                io.BufferedWriter(_Dropping(number, "w", closefd=False)),
                encoding=stream.encoding if stream is not None else "utf-8",
                errors="backslashreplace",
                line_buffering=number == 2 or (stream is not None and stream.line_buffering),
                write_through=stream is not None and stream.write_through,
            ),
        )
