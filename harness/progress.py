"""What a user sees while a run goes on: bars on a terminal, plain lines elsewhere, nothing with --quiet."""

import sys
import time
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from harness.records import CellRecord

if TYPE_CHECKING:
    from rich.progress import TaskID

    from harness.ground_truth import Rendered
    from harness.group import GroupTask


@runtime_checkable
class Progress(Protocol):
    """Told of everything that happens."""

    def line(self, text: str) -> None: ...

    def rendered(self, event: "Rendered", scenes: int) -> None: ...

    def start_training(self, cells: int, missing: int) -> None: ...

    def trained(self, task: "GroupTask", share: float) -> None: ...

    def cell(self, cell: CellRecord) -> None: ...

    def part(self, what: str, done: int, total: int) -> None:
        """Of anything else that has parts: how many of them are done, and what is being done."""
        ...

    def close(self) -> None: ...


class Quiet:
    """Says nothing."""

    def line(self, text: str) -> None: ...

    def rendered(self, event: "Rendered", scenes: int) -> None: ...

    def start_training(self, cells: int, missing: int) -> None: ...

    def trained(self, task: "GroupTask", share: float) -> None: ...

    def cell(self, cell: CellRecord) -> None: ...

    def part(self, what: str, done: int, total: int) -> None: ...

    def close(self) -> None: ...


class Lines(Quiet):
    """Plain lines, one every few seconds at most, and one for each scene rendered and each cell ended."""

    def __init__(self, every_seconds: float = 15.0) -> None:
        self._every = every_seconds
        self._last = self._began = time.monotonic()
        self._tally = _Tally()

    def line(self, text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def rendered(self, event: "Rendered", scenes: int) -> None:
        if event.path is not None:
            self.line(f"view set {event.scene}: {event.path}")
        elif self._due():
            self.line(f"rendering {event.scene}: view {event.done} of {event.total}")

    def start_training(self, cells: int, missing: int) -> None:
        self._began = time.monotonic()
        self._tally = _Tally()  # there may have been another training before
        self._tally.expected = missing
        kept = f", {cells - missing} kept from before" if missing < cells else ""
        self.line(f"training {missing} cells{kept}")

    def trained(self, task: "GroupTask", share: float) -> None:
        self._tally.update(task, share)
        if self._due():
            self.line(f"trained {self._tally.share():.0%}, {_remaining(self._began, self._tally.share())}")

    def cell(self, cell: CellRecord) -> None:
        self.line(cell_line(cell))

    def part(self, what: str, done: int, total: int) -> None:
        if self._due():
            self.line(f"{what}: {done} of {total}")

    def _due(self) -> bool:
        now = time.monotonic()
        if now - self._last < self._every:
            return False
        self._last = now
        return True


class Bars(Quiet):
    """Bars that stay on the terminal: rendering and training, or whatever else has parts."""

    def __init__(self) -> None:
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._bars.start()
        self._render: TaskID | None = None
        self._train: TaskID | None = None
        self._part: TaskID | None = None
        self._scenes_done = 0
        self._tally = _Tally()

    def line(self, text: str) -> None:
        self._bars.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def rendered(self, event: "Rendered", scenes: int) -> None:
        if self._render is None:
            self._render = self._bars.add_task("rendering", total=scenes)
        self._scenes_done += event.path is not None
        partly = 0.0 if event.path else event.done / max(event.total, 1)
        self._bars.update(self._render, completed=self._scenes_done + partly, description=f"rendering {event.scene}")

    def start_training(self, cells: int, missing: int) -> None:
        self._tally = _Tally()  # there may have been another training before
        self._tally.expected = missing
        self._render, self._scenes_done = None, 0
        self._train = self._bars.add_task("training", total=1.0)

    def trained(self, task: "GroupTask", share: float) -> None:
        self._tally.update(task, share)
        if self._train is not None:
            self._bars.update(self._train, completed=self._tally.share())

    def cell(self, cell: CellRecord) -> None:
        self.line(cell_line(cell))

    def part(self, what: str, done: int, total: int) -> None:
        if self._part is None:
            self._part = self._bars.add_task(what, total=total)
        self._bars.update(self._part, completed=done, total=total, description=what)

    def close(self) -> None:
        self._bars.stop()


class _Tally:
    """How much of all missing cells is trained."""

    def __init__(self) -> None:
        self.expected = 0
        self._shares: dict[tuple[str, int], tuple[float, int]] = {}

    def update(self, task: "GroupTask", share: float) -> None:
        self._shares[task.scene, task.seed] = (share, len(task.methods))

    def share(self) -> float:
        done = sum(share * cells for share, cells in self._shares.values())
        return done / self.expected if self.expected else 1.0


def cell_line(cell: CellRecord) -> str:
    """One line of a finished cell."""
    name = f"{cell.scene} {cell.method} seed {cell.seed}"
    if cell.status != "done":
        return f"{name}: {cell.status.upper()}, {cell.reason}"
    psnr = cell.scores.get("psnr")
    score = "identical images" if psnr is None else f"{psnr:.2f} dB"
    return f"{name}: {score} after {cell.steps} steps, {cell.train_seconds:.1f} s"


def _remaining(began: float, share: float) -> str:
    if share <= 0:
        return "just begun"
    seconds = (time.monotonic() - began) * (1 - share) / share
    return f"about {seconds / 60:.0f} min left" if seconds > 90 else f"about {seconds:.0f} s left"


def chosen_progress(quiet: bool) -> Progress:
    """Bars on a terminal, lines elsewhere."""
    if quiet:
        return Quiet()
    return Bars() if sys.stdout.isatty() else Lines()
