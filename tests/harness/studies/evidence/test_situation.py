"""Which trainings are repeated, and what is reported of cells of another commit; nothing is trained here."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.execution import run as execution_run
from harness.execution.progress import Progress
from harness.machine import provenance
from harness.plan.run_plan import Machine, Plan
from harness.records.cells import (
    RunRecord,
    Status,
    cell_path,
    read_cell,
    read_cells,
    read_run,
    records_folder,
    write_cell,
    write_run,
)
from harness.records.metric_table import METRICS
from harness.records.study import SHELVES, Answer, Studies, StudyRecord, read_studies, write_studies
from harness.run_folder.integrity import DAMAGED
from harness.studies import framework
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.evidence.evidence_studies import SHELF, STUDIES
from harness.studies.framework import Found, Shelf
from harness.studies.trained_context import folder_of
from scenes.files.errors import DamagedRecord
from tests.harness.cells import cell, checkpoint
from tests.replacing import replace

TRAINING = "no_encoding"
HERE = "0123456789ab"
EVIDENCE_FILE = SHELVES["evidence"]


def a_run(plan: Plan, finished: bool = True) -> RunRecord:
    settings = json.loads(json.dumps(plan.settings()))
    return RunRecord("reduced", "", [], {}, [], list(plan.seeds), settings, {}, {}, finished, [])


@pytest.fixture
def context(tmp_path: Path) -> EvidenceContext:
    """A context whose training is complete, at commit `HERE`."""
    here = EvidenceContext(tmp_path, tmp_path, tmp_path, True, Progress(), Machine("cpu", 1, 1), True)
    plan = here.plan(TRAINING)
    write_run(folder_of(tmp_path, TRAINING), a_run(plan))
    for key in plan.cells():
        write_trained(here, key)
    return here


def write_trained(
    context: EvidenceContext,
    key: tuple[str, str, int] = ("lego", "nerf", 0),
    commit: str = HERE,
    status: Status = "done",
) -> None:
    trained = cell(*key, [checkpoint(4, 1.0, 20.0)], status=status, provenance={"commit": commit})
    write_cell(folder_of(context.out, TRAINING), trained)


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch, context: EvidenceContext) -> list[Path]:
    """The folders that were run, in which every failed or missing cell was then done."""
    folders: list[Path] = []

    def run(plan: Plan, folder: Path, *others: object) -> int:
        folders.append(folder)
        for key in plan.cells():
            path = cell_path(folder, *key)
            if not path.exists() or read_cell(path).status != "done":
                write_trained(context, key)
        write_run(folder, a_run(plan))
        return 0

    monkeypatch.setattr(execution_run, "run", run)
    return folders


@pytest.mark.parametrize("status", ["diverged", "error", "not_available", "unfinished"])
def test_a_run_that_is_not_finished_or_has_a_failed_cell_is_run_again(
    context: EvidenceContext, runs: list[Path], status: Any
) -> None:
    """Divergence is a result."""
    if status == "unfinished":
        write_run(folder_of(context.out, TRAINING), a_run(context.plan(TRAINING), finished=False))
    else:
        write_trained(context, status=status)
    statuses = {trained.status for trained in context.trained(TRAINING).cells}
    assert statuses == ({"done", "diverged"} if status == "diverged" else {"done"})
    assert runs == ([] if status == "diverged" else [folder_of(context.out, TRAINING)])


def test_a_damaged_cell_is_an_error_of_a_run_that_is_not_resumed(context: EvidenceContext, runs: list[Path]) -> None:
    path = cell_path(folder_of(context.out, TRAINING), "lego", "nerf", 0)
    path.write_text("{")
    with pytest.raises(DamagedRecord, match="delete it and run again"):
        context.trained(TRAINING)
    assert runs == []


NAMES = ["positive_controls", "factorial"]
"""Two studies; the first uses the training."""
Resumed = Callable[..., tuple[list[str], str]]


@pytest.fixture
def resumed(context: EvidenceContext, monkeypatch: pytest.MonkeyPatch) -> Resumed:
    """Resumes a record of both studies with the requested ones, to the end or `stopped` once a study has its training;
    returns the studies that were measured again, and the printed lines."""
    interest = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
    settings = {"quick": True, "device": "cpu", "smallest_of_interest": interest}
    studies = [StudyRecord(STUDIES[name].info, findings=[Answer("as it was")]) for name in NAMES]
    write_studies(context.out / EVIDENCE_FILE, Studies("evidence", {}, settings, studies, finished=True))

    def go_on(asked: list[str] = NAMES, stopped: bool = False) -> tuple[list[str], str]:
        done: list[str] = []
        lines: list[str] = []
        show = Progress()
        monkeypatch.setattr(show, "line", lines.append)

        def measure_of(shelf: Shelf, name: str) -> Callable[[EvidenceContext], Iterator[Found]]:
            def measure(here: EvidenceContext) -> Iterator[Found]:
                done.append(name)
                if TRAINING in shelf.studies[name].trainings:
                    here.trained(TRAINING)
                if stopped:
                    raise KeyboardInterrupt
                yield "as it was"

            return measure

        monkeypatch.setattr(Shelf, "measure_of", measure_of)
        framework.run(SHELF, asked, replace(context, show=show), resume=True)
        return done, "\n".join(lines)

    return go_on


def kept(context: EvidenceContext) -> list[str]:
    return [study.info.id for study in read_studies(context.out / EVIDENCE_FILE).studies]


def test_resuming_does_nothing_again_where_everything_is_valid(resumed: Resumed, runs: list[Path]) -> None:
    assert (resumed()[0], runs) == ([], [])


def test_figures_of_other_cells_do_not_outlive_a_stop_before_they_are_measured_again(
    context: EvidenceContext, resumed: Resumed, runs: list[Path]
) -> None:
    write_trained(context, status="error")
    with pytest.raises(KeyboardInterrupt, match="1 of 2 studies are kept"):
        resumed(stopped=True)
    assert len(runs) == 1, "the training is complete by now"
    assert (kept(context), read_studies(context.out / EVIDENCE_FILE).finished) == (NAMES[1:], False)
    assert resumed()[0] == NAMES[:1]
    assert kept(context) == NAMES


@pytest.mark.parametrize("shared", [False, True])
def test_figures_of_a_study_that_is_not_asked_for_are_dropped_where_its_training_is_gone_on_with(
    context: EvidenceContext, resumed: Resumed, runs: list[Path], monkeypatch: pytest.MonkeyPatch, shared: bool
) -> None:
    if shared:
        monkeypatch.setitem(STUDIES, NAMES[1], replace(STUDIES[NAMES[1]], trainings=(TRAINING,)))
    write_trained(context, status="error")
    done, said = resumed(NAMES[1:])
    assert (done, len(runs)) == ((NAMES[1:], 1) if shared else ([], 0))
    assert (f"{NAMES[0]}: its figures are dropped, as {TRAINING} has to be resumed" in said) == shared
    assert kept(context) == (NAMES[1:] if shared else NAMES)


@pytest.mark.parametrize("how", ["a byte", "missing"])
@pytest.mark.parametrize("file", ["cells/lego.nerf.0.json", "run.json"])
def test_a_damaged_file_of_a_training_is_named_and_just_that_is_made_again(
    context: EvidenceContext, resumed: Resumed, runs: list[Path], file: str, how: str
) -> None:
    folder = folder_of(context.out, TRAINING)
    path = records_folder(folder) / file
    others = [other for other in records_folder(folder).glob("cells/*.json") if other != path]
    before = [other.stat().st_mtime_ns for other in others]
    spoilt = path.read_bytes().replace(b'"schema"', b'"schima"')
    path.unlink() if how == "missing" else path.write_bytes(spoilt)
    done, said = resumed()
    assert done == NAMES[:1], "the study that uses it"
    assert runs == [folder]
    assert {trained.status for trained in read_cells(folder)} == {"done"}
    assert before == [other.stat().st_mtime_ns for other in others]
    if how == "a byte":
        assert f"{TRAINING}: records/{file}: " in said
        assert (folder / DAMAGED / f"records.{file.replace('/', '.')}.1").read_bytes() == spoilt


def test_a_training_of_another_plan_is_moved_aside_and_not_lost(context: EvidenceContext, runs: list[Path]) -> None:
    folder = folder_of(context.out, TRAINING)
    run = read_run(folder)
    write_run(folder, replace(run, settings={**run.settings, "profile": "other"}))
    context.trained(TRAINING)
    assert runs == [folder]
    aside = context.out / DAMAGED / f"studies.{TRAINING}.1"
    assert read_run(aside).settings["profile"] == "other"
    assert cell_path(aside, "lego", "nerf", 0).exists()


@pytest.mark.parametrize("other", [HERE, "ba9876543210", f"{HERE}-dirty"])
def test_cells_of_another_commit_are_counted(
    context: EvidenceContext, runs: list[Path], monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    monkeypatch.setattr(provenance, "commit", lambda: HERE)
    write_trained(context, ("lego", "voxels", 0), "of no cell of the plan")
    write_trained(context, commit=other)
    scale = context.scale(replace(STUDIES["collapse"], trainings=(TRAINING,)))
    if other == HERE:
        assert "commit" not in scale
        assert "commit" not in context.scale(STUDIES["collapse"]), "not trained yet"
        return
    cells = len(context.plan(TRAINING).cells())
    for words in (f"{cells - 1} cells at commit {HERE}", f"1 cells at commit {other}", f"at commit {HERE}, at which"):
        assert words in scale
    context.trained(TRAINING)
    assert runs == [], "they are used all the same"
