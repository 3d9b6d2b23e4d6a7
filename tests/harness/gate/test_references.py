"""References of a class of processor: read, renewed, and what becomes of a class that has none."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.command import gate_command
from harness.gate import gate_run
from harness.gate.gates import gates
from harness.gate.outcome import GateContext, Sample
from harness.gate.process import class_here
from harness.gate.references import References, read_references, write_references
from tests.harness.gate.gate_runs import gate_line, references
from tests.harness.shell import refused

ROOT = Path(__file__).parents[3]


def test_a_class_without_references_is_held_to_the_usual_one_and_told_so(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = limits.parent / "classes"
    (folder / f"{class_here()}.json").unlink()
    assert "avx2.json" in refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    write_references(folder, references("avx2"))
    if class_here() != "avx2":
        assert gate_line(limits, tmp_path / "others") == 0
        assert "of which nothing is stored: held to avx2 with wider limits" in capsys.readouterr().out
        record = json.loads((tmp_path / "others" / "gate.json").read_text())
        assert (record["class"], record["references"]) == (class_here(), "avx2")
    assert "can be measured as" in refused(
        capsys, "--limits", limits, "--class", "avx1024", "--out", tmp_path / "no", "--quiet", command="gate"
    )


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: "{", "damaged"),
        (lambda text: "[]", "damaged"),
        (lambda text: text.replace('"schema": 1', '"schema": 7'), "schema 7"),
        (lambda text: text.replace('"psnr": [20.0', '"psnr": ["a"'), "damaged"),
        (lambda text: text.replace('"losses"', '"loses"'), "damaged"),
        (lambda text: text.replace("[0.25]", "[NaN]"), "JSON is malformed"),
        (lambda text: text.replace("[2.0, 2.1]", "[]"), "damaged"),
    ],
)
def test_references_that_cannot_be_read_are_bad_input(
    spoil: Callable[[str], str], said: str, limits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = limits.parent / "classes" / f"{class_here()}.json"
    stored = references(class_here())
    assert read_references(file.parent, class_here()) == stored
    file.write_text(spoil(file.read_text()))
    told = refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    assert said in told
    assert str(file) in told


def test_a_renewal_writes_what_it_measured_class_by_class(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def renew(situation: GateContext) -> References:
        asked.append(situation.references.name)
        return References(**{**vars(situation.references), "speed": {"speed.score": [3.0, 3.1]}})

    monkeypatch.setattr(gate_run, "RENEWALS", {"speed": renew})
    monkeypatch.setattr(gate_run, "RENEWED_CLASSES", (class_here(),))
    assert gate_line(limits, tmp_path / "out", "--renew", "--only", "speed.train.nerf") == 0
    after = read_references(limits.parent / "classes", class_here())
    assert asked == [class_here()]
    assert after.speed == {"speed.score": [3.0, 3.1]}
    assert after.cells == references(class_here()).cells
    assert after.kinds["speed"].provenance["processor"]
    assert f"speed: references of class {class_here()} renewed" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["avx2", "avx512"])
def test_the_committed_references_are_of_these_gates(name: str) -> None:
    stored = read_references(ROOT / gate_command.LIMITS.parent / "classes", name)
    assert stored.name == name
    assert [stored.missing(gate) for gate in gates() if gate.kind in ("changed", "worse", "speed")] == [""] * sum(
        gate.kind in ("changed", "worse", "speed") for gate in gates()
    )
