"""The page of a run that still trains: when it is renewed, what that may cost, and its end."""

import sys
from pathlib import Path

import pytest

from harness.run_folder import live_page
from harness.run_folder.live_page import LivePage


class Machine:
    """A clock, the cost of pages, and the processes that write them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.spent, self.commands = 100.0, 0.0, list[list[str]]()
        self.running = self.killed = False
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        monkeypatch.setattr(live_page, "_spent_by_children", lambda: self.spent)
        monkeypatch.setattr("subprocess.Popen", self.start)

    def start(self, command: list[str], **_: object) -> "Machine":
        self.commands.append(command)
        self.running = True
        return self

    def poll(self) -> int | None:
        return None if self.running else 0

    def end(self, cost: float) -> None:
        self.running, self.spent = False, self.spent + cost

    def kill(self) -> None:
        self.killed = True

    def wait(self) -> int:
        return 0


def test_a_page_is_written_at_the_first_group_and_again_when_it_has_cost_a_tenth_of_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, said = Machine(monkeypatch), list[str]()
    page = LivePage(tmp_path, said.append)
    page.renew()
    words = [sys.executable, "-m", "reports", str(tmp_path), "--partial", "--quiet"]
    assert machine.commands == [["nice", "-n", "10", *words]]
    page.renew()
    assert len(machine.commands) == 1, "it is still being written"
    (tmp_path / "report.html").write_text("", encoding="utf-8")
    machine.end(cost=6.0)
    machine.now += 59.0
    page.renew()
    assert len(machine.commands) == 1
    assert said == [f"page of the run so far: {tmp_path / 'report.html'}"]
    machine.now += 2.0
    page.renew()
    assert len(machine.commands) == 2
    assert len(said) == 1
    page.close()
    assert machine.killed


def test_nothing_is_to_be_ended_before_the_first(tmp_path: Path) -> None:
    LivePage(tmp_path, print).close()
