"""What is trained again and what is not, and what is said of cells of another commit; nothing is trained here."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from harness import provenance, runner
from harness.evidence import runner as study_runner
from harness.evidence.situation import Situation, folder_of
from harness.evidence.studies import STUDIES, Study
from harness.evidence_record import EVIDENCE_FILE, EvidenceRecord, StudyRecord, write_evidence
from harness.plan import Machine, Plan
from harness.progress import Quiet
from harness.records import DamagedRecord, RunRecord, Status, cell_path, read_cells, write_cell, write_run
from tests.harness.cells import cell, checkpoint

TRAINING = "no_encoding"
HERE = "0123456789ab"


def a_run(plan: Plan, finished: bool = True) -> RunRecord:
    settings = json.loads(json.dumps(plan.settings()))
    return RunRecord("reduced", "", [], {}, [], {}, list(plan.seeds), settings, {}, {}, finished, [])


@pytest.fixture
def situation(tmp_path: Path) -> Situation:
    """With every cell of the training there, trained at `HERE`."""
    here = Situation(tmp_path, tmp_path, tmp_path, Machine("cpu", 1, 1), True, True, Quiet())
    plan = here.plan(TRAINING)
    write_run(folder_of(tmp_path, TRAINING), a_run(plan))
    for scene, method, seed in plan.cells():
        trained_at(here, scene, method, seed, HERE)
    return here


def trained_at(situation: Situation, scene: str, method: str, seed: int, commit: str, status: Status = "done") -> None:
    one = cell(scene, method, seed, [checkpoint(4, 1.0, 20.0)], status=status, provenance={"commit": commit})
    write_cell(folder_of(situation.out, TRAINING), one)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The folders that were run, in which every failed cell then ended well."""
    asked: list[Path] = []

    def run(plan: Plan, folder: Path, *others: object) -> int:
        asked.append(folder)
        for one in list(read_cells(folder)):
            write_cell(folder, replace(one, status="done"))
        write_run(folder, a_run(plan))
        return 0

    monkeypatch.setattr(runner, "run", run)
    return asked


def test_what_is_whole_is_not_run_again(situation: Situation, runs: list[Path]) -> None:
    trained_at(situation, "lego", "nerf", 0, HERE, "diverged")
    assert len(situation.trained(TRAINING).cells) == len(situation.plan(TRAINING).cells())
    assert runs == [], "divergence is a result"


@pytest.mark.parametrize("status", ["error", "not_available"])
def test_a_finished_run_with_a_failed_cell_is_run_again(situation: Situation, runs: list[Path], status: Status) -> None:
    trained_at(situation, "lego", "nerf", 0, HERE, status)
    assert {one.status for one in situation.trained(TRAINING).cells} == {"done"}
    assert runs == [folder_of(situation.out, TRAINING)]


def test_an_unfinished_run_is_gone_on_with(situation: Situation, runs: list[Path]) -> None:
    write_run(folder_of(situation.out, TRAINING), a_run(situation.plan(TRAINING), finished=False))
    situation.trained(TRAINING)
    assert len(runs) == 1


def test_a_damaged_cell_is_an_error_and_is_trained_again_once_it_is_deleted(
    situation: Situation, runs: list[Path]
) -> None:
    path = cell_path(folder_of(situation.out, TRAINING), "lego", "nerf", 0)
    path.write_text("{")
    with pytest.raises(DamagedRecord, match="delete it and run again"):
        situation.trained(TRAINING)
    path.unlink()
    situation.trained(TRAINING)
    assert len(runs) == 1


@pytest.mark.parametrize("failed", [False, True])
def test_resuming_does_the_studies_again_whose_trainings_hold_failed_cells(
    situation: Situation, monkeypatch: pytest.MonkeyPatch, failed: bool
) -> None:
    assert TRAINING in STUDIES["positive_controls"].trainings
    names = ["positive_controls", "factorial"]
    interest = {name: one.smallest_of_interest for name, one in study_runner.METRICS.items()}
    settings = {"quick": True, "device": "cpu", "smallest_of_interest": interest}
    studies = [StudyRecord(STUDIES[name].info) for name in names]
    write_evidence(situation.out / EVIDENCE_FILE, EvidenceRecord({}, settings, studies))
    if failed:
        trained_at(situation, "lego", "nerf", 0, HERE, "error")
    done: list[str] = []

    def measured(study: Study, _: Situation) -> StudyRecord:
        done.append(study.info.id)
        return StudyRecord(study.info)

    monkeypatch.setattr(study_runner, "measured", measured)
    machine = Machine("cpu", 1, 1)
    study_runner.run(names, situation.out, situation.view_sets, machine, quick=True, resume=True, show=Quiet())
    assert done == (["positive_controls"] if failed else [])


# where the code may have changed


@pytest.fixture
def at_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(provenance, "_commit", lambda: HERE)


@pytest.mark.usefixtures("at_commit")
def test_nothing_is_said_of_cells_of_the_same_commit(situation: Situation) -> None:
    assert "commit" not in situation.scale(TRAINING)
    assert "commit" not in situation.scale("a_a"), "not trained yet"


@pytest.mark.usefixtures("at_commit")
@pytest.mark.parametrize("other", ["ba9876543210", f"{HERE}-dirty"])
def test_cells_of_another_commit_are_counted(situation: Situation, runs: list[Path], other: str) -> None:
    trained_at(situation, "lego", "nerf", 0, other)
    cells = len(situation.plan(TRAINING).cells())
    said = situation.scale(TRAINING)
    assert f"{TRAINING}: " in said
    assert f"{cells - 1} cells at commit {HERE}" in said
    assert f"1 cells at commit {other}" in said
    assert f"Not all was trained at commit {HERE}" in said
    situation.trained(TRAINING)
    assert runs == [], "they are used all the same"


@pytest.mark.usefixtures("at_commit")
def test_cells_that_are_not_of_the_plan_are_not_counted(situation: Situation) -> None:
    trained_at(situation, "lego", "voxels", 0, "ba9876543210")
    assert "commit" not in situation.scale(TRAINING)
