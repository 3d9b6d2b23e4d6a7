"""What an input does to its reader: it is accepted, refused in words, or it shows a fault."""

import os
import re
import resource
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

MOST_SECONDS = 5.0
"""Of the processor."""
PATIENCE = 12
"""As many times that by the clock: the machine may have other things to do, and who waits needs no processor."""
MOST_BYTES = 2 << 30
LONGEST_REFUSAL = 2000
ROOT = Path(__file__).parents[2]
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGING = {
    "os.mkdir": 1, "os.remove": 1, "os.rmdir": 1, "os.rename": 2, "os.link": 2, "os.symlink": 2, "os.truncate": 1,
    "os.chmod": 1, "os.chown": 1, "os.utime": 1, "shutil.rmtree": 1, "shutil.move": 2,
}  # fmt: skip
"""Audit event → how many of its first arguments are paths. Of a symbolic link the second alone is written."""


Names = str | tuple[str, ...]


class Fault(BaseException):
    """Something that no input may do; no reader's `except Exception` stops it."""


@dataclass(frozen=True)
class Outcome:
    """Of one input."""

    kind: str
    """accepted, refused or fault."""
    why: str = ""
    """The refusal, or what was wrong and where."""


class Guard:
    """Watches this process: writes outside of `scratch` are faults while an input is tried. One for a process, as an
    audit hook stays for good."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch.resolve()
        self.watching = False
        sys.addaudithook(self._audit)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.watching:
            return
        if event == "open":
            path, _, flags = arguments
            if isinstance(path, str | bytes | os.PathLike) and isinstance(flags, int) and flags & WRITING:
                self._inside(path, event)
        elif event in CHANGING:
            paths = arguments[: CHANGING[event]]
            for path in paths[1:] if event in ("os.symlink", "os.link") else paths:
                if isinstance(path, str | bytes | os.PathLike):
                    self._inside(path, event)

    def _inside(self, path: Any, event: str) -> None:
        self.watching = False  # resolving is looking as well
        try:
            name = Path(os.fsdecode(path))
            # the name that is made or taken away, not what a link leads to
            target = name.parent.resolve() / name.name if event != "open" else name.resolve()
        except (OSError, ValueError, RuntimeError):
            return  # no such name: the call fails by itself
        finally:
            self.watching = True
        if not target.is_relative_to(self.scratch) and not f"{target}/".startswith(("/dev/", "/proc/")):
            self.watching = False
            raise Fault(f"{event} outside of its folder: {target}")

    def tried(self, call: Callable[[], object], refusals: tuple[type[BaseException], ...], names: Names) -> Outcome:
        """`names` must be in every refusal: the file's name, or one of those of options."""
        before = _peak()
        try:
            with _alarm():
                self.watching = True
                try:
                    call()
                finally:
                    self.watching = False
        except refusals as refusal:
            wrong = bad_refusal(str(refusal), names)
            outcome = (
                Outcome("fault", f"{wrong}: {str(refusal)[:300]!r}") if wrong else Outcome("refused", str(refusal))
            )
        except Fault as fault:
            outcome = Outcome("fault", f"{fault} {_where(fault)}")
        except Exception as error:
            outcome = Outcome("fault", f"{type(error).__name__} {_where(error)}: {str(error)[:200]}")
        else:
            outcome = Outcome("accepted")
        if _peak() - before > MOST_BYTES:
            return Outcome("fault", f"memory grew by {(_peak() - before) >> 20} MiB ({outcome.why[:80]})")
        return outcome


def limit_memory() -> None:
    """A request for 2 GB more than the process has now fails; what is mapped already counts nothing."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_BYTES, resource.RLIM_INFINITY))


def bad_refusal(message: str, names: Names) -> str | None:
    """Return why a refusal is no good one; None if it names the file, or one of the options, and a reason in words."""
    known = [names] if isinstance(names, str) else [name for name in names if re.search(rf"\b{name}\b", message)]
    if not known or known[0] not in message:
        return f"a refusal that does not name {names} ({kind_of_refusal(message)})"
    if len(re.findall(r"[A-Za-z]{2,}", message.replace(known[0].strip() or "\0", ""))) < 3:
        return "a refusal without a reason"
    if len(message) > LONGEST_REFUSAL:
        return f"a refusal of {len(message)} characters"
    if any(ord(character) < 32 and character != "\n" for character in message):
        return "a refusal with control characters"
    return None


def kind_of_refusal(message: str) -> str:
    """The same for refusals that differ in names and numbers alone."""
    without = re.sub(r"'[^']*'|\"[^\"]*\"|/\S+|\d\S*", "·", message)
    return re.sub(r"\W+", " ", without)[:160]


def kind_of_fault(why: str) -> str:
    return re.sub(r"\d{3,}|'[^']*'", "·", why.split(": ")[0])[:200]


def _where(error: BaseException) -> str:
    """The innermost line of ours."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename.startswith(str(ROOT))]
    ours = [f for f in frames if "/tests/" not in f.filename] or frames
    if not ours:
        return ""
    return f"at {Path(ours[-1].filename).relative_to(ROOT)}:{ours[-1].name}:{ours[-1].lineno}"


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


@contextmanager
def _alarm() -> Iterator[None]:
    def late(number: int, frame: FrameType | None) -> None:
        raise Fault(f"took longer than {limits[clocks[number]]:g} s")

    clocks = {signal.SIGPROF: signal.ITIMER_PROF, signal.SIGALRM: signal.ITIMER_REAL}
    limits = {signal.ITIMER_PROF: MOST_SECONDS, signal.ITIMER_REAL: PATIENCE * MOST_SECONDS}
    before = {number: signal.signal(number, late) for number in clocks}
    for clock, seconds in limits.items():
        signal.setitimer(clock, seconds)
    try:
        yield
    finally:
        for clock in limits:
            signal.setitimer(clock, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
