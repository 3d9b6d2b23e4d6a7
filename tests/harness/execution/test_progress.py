"""The lines that a running command prints."""

from pathlib import Path

import pytest

from harness.execution.progress import SPREAD, Lines, RenderProgress, TimeLeft, span
from harness.plan.group_task import GroupTask
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine
from tests.harness import cells

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Return a list whose only entry is the time."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def task(tmp_path: Path) -> GroupTask:
    return PROFILES["reduced"].tasks({"lego": tmp_path}, Machine("cpu", 1, 1), tmp_path)[0]


def test_rendering_says_what_is_left_of_all_scenes(clock: list[float], tmp_path: Path, capsys: Capture) -> None:
    show = Lines(every_seconds=0.0)
    show.rendered(RenderProgress("chair", 0, 0, tmp_path), 3)
    for scene in ("lego", "mic"):
        for done in (0, 30, 120):
            clock[0] += 20.0
            show.rendered(RenderProgress(scene, done, 120, doing="view", kept=7, share=done / 120), 3)
        show.rendered(RenderProgress(scene, 120, 120, tmp_path), 3)
    said = [line for line in capsys.readouterr().out.splitlines() if line.startswith("rendering")]
    assert said[0] == "rendering lego: 0 of 120 views done (7 from before), view"
    # 40 s for a quarter of a scene, as one that was cached took none; seven quarters are left
    assert said[1].endswith(f", {span(0.7 * 7 * 40, 1.4 * 7 * 40)} left")
    assert ["left" in line for line in said] == [False, True, True, True, True, False]


def test_a_run_says_what_is_left_of_it_from_the_first_line(clock: list[float], tmp_path: Path, capsys: Capture) -> None:
    show = Lines(every_seconds=0.0)
    show.expect({"rendering": (100.0, 200.0), "training": (600.0, 1200.0), "part": (60.0, 60.0)})
    show.rendered(RenderProgress("lego", 12, 120, doing="view", share=0.1), 1)
    show.start_training(6, 6)
    show.trained(task(tmp_path), 0.0)
    show.part("view cache", 1, 10)
    rendering, _, training, serving = capsys.readouterr().out.splitlines()
    assert rendering.endswith(f", {span(90 + 660, 180 + 1260)} left")
    assert training.endswith(f", {span(660, 1260)} left")
    assert serving.endswith(f", {span(54, 54)} left")


def test_the_pace_so_far_takes_the_place_of_what_was_expected_of_a_phase(
    clock: list[float], tmp_path: Path, capsys: Capture
) -> None:
    show, group = Lines(every_seconds=0.0), task(tmp_path)
    show.expect({"training": (600.0, 1200.0), "part": (60.0, 60.0)})
    show.start_training(len(group.methods), len(group.methods))
    clock[0] = 100.0  # the start of processes does not foretell the rest
    show.trained(group, 0.0)
    clock[0] = 130.0
    show.trained(group, 0.5)
    assert capsys.readouterr().out.splitlines()[-1].endswith(f", {span(0.7 * 30 + 60, 1.4 * 30 + 60)} left")


def test_a_group_has_one_line_of_at_most_eighty_columns_and_a_failure_its_own_at_once(
    tmp_path: Path, capsys: Capture
) -> None:
    show, group = Lines(every_seconds=60.0), task(tmp_path)
    for number, method in enumerate(("qnerf_repaired", "nerf_matched", "nerf", "voxels_drjit")):
        show.cell(cells.cell("lego", method, 0, [], scores={"psnr": 20.0 + number}))
    show.cell(cells.diverged("lego", "qnerf", 0))
    assert capsys.readouterr().out.startswith("lego qnerf seed 0: DIVERGED, not finite at step 7")
    show.group(group)
    show.group(group)
    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("lego seed 0: nerf 22.00 dB, nerf_matched 21.00 dB, qnerf_repaired 20.00 dB,")
    assert said[1:] == ["  voxels_drjit 23.00 dB"]
    assert all(len(line) <= 80 for line in said)


def test_what_a_terminal_would_obey_is_written_out(capsys: Capture) -> None:
    Lines().line("view set \x1b[31mred\u202e: whole")
    assert capsys.readouterr().out == "view set \\x1b[31mred\\u202e: whole\n"
    Lines().line("long " * 1000)
    assert capsys.readouterr().out == "long " * 1000 + "\n"


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.2, 0.3, "0 to 0.5 s"),
        (12.0, 24.0, "12 to 25 s"),
        (70.0, 140.0, "1 to 2.5 min"),
        (13 * 60.0, 24 * 60.0, "13 to 25 min"),
        (3 * 3600.0, 3.1 * 3600.0, "about 3 h"),
        (2 * 86400.0, 5 * 86400.0, "2 to 5 d"),
    ],
)
def test_a_span_is_no_more_exact_than_it_is_known(low: float, high: float, words: str) -> None:
    assert span(low, high) == words


def left(seconds: float) -> tuple[float, float]:
    return pytest.approx((SPREAD[0] * seconds, SPREAD[1] * seconds))


def test_the_pace_counts_from_the_first_report_of_each_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((900.0, 930.0, 960.0, 960.0, 990.0, 990.0))
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    clock = TimeLeft(2.0)
    assert clock.after(0.1, "a") is None
    assert clock.after(0.2, "a") is None, "too little to tell"
    assert clock.after(0.4, "a") == left(60.0 / 0.3 * 1.6)
    assert clock.after(0.5, "b") == left(60.0 / 0.3 * 1.1), "what an interrupted piece brings took no time"
    assert clock.after(1.0, "a") == left(90.0 / 0.9 * 0.5)
    assert clock.after(1.0, "b") is None, "all is done"
    assert clock.share == 1.0
