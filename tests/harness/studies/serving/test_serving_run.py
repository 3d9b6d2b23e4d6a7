"""The record of serving: whole, read back, never at the cost of the run, and not measured twice."""

import json
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.execution.progress import Quiet
from harness.playback.run_loader import FinishedRun
from harness.records.json_record import DamagedRecord
from harness.records.serving_record import SERVING_FILE, read_serving, write_serving
from harness.studies.serving import serving_run
from harness.studies.serving.serving_run import ServingRequest, after_run
from harness.training.trainer import Diverged
from reports.data.serving_load import find_serving
from tests.harness.studies.serving.conftest import CPU, fail_with, with_study
from tests.harness.trained_runs import SIZE

pytestmark = pytest.mark.slow

OTHER_ORIGINS: dict[str, dict[str, Any]] = {"machine": {"processor": "another"}, "torch": {"packages": {"torch": "0"}}}


class Said(Quiet):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def line(self, text: str) -> None:
        self.lines.append(text)


@pytest.fixture(scope="module")
def served(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with its record of serving; not to be changed."""
    out = Path(shutil.copytree(trained, tmp_path_factory.mktemp("finished") / "run"))
    after_run(out, "cpu", out, Quiet())
    return out


@pytest.fixture
def copy(served: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(served, tmp_path / "served"))


def test_the_record_is_whole(served: Path) -> None:
    record = find_serving(served)
    assert record is not None
    assert record.cache is not None
    assert record.attention is not None
    assert record.first_frame is not None
    assert {one.method for one in record.cache.latencies} == {"nerf", "qnerf"}
    assert record.first_frame.methods == ["nerf", "qnerf"]
    assert {row.truth_whole is None for row in record.attention.allocations} == {False}
    settings = record.settings
    assert (settings["scenes"], settings["methods"], settings["seed"]) == (["ball"], ["nerf", "qnerf"], 0)
    assert (settings["width"], settings["quick"], settings["complete"]) == (SIZE, True, True)
    assert not list(served.glob(".scratch-*")), "scratch files are gone"


def test_what_is_written_is_read_back(served: Path, tmp_path: Path) -> None:
    record = read_serving(served / SERVING_FILE)
    write_serving(tmp_path, record)
    assert read_serving(tmp_path / SERVING_FILE) == record


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data.pop("cache"),
        lambda data: data.update(schema=99),
        lambda data: data.update(schema=1),
        lambda data: data.update(extra=1),
        lambda data: data["cache"]["latencies"][0].pop("seconds"),
        lambda data: data["attention"]["curves"][0].update(colour=1),
        lambda data: data["attention"].update(phi=None),
        lambda data: data.update(first_frame=[1]),
    ],
)
def test_a_damaged_record_is_refused(copy: Path, damage: Callable[[dict[str, Any]], Any]) -> None:
    path = copy / SERVING_FILE
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("digest", None)
    damage(data)
    path.write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(DamagedRecord, match=f"run `python -m harness study serving {copy}` again"):
        read_serving(path)


def test_a_truncated_record_is_refused(copy: Path) -> None:
    path = copy / SERVING_FILE
    path.write_text(path.read_text(encoding="utf-8")[:1000], encoding="utf-8")
    with pytest.raises(DamagedRecord, match=str(path)):
        read_serving(path)


def test_what_is_there_is_not_measured_again(copy: Path) -> None:
    before, said = (copy / SERVING_FILE).read_bytes(), Said()
    after_run(copy, "cpu", copy, said)
    assert said.lines == ["serving: measured before"]
    assert (copy / SERVING_FILE).read_bytes() == before


@pytest.mark.parametrize("change", ["weights", "stopped", "damaged", "code", "machine", "torch"])
def test_what_does_not_fit_is_measured_again(copy: Path, monkeypatch: pytest.MonkeyPatch, change: str) -> None:
    path = copy / SERVING_FILE
    before = read_serving(path)
    for field in serving_run.STUDIES:
        with_study(monkeypatch, field, lambda situation: None)
    with_study(monkeypatch, "first_frame", lambda situation: before.first_frame)
    if change == "code":
        monkeypatch.setattr(serving_run, "_code", lambda: "other sources")
    elif change in ("machine", "torch"):
        origin = {**before.provenance, **OTHER_ORIGINS[change]}
        write_serving(copy, replace(before, provenance=origin))
    elif change == "weights":
        shutil.copy(copy / "checkpoints/ball.nerf.0.safetensors", copy / "checkpoints/ball.qnerf.0.safetensors")
    elif change == "stopped":
        data = json.loads(path.read_text(encoding="utf-8"))
        data.pop("digest", None)
        path.write_text(json.dumps({**data, "settings": {**data["settings"], "complete": False}}), encoding="utf-8")
    else:
        path.write_text("{", encoding="utf-8")
    after_run(copy, "cpu", copy, Quiet())
    assert read_serving(path).cache is None, "by studies that measure nothing"


@pytest.mark.parametrize("error", [RuntimeError("no memory"), OSError(28, "No space left"), Diverged(3, "colour")])
def test_a_failing_study_costs_itself_alone_and_is_tried_again(
    out: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    with_study(monkeypatch, "attention", fail_with(error))
    with_study(monkeypatch, "cache", lambda situation: None)
    after_run(out, "cpu", out, Quiet())
    record = read_serving(out / SERVING_FILE)
    assert record.attention is None
    assert record.first_frame is not None
    assert any("attention-prioritised rendering: " in one and str(error) in one for one in record.left_out)
    assert record.failed == ["attention-prioritised rendering"]
    assert not record.settings["complete"]
    with_study(monkeypatch, "attention", lambda situation: None)
    after_run(out, "cpu", out, Quiet())
    again = read_serving(out / SERVING_FILE)
    assert (again.failed, again.settings["complete"]) == ([], True)


@pytest.mark.parametrize("stop", [KeyboardInterrupt(), RuntimeError("ours")])
def test_a_full_disk_does_not_hide_what_stopped_it(
    out: Path, monkeypatch: pytest.MonkeyPatch, stop: BaseException
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    for field in serving_run.STUDIES:
        with_study(monkeypatch, field, fail_with(stop))
    monkeypatch.setattr(serving_run, "write_serving", full)
    asked, said = ServingRequest(["ball"], ["nerf"], 0, SIZE, True), Said()
    with pytest.raises(type(stop)):
        serving_run.run(FinishedRun.of(out), asked, CPU, out, said)
    assert any("could not be written" in line and "No space left" in line for line in said.lines)


def everything_in(out: Path) -> dict[str, bytes]:
    files = [out / SERVING_FILE, *(out / "records/images/serving").iterdir()]
    return {file.name: file.read_bytes() for file in files}


SELDOM = [pytest.param(ended, marks=pytest.mark.thorough) for ended in ("first study", "third study", "late")]


@pytest.mark.parametrize("ended", ["too long", "nothing to render", *SELDOM])
def test_a_whole_record_is_not_lost_to_a_lesser_one(copy: Path, monkeypatch: pytest.MonkeyPatch, ended: str) -> None:
    monkeypatch.setattr(serving_run, "_code", lambda: "measured again")
    before = everything_in(copy)
    assert len(before) > 3
    if ended == "too long":
        monkeypatch.setattr(serving_run, "estimated_seconds", lambda situation: 1e6)
    elif ended == "first study":
        with_study(monkeypatch, "cache", fail_with(KeyboardInterrupt()))
    elif ended == "third study":
        with_study(monkeypatch, "cache", lambda situation: None)
        with_study(monkeypatch, "first_frame", fail_with(KeyboardInterrupt()))
    elif ended == "nothing to render":
        for file in (copy / "checkpoints").iterdir():
            file.unlink()
    else:
        monkeypatch.setattr(serving_run, "estimated_seconds", lambda situation: -1.0)
        monkeypatch.setattr(serving_run, "SERVING_SECONDS", 0.0)
    said = Said()
    with suppress(KeyboardInterrupt):
        after_run(copy, "cpu", copy, said)
    assert said.lines != ["serving: measured before"]
    assert everything_in(copy) == before
    assert not list(copy.glob(".scratch-*"))


def test_what_is_left_of_a_stopped_run_replaces_other_weights(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(copy / "checkpoints/ball.nerf.0.safetensors", copy / "checkpoints/ball.qnerf.0.safetensors")
    cache = read_serving(copy / SERVING_FILE).cache
    with_study(monkeypatch, "cache", lambda situation: cache)
    with_study(monkeypatch, "attention", fail_with(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        after_run(copy, "cpu", copy, Quiet())
    record = read_serving(copy / SERVING_FILE)
    assert (record.cache, record.attention) == (cache, None)


def test_once_the_time_is_over_nothing_is_begun(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def takes_all(situation: Any) -> None:
        situation.deadline = situation.clock()

    with_study(monkeypatch, "cache", takes_all)
    after_run(out, "cpu", out, Quiet())
    record = read_serving(out / SERVING_FILE)
    assert (record.cache, record.attention, record.first_frame) == (None, None, None)
    assert not record.settings["complete"]
    assert [one.split(":")[0] for one in record.left_out] == [
        "attention-prioritised rendering", "first frame of the viewer"
    ]  # fmt: skip


@pytest.mark.thorough
def test_whatever_fails_outside_of_a_study_is_said(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with_study(monkeypatch, "cache", lambda situation: None)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(serving_run, "write_serving", full)
    said = Said()
    after_run(out, "cpu", out, said)
    assert any("serving was not measured" in line and "No space left" in line for line in said.lines)


def test_ctrl_c_keeps_what_was_finished(served: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    measured = read_serving(served / SERVING_FILE).cache
    with_study(monkeypatch, "cache", lambda situation: measured)
    with_study(monkeypatch, "attention", fail_with(KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        after_run(out, "cpu", out, Quiet())
    record = read_serving(out / SERVING_FILE)
    assert record.cache == measured
    assert not record.settings["complete"]
    assert any("stopped by KeyboardInterrupt" in one for one in record.left_out)


def test_a_cell_that_diverged_is_named(out: Path) -> None:
    path = out / "records/cells/ball.nerf.0.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    data.pop("digest", None)
    path.write_text(json.dumps({**data, "status": "diverged", "reason": "not finite at step 3"}), encoding="utf-8")
    after_run(out, "cpu", out, Quiet())
    record = read_serving(out / SERVING_FILE)
    assert record.cache is not None
    assert {one.method for one in record.cache.latencies} == {"qnerf"}
    assert record.attention is None
    assert any("ball, nerf, seed 0" in one and "diverged" in one for one in record.left_out)
