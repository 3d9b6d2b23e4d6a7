"""Detect readers that take too long, allocate too much memory, write elsewhere, or refuse without a reason."""

import os
import re
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

LIMITS = {"processor": 20.0, "clock": 60.0}
"""Seconds; the wall clock has a higher limit, as the machine may be busy."""
MOST_BYTES = 2 << 30
LONGEST_REFUSAL = 2000
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGING = {
    "os.mkdir": (0,), "os.remove": (0,), "os.rmdir": (0,), "os.rename": (0, 1), "os.link": (1,), "os.symlink": (1,),
    "os.truncate": (0,), "os.chmod": (0,), "shutil.rmtree": (0,), "shutil.move": (0, 1),
}  # fmt: skip
"""Audit event → the indices of the paths that it changes."""


class Fault(BaseException):
    """A forbidden effect of an input; `except Exception` in a reader does not catch it."""


class Watch:
    """Watches this process while an input is read; one per process, as an audit hook cannot be removed."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch.resolve()
        self.watching = False
        sys.addaudithook(self._audit)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.watching:
            return
        if event == "open":
            path, _, flags = arguments
            changed = [path] if isinstance(flags, int) and flags & WRITING else []
        else:
            changed = [arguments[place] for place in CHANGING.get(event, ())]
        for path in changed:
            if isinstance(path, str | bytes | os.PathLike):
                self._require_inside(event, path)

    def _require_inside(self, event: str, path: Any) -> None:
        self.watching = False  # resolving a path raises audit events too
        try:
            name = Path(os.fsdecode(path))
            # the name that is created or removed, not the target of a link
            target = name.resolve() if event == "open" else name.parent.resolve() / name.name
        except (OSError, ValueError, RuntimeError):
            return  # an invalid name: the call itself fails
        finally:
            self.watching = True
        if not target.is_relative_to(self.scratch) and not f"{target}/".startswith(("/dev/", "/proc/")):
            raise Fault(f"{event} outside of its folder: {target}")

    def is_read(
        self, call: Callable[[], object], refusals: tuple[type[Exception], ...], names: tuple[str, ...]
    ) -> bool:
        """Return False if the input is refused with a message that contains one of the names.

        Raises `AssertionError` for a bad refusal and for a fault; other exceptions propagate.
        """
        try:
            with _bounded():
                self.watching = True
                try:
                    call()
                finally:
                    self.watching = False
        except Fault as fault:
            raise AssertionError(str(fault)) from fault
        except refusals as refusal:
            if wrong := fault_of(str(refusal), names):
                raise AssertionError(f"a refusal that {wrong}: {refusal!s:.300}") from refusal
            return False
        return True


def fault_of(message: str, names: tuple[str, ...]) -> str | None:
    """Return the fault of a refusal; None if it names the input and gives a reason."""
    known = [name for name in names if name in message]
    if not known:
        return f"names none of {names}"
    if len(re.findall(r"[A-Za-z]{2,}", message.replace(known[0].strip() or "\0", ""))) < 3:
        return "gives no reason"
    if len(message) > LONGEST_REFUSAL:
        return f"has {len(message)} characters"
    return "contains control characters" if any(ord(letter) < 32 and letter != "\n" for letter in message) else None


@contextmanager
def _bounded() -> Iterator[None]:
    """Let requests for 2 GB more than the present memory fail, and end calls that take too long."""

    def late(number: int, frame: FrameType | None) -> None:
        raise Fault(f"took longer than {LIMITS}")

    clocks = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    handlers = {number: signal.signal(number, late) for number in clocks}
    memory = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, memory[1]))
    # pytest-timeout has running timers, which are restored
    timers = [signal.setitimer(clock, limit) for clock, limit in zip(clocks.values(), LIMITS.values(), strict=True)]
    try:
        yield
    finally:
        for (number, clock), timer in zip(clocks.items(), timers, strict=True):
            signal.setitimer(clock, 0.0)
            signal.signal(number, handlers[number])
            signal.setitimer(clock, *timer)
        resource.setrlimit(resource.RLIMIT_AS, memory)
