"""A cell that is resumed is bit-identical to an uninterrupted one, or it is trained from the start with a notice."""

import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.command.plan_options import planned
from harness.execution import run
from harness.execution.progress import Progress
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.records.cells import CellRecord
from harness.records.pictures import sealed, unsealed
from harness.records.snapshot import Unfinished, read_unfinished, unfinished_path, write_unfinished
from harness.training.checkpoints import Keeping, training_state
from harness.training.lockstep import train_group
from scenes.files.errors import DamagedRecord
from scenes.view_sets.view_set import ViewSet
from tests.harness import tiny
from tests.harness.cells import without_time
from tests.harness.tiny import BUDGET, SCORE

TRAIN = replace(tiny.TRAIN, clip_ratio=0.9)
"""Half of the gradients are clipped, by what was usual before."""
METHODS = ("nerf", "qnerf", "qnerf_repaired")
"""Without an amplifier, with one, and with a mean that it holds."""
Undisturbed = tuple[Path, dict[str, CellRecord]]
"""The output folder and the cells of a group that was not stopped."""


class Stopped(Exception):
    """The end of a group, as by `kill -9`."""


ORIGIN = {"threads": 1, "sources": "one"}


def train(
    ball: ViewSet, out: Path, until: float = 2.0, origin: dict[str, Any] = ORIGIN, **changes: Any
) -> tuple[dict[str, CellRecord], list[str]]:
    """Return the records and notices until the group's share of training reaches `until`."""

    def on_progress(share: float) -> None:
        if share >= until:
            raise Stopped

    task = replace(GroupTask("ball", 0, METHODS, TRAIN, SCORE, BUDGET, out, keep_every=0.0), **changes)
    cells: dict[str, CellRecord] = {}
    notices: list[str] = []
    with suppress(Stopped):
        for cell in train_group(task, ball, origin, on_progress, on_notice=notices.append):
            cells[cell.method] = cell
    return cells, notices


