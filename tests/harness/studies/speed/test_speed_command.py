"""`python -m harness study speed`: every question, at sizes at which no figure means anything; memory does not grow."""

import json
import weakref
from dataclasses import replace
from pathlib import Path

import pytest

from harness.command.main import main
from harness.execution.progress import Progress
from harness.machine.peak_memory import STATUS
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.records.cells import records_folder
from harness.records.pictures import read_renders
from harness.records.study import Check, read_studies
from harness.studies.drawn_views import write_noise
from harness.studies.speed.memory import peaks_of
from harness.studies.speed.speed_context import SpeedContext
from harness.training.lockstep import train_group
from harness.training.scoring import evaluate
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import write_ball
from tests.harness.patching import changed
from tests.harness.tiny import SCORE, TRAIN, VIEWS


def answers(out: Path, *items: int) -> dict[str, Check]:
    options = ["speed", "--quick", "--quiet", "--studies", *map(str, items), "--out", str(out)]
    assert main(options) == 0
    record = read_studies(out / "speed.json")
    assert [study.info.id for study in record.studies] == [str(item) for item in items]
    checks = {check.id: check for _, check in record.checks()}
    assert len(checks) == len(list(record.checks())), "every id is unique"
    assert all(check.value is not None or check.why for check in checks.values())
    json.dumps(json.loads((out / "speed.json").read_text()), allow_nan=False)
    assert [file.name for file in out.iterdir()] == ["speed.json"], "nothing is left behind"
    return checks


@pytest.mark.slow
@pytest.mark.thorough
def test_every_question_inside_the_process_is_answered(tmp_path: Path) -> None:
    checks = answers(tmp_path / "speed", 1, 2, 3, 4, 11)
    ids = "training.dense.ratio matrix.paper.share matrix.reduced.share target.same.ratio target.reduced.ratio "
    ids += "rendering.paper.ratio accelerations.grid.step.ratio "
    assert {*ids.split(), "accelerations.none.view.ratio"} <= set(checks)
    record = read_studies(tmp_path / "speed" / "speed.json")
    assert {line.panel for study in record.studies for line in study.series} == {"PSNR against training seconds, lego"}


@pytest.mark.thorough
@pytest.mark.slow
def test_ground_truth_and_memory_are_measured_in_processes_of_their_own(tmp_path: Path) -> None:
    checks = answers(tmp_path / "speed", 7, 8)
    assert checks["render.lego.scalar_rgb.seconds"].value
    for id in ("memory.worker.nerf.peak", "memory.run.peak"):
        value = checks[id].value
        assert value is None or 0.1 < value < 8.0


# memory


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.skipif(not STATUS.exists(), reason="no /proc to read the most memory held from")
def test_reading_and_training_take_the_same_memory_for_a_hundred_megabytes_of_images(tmp_path: Path) -> None:
    context = SpeedContext(tmp_path, tmp_path, tmp_path, True, Progress(), Machine("cpu", 1, 1), 1.0)
    task = GroupTask("noise", 0, ("nerf",), TRAIN, replace(SCORE, checkpoints=1), Budget(20, None), tmp_path)
    peaks = []
    for count, size in ((4, 32), (40, 400)):
        write_noise(tmp_path / f"noise-{size}", size, count, 1)
        views = replace(VIEWS, resolution=size, train=count, test=1)
        peaks.append(peaks_of(context, replace(task, view_set=tmp_path / f"noise-{size}", views=views))[0])
    # one image of 2.5 MB, as it is decoded and as it is compared, is what the larger size may cost
    assert peaks[1] - peaks[0] < 0.4 * 40 * 400 * 400 * 16


def test_views_are_rendered_scored_and_let_go_one_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alive: list[weakref.ref[evaluate.View]] = []
    most = [0]

    def watched(view: evaluate.View, *_: object) -> evaluate.View:
        alive.append(weakref.ref(view))
        most[0] = max(most[0], sum(reference() is not None for reference in alive))
        return view

    changed(monkeypatch, evaluate, "render_view", watched)
    ball = read_view_set(write_ball(tmp_path / "ball", size=12, train=4, test=12))
    task = GroupTask("ball", 0, ("nerf",), TRAIN, SCORE, Budget(3, None), tmp_path)
    (cell,) = train_group(task, ball, {}, lambda share: None)
    assert (cell.status, len(cell.views)) == ("done", 12)
    renders = read_renders(records_folder(tmp_path) / str(cell.pictures))
    assert len(renders) == SCORE.stored_views * len(cell.curve)
    assert len(alive) >= 12 * 2
    # the one that is rendered and the one before it
    assert most[0] <= 2
