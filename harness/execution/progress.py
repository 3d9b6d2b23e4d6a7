"""The display of a running command: bars on a terminal, plain lines elsewhere, or nothing.

The remaining time is that of the run if its cost was estimated, else that of the current phase; the pace of finished
work replaces the estimate.
"""

import sys
import textwrap
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.files.errors import printable

if TYPE_CHECKING:
    from rich.progress import TaskID

    from harness.plan.group_task import GroupTask
    from harness.records.cells import CellRecord

Range = tuple[float, float]
"""The minimum and the maximum seconds."""
UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
COLUMNS = 80
ENOUGH = 0.25
"""The share of a piece of work after which its pace predicts the rest."""
SPREAD = (0.7, 1.4)
"""The range of actual seconds relative to a measured pace, as steps and scenes differ (`docs/reduced/summary.json`)."""


def span(low: float, high: float) -> str:
    """Format a range of seconds, rounded to its precision: `40 to 70 s`, `13 to 24 min`, `about 3 h`."""
    size, unit = next((unit for unit in UNITS if high >= 1.5 * unit[0]), UNITS[-1])
    ends = [_rounded(value / size) for value in (low, high)]
    return f"about {ends[0]} {unit}" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} {unit}"


def _rounded(value: float) -> str:
    if value < 4.5:
        return f"{round(2 * value) / 2:g}"
    return f"{value:.0f}" if value < 20 else f"{5 * round(value / 5)}"


class TimeLeft:
    """An estimate for `total` units in pieces, from the pace since the first report of any. What a piece had done at
    its own first report does not count.
    """

    def __init__(self, total: float = 1.0) -> None:
        self._total, self._kept, self._began = total, 0.0, 0.0
        self._done: dict[Hashable, float] = {}

    @property
    def share(self) -> float:
        return sum(self._done.values()) / self._total if self._total else 1.0

    def after(self, done: float, piece: Hashable = None, size: float = 1.0) -> Range | None:
        """Record that `done` units of a `piece` are done, and return the seconds left, if they can be estimated."""
        now = time.monotonic()
        if not self._done:
            self._began = now
        if piece not in self._done:
            self._kept += done
        self._done[piece] = done
        gained, rest = sum(self._done.values()) - self._kept, self._total - sum(self._done.values())
        if gained < ENOUGH * size or min(now - self._began, rest) <= 0:
            return None
        left = (now - self._began) * rest / gained
        return SPREAD[0] * left, SPREAD[1] * left


@dataclass(frozen=True)
class RenderProgress:
    """Progress of one scene, and its folder once it is complete."""

    scene: str
    done: int
    total: int
    path: Path | None = None
    note: str = ""
    doing: str = ""
    kept: int = 0
    """The number of views that were finished before."""
    share: float = 0.0
    """The finished share of the samples."""


class Progress:
    """The receiver of all events, which shows nothing."""

    def line(self, text: str) -> None: ...

    def expect(self, phases: dict[str, Range]) -> None:
        """Set the expected seconds of the phases of a run, `rendering`, `training` and `part`, in this order."""

    def rendered(self, event: RenderProgress, scenes: int) -> None: ...

    def start_training(self, cells: int, missing: int) -> None: ...

    def trained(self, task: "GroupTask", share: float) -> None: ...

    def cell(self, cell: "CellRecord") -> None: ...

    def group(self, task: "GroupTask") -> None:
        """End a group: all its cells were passed to `cell`."""

    def part(self, what: str, done: int, total: int) -> None:
        """Report on other work with parts: its current part and the number of finished parts."""

    def close(self) -> None: ...