@pytest.fixture(scope="module")
def undisturbed(ball: ViewSet, tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    out = tmp_path_factory.mktemp("undisturbed")
    return out, train(ball, out)[0]


@pytest.fixture(scope="module")
def half_way(ball: ViewSet, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The end is after the first refreshes of the occupancy grid and the first two checkpoints."""
    out = tmp_path_factory.mktemp("half_way")
    assert train(ball, out, until=14 / 24)[0] == {}
    return out


@pytest.fixture
def stopped(half_way: Path, tmp_path: Path) -> Path:
    shutil.copytree(half_way, tmp_path / "out")
    return tmp_path / "out"


def files(out: Path) -> dict[str, bytes]:
    return {
        path.relative_to(out).as_posix(): path.read_bytes()
        for folder in ("checkpoints", "records")
        for path in (out / folder).rglob("*.safetensors")
    }


@pytest.mark.slow
def test_a_group_that_was_stopped_twice_ends_in_the_bits_of_one_that_was_not(
    ball: ViewSet, undisturbed: Undisturbed, stopped: Path
) -> None:
    for step, until in ((14, 20 / 24), (20, 2.0)):
        cells, notices = train(ball, stopped, until=until)
        assert notices == [f"ball, {method}, seed 0: resumes at step {step}" for method in METHODS]
    expected_files, expected = files(undisturbed[0]), undisturbed[1]
    assert len(expected_files) == 2 * len(METHODS) + 1
    assert files(stopped) == expected_files
    for method, cell in cells.items():
        assert without_time(cell) == without_time(expected[method])
        assert cell.provenance["resumed_at"] == [14, 20]
        assert "resumed_at" not in expected[method].provenance


@pytest.mark.slow
def test_its_clocks_go_on_from_where_they_stood(ball: ViewSet, stopped: Path) -> None:
    path = unfinished_path(stopped, "ball", "nerf", 0)
    kept = read_unfinished(path)
    write_unfinished(path, replace(kept, listing={**kept.listing, "seconds": 1000.0, "core_seconds": 3000.0}))
    cells, _ = train(ball, stopped)
    assert 1000 < cells["nerf"].train_seconds < 1100
    assert 0 < cells["qnerf"].train_seconds < 100
    assert 3000 < cells["nerf"].train_core_seconds < 3300
    assert cells["nerf"].curve[-1].core_seconds == cells["nerf"].train_core_seconds
    assert 0 < cells["qnerf"].train_core_seconds < 300


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"train": replace(TRAIN, learning_rate=5e-3)}, "settings"),
        ({"budget": replace(BUDGET, steps=25)}, "settings"),
        ({"origin": {**ORIGIN, "sources": "another"}}, "this program"),
    ],
)
def test_other_settings_or_code_begin_again(ball: ViewSet, stopped: Path, changes: dict[str, Any], why: str) -> None:
    _, notices = train(ball, stopped, until=0.0, **changes)
    assert notices[0] == f"ball, nerf, seed 0: trained from the start, as {why} changed since its snapshot"
    assert read_unfinished(unfinished_path(stopped, "ball", "nerf", 0)).listing["step"] == 1


def flipped(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-9] ^= 4
    path.write_bytes(data)
    with pytest.raises(DamagedRecord, match=r"qnerf\.0\.safetensors"):
        read_unfinished(path)


def unfit(change: Callable[[Any, Any], object]) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        kept = read_unfinished(path)
        change(kept.listing, kept.tensors)
        write_unfinished(path, kept)

    return spoil


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (flipped, "damaged"),
        (unfit(lambda listing, _: listing.pop("curve")), "not compatible ("),
        (unfit(lambda listing, _: listing.update(due=9)), "not compatible ("),
        (unfit(lambda _, tensors: tensors.pop("optimiser.0.0.exp_avg")), "not compatible ("),
        (unfit(lambda _, tensors: tensors.update({"trained.coarse.other": np.zeros(3, "f4")})), "not compatible ("),
    ],
)
def test_a_snapshot_that_does_not_fit_is_named_and_its_cell_begins_again(
    ball: ViewSet, undisturbed: Undisturbed, stopped: Path, spoil: Callable[[Path], None], why: str
) -> None:
    spoil(unfinished_path(stopped, "ball", "qnerf", 0))
    cells, notices = train(ball, stopped)
    assert notices[0] == "ball, nerf, seed 0: resumes at step 14"
    assert notices[1].startswith(f"ball, qnerf, seed 0: trained from the start, as its snapshot is {why}")
    assert without_time(cells["qnerf"]) == without_time(undisturbed[1]["qnerf"])


@pytest.mark.slow
def test_one_that_cannot_be_kept_is_said_once_and_trained_to_its_end(
    ball: ViewSet, undisturbed: Undisturbed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def odd(learner: Any) -> Unfinished:
        if learner.method == "qnerf":
            raise TypeError("Got unsupported ScalarType BFloat16")
        return training_state(learner)

    monkeypatch.setattr("harness.training.cell_training.training_state", odd)
    cells, notices = train(ball, tmp_path)
    assert len(notices) == 1
    said = "ball, qnerf, seed 0: no snapshot can be written in the middle of its training (TypeError: Got"
    assert notices[0].startswith(said)
    assert {method: cell.status for method, cell in cells.items()} == dict.fromkeys(METHODS, "done")
    assert without_time(cells["qnerf"]) == without_time(undisturbed[1]["qnerf"])


def test_tensors_come_back_as_they_were_sealed() -> None:
    tensors = {
        "b": np.array([np.inf, -0.0], dtype=np.float32),
        "a": np.array(True),
        "none": np.zeros((0, 3)),
        "turned": np.arange(6.0).reshape(2, 3).T,
    }
    listing, found = unsealed("key", sealed("key", {"φ": [1.1, None]}, tensors))
    assert listing == {"φ": [1.1, None]}
    assert {name: (one.dtype, one.shape, one.tobytes()) for name, one in found.items()} == {
        name: (one.dtype, one.shape, one.tobytes()) for name, one in tensors.items()
    }
    with pytest.raises(ValueError, match="other"):
        unsealed("other", sealed("key", {}, tensors))


def test_what_takes_long_is_kept_less_often() -> None:
    now = [0.0]
    keeping = Keeping(10.0, lambda: now[0])
    assert not keeping.is_due
    now[0] = 10.0
    assert keeping.is_due
    with keeping.done():
        now[0] = 11.0  # 1 s of writing: 2 % of 50
    now[0] = 60.9
    assert not keeping.is_due
    now[0] = 61.0
    assert keeping.is_due


def test_prefixes_are_whole_words() -> None:
    cell = Unfinished({}, {"a.b.c": np.zeros(1), "ab.c": np.ones(1)})
    assert list(cell.under("a")) == ["b.c"]


@pytest.mark.parametrize("kept", [False, True])
def test_its_folder_goes_with_the_last_of_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: bool) -> None:
    monkeypatch.setattr(run, "run_groups", lambda *_: iter(()))
    path = unfinished_path(tmp_path, "lego", "nerf", 0)
    path.parent.mkdir()
    if kept:
        path.write_bytes(b"of a cell that ended in an error")
    plan = planned("smoke", scenes=["lego"], methods=["nerf"], seeds=1)
    this = run._Run(plan, tmp_path, Machine("cpu", 1, 1), "run", None, Progress(), lambda: None)
    this.train(None)
    assert path.parent.exists() == kept
