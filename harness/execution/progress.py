"""The display of a running command: bars on a terminal, plain lines elsewhere, nothing with --quiet.

The remaining time is estimated from finished work; there is no estimate before anything is finished.
"""

import heapq
import sys
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from harness.plan.schedule import checkpoint_fractions

if TYPE_CHECKING:
    from rich.progress import TaskID

    from harness.execution.ground_truth import RenderProgress
    from harness.execution.group import GroupTask
    from harness.records.cells import CellRecord

UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
ENOUGH = 0.25
"""The share of a piece of work after which its pace allows an estimate of the rest."""
SPREAD = (0.7, 1.4)
"""The factors of the rest at the pace so far: for a group of cells, whose first steps skip no empty space, and for
scenes, which differ by so much (`docs/reduced/summary.json`).
"""


def span(low: float, high: float) -> str:
    """Return seconds in words, no more exact than they are known: `40 to 70 s`, `13 to 24 min`, `about 3 h`."""
    size, unit = next((one for one in UNITS if high >= 1.5 * one[0]), UNITS[-1])
    ends = [_rounded(value / size) for value in (low, high)]
    return f"about {ends[0]} {unit}" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} {unit}"


def _rounded(value: float) -> str:
    """Round to halves below 4.5, integers below 20, else multiples of five."""
    if value < 4.5:
        return f"{round(2 * value) / 2:g}"
    return f"{value:.0f}" if value < 20 else f"{5 * round(value / 5)}"


def in_turn(rests: list[float], workers: int, waiting: int, each: float) -> float:
    """Return the seconds until `workers` have ended their current pieces, of which `rests` are left, and after that
    `waiting` pieces of `each`; no piece is divided, so that in the end some are idle.
    """
    ends = sorted([*rests, *[0.0] * (workers - len(rests))])
    for _ in range(waiting):
        heapq.heapreplace(ends, ends[0] + each)
    return max(ends, default=0.0)


class TimeLeft:
    """An estimate at the pace since the first report, which comes after processes have started and data are read."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def words(self, done: float, enough: bool, kept: float | None = None, at_least: float = 0.0) -> str:
        """Return the time left when `done`, 0 to 1, is done; empty if that is not `enough` to estimate, or nothing is
        left.

        `kept` of it took none of this time (what was done at the first report, if not given); at its pace the rest
        takes `at_least` so many seconds.
        """
        now = time.monotonic()
        if self._first is None:
            self._first = now, done
        seconds, more = now - self._first[0], done - (self._first[1] if kept is None else kept)
        if not enough or seconds <= 0 or more <= 0 or done >= 1:
            return ""
        left = max(seconds * (1 - done) / more, at_least)
        return f"{span(SPREAD[0] * left, SPREAD[1] * left)} left"


@runtime_checkable
class Progress(Protocol):
    """The receiver of all events."""

    def line(self, text: str) -> None: ...

    def rendered(self, event: "RenderProgress", scenes: int) -> None: ...

    def start_training(self, cells: int, missing: int) -> None: ...

    def trained(self, task: "GroupTask", share: float) -> None: ...

    def cell(self, cell: "CellRecord") -> None: ...

    def part(self, what: str, done: int, total: int) -> None:
        """Report on anything else that has parts: how many of them are done, and which is being done."""
        ...

    def close(self) -> None: ...


class Quiet:
    """A display that shows nothing."""

    def line(self, text: str) -> None: ...

    def rendered(self, event: "RenderProgress", scenes: int) -> None: ...

    def start_training(self, cells: int, missing: int) -> None: ...

    def trained(self, task: "GroupTask", share: float) -> None: ...

    def cell(self, cell: "CellRecord") -> None: ...

    def part(self, what: str, done: int, total: int) -> None: ...

    def close(self) -> None: ...


class Lines(Quiet):
    """Plain lines, at most one every few seconds, and one for each scene rendered and each cell ended."""

    def __init__(self, every_seconds: float = 15.0) -> None:
        self._every = every_seconds
        self._last = time.monotonic()
        self._tally = _Tally()
        self._parts = _Parts()

    def line(self, text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def rendered(self, event: "RenderProgress", scenes: int) -> None:
        if event.path is not None:
            self.line(f"view set {event.scene}: {event.path}")
            return
        left = self._parts.left(event.scene, event.share)
        if self._due():
            kept = f" ({event.kept} from before)" if event.kept else ""
            done = f"{event.done} of {event.total} views done{kept}, " if event.total else ""
            self.line(_joined(f"rendering {event.scene}: {done}{event.doing}", left))

    def start_training(self, cells: int, missing: int) -> None:
        self._tally = _Tally(missing)  # there may have been another training before this one
        kept = f", {cells - missing} kept from before" if missing < cells else ""
        self.line(f"training {missing} cells{kept}")

    def trained(self, task: "GroupTask", share: float) -> None:
        left = self._tally.left(task, share)
        if self._due():
            self.line(_joined(f"trained {self._tally.share():.0%}", left))

    def cell(self, cell: "CellRecord") -> None:
        self.line(cell_line(cell))

    def part(self, what: str, done: int, total: int) -> None:
        left = self._parts.left(str(total), done / max(total, 1))
        if self._due():
            self.line(_joined(f"{what}: {done} of {total}", left))

    def _due(self) -> bool:
        now = time.monotonic()
        if now - self._last < self._every:
            return False
        self._last = now
        return True


class Bars(Quiet):
    """Bars that stay on the terminal: rendering and training, or whatever else has parts."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(24),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),  # rich's own goes by the last half minute alone
        )
        self._bars.start()
        self._render: TaskID | None = None
        self._train: TaskID | None = None
        self._part: TaskID | None = None
        self._scenes_done = 0
        self._tally = _Tally()
        self._parts = _Parts()

    def line(self, text: str) -> None:
        self._bars.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def rendered(self, event: "RenderProgress", scenes: int) -> None:
        if self._render is None:
            self._render = self._bars.add_task("rendering", total=scenes, left="")
        self._scenes_done += event.path is not None
        partly = 0.0 if event.path else event.done / max(event.total, 1)
        left = "" if event.path else self._parts.left(event.scene, event.share)
        self._bars.update(
            self._render,
            completed=self._scenes_done + partly,
            description=f"rendering {event.scene}",
            left=_joined(event.doing, left and f"{left} of it"),
        )

    def start_training(self, cells: int, missing: int) -> None:
        self._tally = _Tally(missing)  # there may have been another training before this one
        self._render, self._scenes_done = None, 0
        self._train = self._bars.add_task("training", total=1.0, left="")

    def trained(self, task: "GroupTask", share: float) -> None:
        left = self._tally.left(task, share)
        if self._train is not None:
            self._bars.update(self._train, completed=self._tally.share(), left=left)

    def cell(self, cell: "CellRecord") -> None:
        self.line(cell_line(cell))

    def part(self, what: str, done: int, total: int) -> None:
        if self._part is None:
            self._part = self._bars.add_task(what, total=total, left="")
        left = self._parts.left(str(total), done / max(total, 1))
        self._bars.update(self._part, completed=done, total=total, description=what, left=left)

    def close(self) -> None:
        self._bars.stop()