class Lines(Progress):
    """Plain lines of at most 80 columns: one every few seconds, and one or two for each group that has ended."""

    def __init__(self, every_seconds: float = 5.0) -> None:
        self._every = every_seconds
        self._last = time.monotonic()
        self._expected: dict[str, Range] = {}
        self._rendering = self._training = TimeLeft()
        self._scenes_done = 0
        self._part = 0, 0.0, TimeLeft()
        self._trains = False
        self._ended: dict[tuple[str, int], list[CellRecord]] = {}

    def line(self, text: str) -> None:
        sys.stdout.write(printable(text) + "\n")
        sys.stdout.flush()

    def expect(self, phases: dict[str, Range]) -> None:
        self._expected = phases

    def rendered(self, event: RenderProgress, scenes: int) -> None:
        if event.note:
            self.line(event.note)
            return
        if not self._scenes_done and self._rendering.share == 0:
            self._rendering = TimeLeft(scenes)
        left = self._rendering.after(1.0 if event.path is not None else event.share, event.scene)
        if event.path is not None:
            self._scenes_done += 1
            self._show("rendering", f"{event.scene}: views ready", self._scenes_done / scenes)
            return
        kept = f" ({event.kept} from before)" if event.kept else ""
        done = f"{event.done} of {event.total} views done{kept}, " if event.total else ""
        share = (self._scenes_done + event.done / max(event.total, 1)) / scenes
        # once others train meanwhile, the time left is that of training
        ends = "" if self._trains else self._left("rendering", share, left)
        text = f"rendering {event.scene}: {done}{event.doing}{ends}"
        self._show("rendering", text, share)

    def start_training(self, cells: int, missing: int) -> None:
        self._rendering, self._training = TimeLeft(), TimeLeft(missing)
        self._scenes_done, self._trains = 0, True
        kept = f", {cells - missing} kept from before" if missing < cells else ""
        self.line(f"training {missing} cells{kept}")

    def trained(self, task: "GroupTask", share: float) -> None:
        cells = len(task.methods)
        left = self._training.after(share * cells, (task.scene, task.seed), cells)
        done = self._training.share
        self._show("training", f"trained {done:.0%}{self._left('training', done, left)}", done)

    def cell(self, cell: "CellRecord") -> None:
        if cell.status == "done":
            self._ended.setdefault((cell.scene, cell.seed), []).append(cell)
        else:
            self.line(f"{cell.scene} {cell.method} seed {cell.seed}: {cell.status.upper()}, {cell.reason}")

    def group(self, task: "GroupTask") -> None:
        if not (cells := self._ended.pop((task.scene, task.seed), None)):
            return
        scores = [f"{cell.method} {_score(cell)}" for cell in sorted(cells, key=lambda cell: cell.method)]
        line = f"{task.scene} seed {task.seed}: {', '.join(scores)}"
        if any(cell.spun for cell in cells):
            line += "; core seconds are too long"
        self.line(textwrap.fill(line, COLUMNS, subsequent_indent="  ", break_on_hyphens=False))

    def part(self, what: str, done: int, total: int) -> None:
        share = done / max(total, 1)
        known, before, clock = self._part
        if total != known or share < before:  # another piece of work
            clock = TimeLeft()
        self._part = total, share, clock
        self._show("part", f"{what}: {done} of {total}{self._left('part', share, clock.after(share))}", share)

    def _left(self, phase: str, share: float, own: Range | None) -> str:
        """Format the time left of the run if it was estimated, else of the phase by its pace so far (`own`)."""
        later = [(0.0, 0.0)]
        if phase in self._expected:
            names = list(self._expected)
            low, high = self._expected[phase]
            own = own or ((1.0 - share) * low, (1.0 - share) * high)
            later += [self._expected[name] for name in names[names.index(phase) + 1 :]]
        if own is None:
            return ""
        low, high = (end + sum(phase[place] for phase in later) for place, end in enumerate(own))
        return f", {span(low, high)} left" if high > 0 else ""

    def _show(self, bar: str, text: str, share: float) -> None:
        now = time.monotonic()
        if now - self._last >= self._every:
            self._last = now
            self.line(text)


class Bars(Lines):
    """Bars that stay on the terminal, for rendering, training and other work with parts."""

    def __init__(self) -> None:
        from rich import progress

        super().__init__()
        percent, what = map(progress.TextColumn, ("{task.percentage:>3.0f} %", "{task.description}"))
        self._bars = progress.Progress(progress.BarColumn(24), percent, progress.TimeElapsedColumn(), what)
        self._bars.start()
        self._tasks: dict[str, TaskID] = {}

    def line(self, text: str) -> None:
        self._bars.console.print(printable(text), highlight=False, markup=False, soft_wrap=True)

    def start_training(self, cells: int, missing: int) -> None:
        super().start_training(cells, missing)
        self._tasks.clear()  # an earlier training has its own bar

    def close(self) -> None:
        self._bars.stop()

    def _show(self, bar: str, text: str, share: float) -> None:
        if bar not in self._tasks:
            self._tasks[bar] = self._bars.add_task(text, total=1.0)
        self._bars.update(self._tasks[bar], completed=share, description=text)


@contextmanager
def signs_of_life(what: str, say: Callable[[str], None]) -> Iterator[None]:
    """Say what is done, and again every four seconds until it is."""
    say(what)
    ended, began = threading.Event(), time.monotonic()

    def beat() -> None:
        while not ended.wait(4.0):
            say(f"{what}: {time.monotonic() - began:.0f} s")

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _score(cell: "CellRecord") -> str:
    psnr = cell.scores.get("psnr")
    return "identical images" if psnr is None else f"{psnr:.2f} dB"


def chosen_progress(quiet: bool) -> Progress:
    if quiet:
        return Progress()
    return Bars() if sys.stdout.isatty() else Lines()
