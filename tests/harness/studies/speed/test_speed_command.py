"""`python -m harness speed`: options, the folder, going on after a stop, and all of it at sizes that mean nothing."""

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.records.charts import Series, Table
from harness.records.speed_record import QUESTIONS, Measurement, read_speed
from harness.studies.speed import speed_run
from harness.studies.speed.speed_context import measured
from tests.harness import shell
from tests.test_architecture import heavy_imports_of, run_module

refused = partial(shell.refused, command="speed")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--items 0", "--items 0: choose from 1 2 3"),
        ("--items 1 12 13", "--items 12 13"),
        ("--plain-seconds 0", "--plain-seconds 0: must lie between"),
        ("--plain-seconds nan", "--plain-seconds nan"),
        ("--plain-seconds 1e9", "--plain-seconds 1e+09"),
        ("--resume", "--resume: name the folder"),
    ],
)
def test_bad_options_are_said_in_one_line(
    options: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, "--quiet", *options.split())
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert "is in use" in refused(capsys, "--quiet", "--out", tmp_path)
    assert "is a file" in refused(capsys, "--quiet", "--out", tmp_path / "mine.txt")
    assert "cannot be written" in refused(capsys, "--quiet", "--out", tmp_path / "mine.txt" / "run")
    assert "holds no speed.json" in refused(capsys, "--quiet", "--out", tmp_path, "--resume")
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


class Script:
    """Questions that answer at once, and stop the run where they are told to."""

    def __init__(self, stop_in: int | None) -> None:
        self.stop_in = stop_in
        self.asked: list[int] = []

    def question(self, item: int) -> Iterator[speed_run.Finding]:
        self.asked.append(item)
        yield measured(f"q{item}.ratio", item, "ratio", [float(item)], "×")
        if item == self.stop_in:
            raise KeyboardInterrupt
        yield Series("panel", item, "line", "x", "y", [1.0], [2.0])
        yield Table(f"q{item}", item, "table", ["a"], [["b"]])


def scripted(monkeypatch: pytest.MonkeyPatch, stop_in: int | None = None) -> Script:
    script = Script(stop_in)
    measures = {item: lambda situation, item=item: script.question(item) for item in QUESTIONS}
    monkeypatch.setattr(speed_run, "MEASURES", measures)
    return script


def ids(out: Path) -> list[str]:
    return [one.id for one in read_speed(out / "speed.json").measurements]


def test_a_stopped_run_keeps_what_it_has_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "speed"
    options = ["speed", "--quick", "--quiet", "--items", "5", "2", "6", "--out", str(out)]
    first = scripted(monkeypatch, stop_in=5)
    assert main(options) == 130
    assert first.asked == [2, 5]
    record = read_speed(out / "speed.json")
    assert ids(out) == ["q2.ratio", "q5.ratio"]
    assert set(record.seconds) == {"2", "total"}, "5 was not finished"
    assert record.settings["quick"] is True
    assert [file.name for file in out.iterdir()] == ["speed.json"]

    second = scripted(monkeypatch)
    assert main([*options, "--resume"]) == 0
    assert second.asked == [5, 6]
    record = read_speed(out / "speed.json")
    assert ids(out) == ["q2.ratio", "q5.ratio", "q6.ratio"], "5 is there once"
    assert [one.item for one in record.series] == [one.item for one in record.tables] == [2, 5, 6]
    assert set(record.seconds) == {"2", "5", "6", "total"}
    assert record.seconds["total"] == pytest.approx(sum(record.seconds[item] for item in "256"))


def test_a_damaged_record_is_named_moved_aside_and_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "speed"
    options = ["speed", "--quick", "--items", "2", "--out", str(out)]
    scripted(monkeypatch)
    assert main(options) == 0
    data = bytearray((out / "speed.json").read_bytes())
    data[len(data) // 2] ^= 1
    (out / "speed.json").write_bytes(data)
    second = scripted(monkeypatch)
    capsys.readouterr()
    assert main([*options, "--resume"]) == 0
    assert "speed.json: " in capsys.readouterr().out
    assert second.asked == [2]
    assert ids(out) == ["q2.ratio"]
    assert (out / "damaged" / "speed.json.1").read_bytes() == data


def test_other_options_are_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scripted(monkeypatch)
    assert main(["speed", "--quick", "--quiet", "--items", "1", "--out", str(tmp_path / "a")]) == 0
    said = refused(capsys, "--quiet", "--quick", "--plain-seconds", "7", "--resume", "--out", tmp_path / "a")
    assert "other options" in said
    assert ids(tmp_path / "a") == ["q1.ratio"]


def answers(out: Path, *items: int) -> dict[str, Measurement]:
    options = ["speed", "--quick", "--quiet", "--items", *map(str, items), "--out", str(out)]
    assert main(options) == 0
    record = read_speed(out / "speed.json")
    assert set(record.seconds) == {*map(str, items), "total"}
    found = {one.id: one for one in record.measurements}
    assert len(found) == len(record.measurements), "ids are there once"
    assert {one.item for one in record.measurements} == set(items)
    assert all(one.value is not None or one.detail for one in found.values())
    json.dumps(json.loads((out / "speed.json").read_text()), allow_nan=False)
    assert [file.name for file in out.iterdir()] == ["speed.json"], "nothing is left behind"
    return found


@pytest.mark.slow
@pytest.mark.thorough
def test_every_question_inside_the_process_is_answered(tmp_path: Path) -> None:
    found = answers(tmp_path / "speed", 1, 2, 3, 4, 5, 6, 11)
    for id in (
        "training.dense.ratio",
        "training.skipping.rate",
        "matrix.paper.share",
        "matrix.reduced.share",
        "target.same.ratio",
        "target.reduced.ratio",
        "rendering.reduced.ratio",
        "encoding.phi.10.ratio",
        "quadrature.autograd.ratio",
        "accelerations.grid.step.ratio",
        "accelerations.none.view.ratio",
    ):
        assert id in found
    record = read_speed(tmp_path / "speed" / "speed.json")
    assert {one.panel for one in record.series} == {
        f"PSNR against training seconds, {scene}" for scene in ("lego", "hotdog", "drums")
    }
    assert [one.id for one in record.tables] == ["machine.products", "accelerations.profile"]
    shares = [row[1] for row in record.tables[1].rows]
    assert sum(share for share in shares if isinstance(share, float)) == pytest.approx(100.0)


@pytest.mark.thorough
@pytest.mark.slow
def test_ground_truth_and_memory_are_measured_in_processes_of_their_own(tmp_path: Path) -> None:
    found = answers(tmp_path / "speed", 7, 8)
    assert found["render.lego.scalar_rgb.seconds"].value
    for id in ("memory.worker.nerf.peak", "memory.run.peak"):
        value = found[id].value
        assert value is None or 0.1 < value < 8.0


@pytest.mark.slow
@pytest.mark.thorough
def test_growth_and_processes_are_measured(tmp_path: Path) -> None:
    found = answers(tmp_path / "speed", 9, 10)
    assert {id for id in found if id.startswith("growth")} == {
        f"growth.{name}.exponent" for name in ("rays", "samples", "width", "resolution", "seeds")
    }
    assert "processes.ratio" in found


def test_help_imports_nothing_heavy() -> None:
    assert heavy_imports_of(run_module("harness", "speed", "--help")) == set()
