"""What is said while a run goes on."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.ground_truth import Rendered
from harness.group import GroupTask
from harness.plan import PROFILES
from harness.progress import Lines
from harness.schedule import Budget


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Its one entry is the time."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


def task(tmp_path: Path, seed: int = 0) -> GroupTask:
    plan = PROFILES["reduced"]
    return GroupTask(
        scene="lego", seed=seed, methods=plan.methods, view_set=tmp_path, views=plan.views, train=plan.train,
        score=plan.score, budget=plan.budget, device="cpu", threads=1, out=tmp_path,
    )  # fmt: skip


def test_the_start_of_processes_does_not_foretell_the_rest(
    clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    show, group = Lines(every_seconds=0.0), task(tmp_path)
    show.start_training(6, 6)
    clock[0] = 30.0
    show.trained(group, 0.005)
    clock[0] = 30.5
    show.trained(group, 0.01)
    assert "left" not in capsys.readouterr().out, "30 s for 0.5 % are no hundred minutes"
    for step in range(1, 11):
        clock[0] = 30.5 + 10.0 * step
        show.trained(group, step / 20)
    said = capsys.readouterr().out.splitlines()
    assert ["left" in line for line in said[4:6]] == [False, True], "once a quarter was trained since the first report"
    assert [line.partition(",")[2] for line in said][-1] == " 2.5 to 5 min left"


def test_work_that_was_scored_counts_as_done_and_a_budget_of_seconds_has_no_such_parts(
    clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    show, group = Lines(every_seconds=0.0), task(tmp_path)
    show.start_training(3, 3)
    for share in (0.09, 0.11, 0.99, 1.0):
        show.trained(group, share)
    said = capsys.readouterr().out.splitlines()[1:]
    by_steps = [int(line.split()[1].rstrip("%,")) for line in said]
    assert by_steps[1] - by_steps[0] >= 5
    assert by_steps[2] < 90
    assert by_steps[3] == 100
    show.start_training(3, 3)
    show.trained(replace(group, budget=Budget(None, 10.0)), 0.5)
    assert capsys.readouterr().out.splitlines()[-1].startswith("trained 50%")


def test_a_scene_that_is_rendered_says_what_is_left_of_it(
    clock: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    show = Lines(every_seconds=0.0)
    for scene in ("lego", "mic"):
        for done in (1, 20, 60):
            clock[0] += 20.0
            show.rendered(Rendered(scene, done, 120, doing="view", kept=7, share=done / 120), 2)
    said = capsys.readouterr().out.splitlines()
    assert ["left" in line for line in said] == [False, False, True] * 2
    assert said[0] == "rendering lego: 1 of 120 views done (7 from before), view"


def test_views_that_were_there_are_no_progress(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    show = Lines(every_seconds=0.0)
    for done, share in ((90, 0.0), (92, 0.2), (93, 0.3)):
        show.rendered(Rendered("lego", done, 100, kept=90, share=share), 1)
        clock[0] += 60.0
    assert [line.partition("left")[1] for line in capsys.readouterr().out.splitlines()] == ["", "", "left"]


def test_of_an_interrupted_run_only_what_is_done_now_is_a_pace(
    clock: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    show, budget = Lines(every_seconds=0.0), Budget(None, 10.0)  # whose share is that of the work
    first, second, third = (replace(task(tmp_path, seed), budget=budget) for seed in range(3))
    show.start_training(9, 9)
    show.trained(first, 0.8)
    clock[0] = 60.0
    show.trained(first, 0.9)
    assert "left" not in capsys.readouterr().out, "a tenth of a group was trained, the rest before"
    show.trained(second, 0.75)
    clock[0] = 120.0
    show.trained(first, 1.0)
    show.trained(second, 0.95)
    clock[0] = 150.0
    show.trained(third, 0.0)
    assert "left" not in capsys.readouterr().out
    clock[0] = 270.0
    show.trained(third, 0.3)
    # by then 0.7 of a group took a worker 300 s, and 0.7 of this one is left
    assert capsys.readouterr().out.splitlines()[-1].endswith(", 3.5 to 7 min left")