class _Parts:
    """A piece of work that is done part by part."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[float, TimeLeft]] = {}

    def left(self, name: str, share: float) -> str:
        """Return the time left for this piece, `share` of which is done, in words; empty if it is not known yet. A
        smaller share than before starts another piece.
        """
        before, clock = self._known.get(name, (0.0, TimeLeft()))
        if share < before:
            clock = TimeLeft()
        self._known[name] = share, clock
        return clock.words(share, share >= ENOUGH)


@dataclass
class _Group:
    """A group of cells, from its first report on. An interrupted one has already done a part before that."""

    cells: int
    share_before: float
    done_before: float
    began: float
    share: float = 0.0
    """The trained share."""
    done: float = 0.0
    """The finished work, counted in cells."""
    latest: float = 0.0
    """The clock at the last report."""


class _Tally:
    """The share of all missing cells that is trained, and the time of the rest."""

    def __init__(self, expected: int = 0) -> None:
        self._expected = expected
        self._groups: dict[tuple[str, int], _Group] = {}
        self._at_once = 1
        """The most groups at a time so far: there are as many workers."""
        self._clock = TimeLeft()
        self._enough = False

    def left(self, task: "GroupTask", share: float) -> str:
        """Return the time left in words; empty until a group has advanced far enough since its first report."""
        now, done = time.monotonic(), _work(task, share) * len(task.methods)
        group = self._groups.setdefault((task.scene, task.seed), _Group(len(task.methods), share, done, now))
        group.share, group.done, group.latest = share, done, now
        self._at_once = max(self._at_once, len(self._unfinished()))
        self._enough = self._enough or share - group.share_before >= ENOUGH
        kept = sum(one.done_before for one in self._groups.values()) / max(self._expected, 1)
        return self._clock.words(self.share(), self._enough, kept, self._at_least())

    def share(self) -> float:
        return sum(one.done for one in self._groups.values()) / self._expected if self._expected else 1.0

    def _unfinished(self) -> list[_Group]:
        return [one for one in self._groups.values() if one.share < 1.0]

    def _at_least(self) -> float:
        """Return the least seconds: a group is one worker's, however many are idle."""
        groups = self._groups.values()
        gained = sum(one.done - one.done_before for one in groups)
        if gained <= 0:
            return 0.0
        cell = sum(one.latest - one.began for one in groups) / gained
        size = max(one.cells for one in groups)
        waiting = -(-(self._expected - sum(one.cells for one in groups)) // size)
        return in_turn(
            [(one.cells - one.done) * cell for one in self._unfinished()], self._at_once, waiting, size * cell
        )


def _work(task: "GroupTask", share: float) -> float:
    """Return the share of a group's work, scoring included, once it has trained `share` of its steps."""
    if not task.budget.steps:
        return share
    trained = TRAINED_RAY * task.budget.steps * task.train.rays
    scored = SCORED_RAY * task.score.checkpoints * task.views.test * task.views.resolution**2
    due = checkpoint_fractions(task.score.checkpoints, task.score.earliest)
    ended = sum(share >= one for one in due) / len(due)
    return (share * trained + ended * scored) / (trained + scored)


TRAINED_RAY = 3.0
SCORED_RAY = 2.0
"""The cost of a ray in training, and of one rendered and compared with the truth, in units of rendering one."""


def _joined(text: str, left: str) -> str:
    return f"{text}, {left}" if left else text


def cell_line(cell: "CellRecord") -> str:
    """One line of a finished cell."""
    name = f"{cell.scene} {cell.method} seed {cell.seed}"
    if cell.status != "done":
        return f"{name}: {cell.status.upper()}, {cell.reason}"
    psnr = cell.scores.get("psnr")
    score = "identical images" if psnr is None else f"{psnr:.2f} dB"
    return f"{name}: {score} after {cell.steps} steps, {cell.train_seconds:.1f} s"


def chosen_progress(quiet: bool) -> Progress:
    """Return bars on a terminal, lines elsewhere."""
    if quiet:
        return Quiet()
    return Bars() if sys.stdout.isatty() else Lines()
