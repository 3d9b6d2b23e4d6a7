"""The page of a run that still trains: when it is renewed, what that may cost, and its end."""

import sys
import threading
from pathlib import Path

import pytest

from harness.run_folder import live_page
from harness.run_folder.live_page import LivePage


class Machine:
    """A clock, the cost of pages, and the processes that write them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.spent, self.commands = 100.0, 0.0, list[list[str]]()
        self.ended, self.code = threading.Event(), 0
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        monkeypatch.setattr(live_page, "_spent_by_children", lambda: self.spent)
        monkeypatch.setattr("subprocess.Popen", self.start)

    def start(self, command: list[str], **_: object) -> "Machine":
        self.commands.append(command)
        self.ended.clear()
        return self

    def wait(self) -> int:
        assert self.ended.wait(10.0)
        return self.code

    def end(self, page: LivePage, cost: float) -> None:
        self.spent += cost
        self.ended.set()
        assert page._thread is not None
        page._thread.join()

    def kill(self) -> None:
        self.code = -9
        self.ended.set()


def test_a_page_is_written_at_the_first_group_and_again_when_it_has_cost_a_twentieth_of_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, said = Machine(monkeypatch), list[str]()
    page = LivePage(tmp_path, said.append)
    page.renew()
    page.renew()  # it is still being written
    machine.end(page, cost=6.0)
    words = [sys.executable, "-m", "reports", str(tmp_path), "--partial", "--quiet"]
    assert machine.commands == [["nice", "-n", "10", *words]]
    assert said == [f"page of the run so far: {tmp_path / 'report.html'}"]
    machine.now += 119.0
    page.renew()
    assert len(machine.commands) == 1
    machine.now += 2.0
    page.renew()
    machine.end(page, cost=6.0)
    assert len(machine.commands) == 2
    assert len(said) == 1


def test_the_end_of_the_run_ends_a_page_that_is_being_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, said = Machine(monkeypatch), list[str]()
    page = LivePage(tmp_path, said.append)
    page.close()  # nothing is to be ended before the first
    page.renew()
    while not machine.commands:
        pass
    page.close()
    assert machine.code == -9
    assert not said, "a page that was not written has no place"
