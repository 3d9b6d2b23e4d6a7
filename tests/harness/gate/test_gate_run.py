"""`python -m harness gate` with measurements that the test gives: outcomes, files, words and exit codes."""

import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from harness.__main__ import main
from harness.command import gate_command
from harness.gate import gate_run
from harness.gate.gates import KINDS, Gate, gates
from harness.gate.limits import Limit, LimitsFile, read_limits
from harness.gate.outcome import GateContext, Pictures, Sample
from harness.gate.process import class_here
from harness.gate.references import References, write_references
from harness.run_folder.folder_lock import lock_folder
from scenes.view_sets.images import read_image
from tests.harness.gate.gate_runs import CENTRE, facts, gate_line, measured_values, references, sound
from tests.harness.shell import refused

FAMILY = len(gates())
ROOT = Path(__file__).parents[3]
INPUTS = dict(gate_run.INPUTS)


def test_all_pass(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    assert gate_line(limits, tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert said.count("PASS") == FAMILY
    record = json.loads((tmp_path / "out" / "gate.json").read_text())
    assert [row["name"] for row in record["gates"]] == [gate.name for gate in gates()]
    assert {row["status"] for row in record["gates"]} == {"pass"}
    top = ElementTree.parse(tmp_path / "out" / "junit.xml").getroot()
    assert (top.get("tests"), top.get("failures")) == (str(FAMILY), "0")
    assert [case.get("name") for case in top.iter("testcase")] == [gate.name for gate in gates()]
    assert not (tmp_path / "out" / "failed").exists()


def test_a_failure_says_everything_and_leaves_pictures(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    name = "images.lego.bias"
    picture = np.linspace(0, 1, 48).reshape(4, 4, 3)
    measuring[name] = Sample([20.0] * 16, pictures=Pictures(picture, 1 - picture, np.abs(1 - 2 * picture)))
    out = tmp_path / "out"
    assert gate_line(limits, out, "--only", "images.lego") == 4
    said = capsys.readouterr().out
    limit = read_limits(limits).limits[name]
    assert limit.low is not None
    line = next(one for one in said.splitlines() if one.startswith("FAIL"))
    assert "20 %" in line
    assert f"excess {limit.low - 20:.3g} %" in line
    assert f"{limit.low:.4g} … {limit.high:.4g} %" in line
    assert f"replay: python -m harness gate --limits {limits} --only {name}" in said
    folder = out / "failed" / name
    assert str(folder) in said
    assert sorted(file.name for file in folder.iterdir()) == ["difference.png", "image.png", "reference.png"]
    assert np.allclose(read_image(folder / "image.png")[::6, ::6, :3], picture, atol=0.003)
    top = ElementTree.parse(out / "junit.xml").getroot()
    assert top.get("failures") == "1"
    failure = next(top.iter("failure"))
    assert "20 %" in str(failure.get("message"))
    assert "replay: python -m harness gate" in str(failure.text)
    row = next(row for row in json.loads((out / "gate.json").read_text())["gates"] if row["name"] == name)
    assert (row["status"], row["measured"], row["excess"]) == ("fail", 20.0, pytest.approx(limit.low - 20.0))


@pytest.mark.parametrize("value", [float("nan"), None, float("inf")])
@pytest.mark.parametrize("name", ["worse.qnerf.ssim", "images.lego.largest", "speed.score"])
def test_what_is_no_number_fails_and_is_written_as_none(
    value: float | None, name: str, limits: Path, tmp_path: Path, measuring: dict[str, Sample]
) -> None:
    gate = next(one for one in gates() if one.name == name)
    measuring[name] = Sample([CENTRE] * (gate.new - 1) + [value], "seed 1001 diverged", limit=sound(gate).limit)
    assert gate_line(limits, tmp_path / "out", "--only", name, "--quiet") == 4
    row = json.loads((tmp_path / "out" / "gate.json").read_text())["gates"][0]
    assert (row["measured"], row["status"], row["why"]) == (None, "fail", "seed 1001 diverged")


def test_an_error_in_one_kind_fails_its_gates_and_no_others(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(situation: GateContext, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        raise RuntimeError("rendering ended with exit code 1")

    monkeypatch.setitem(gate_run.MEASURES, "images", broken)
    assert gate_line(limits, tmp_path / "out", "--quiet") == 4
    rows = json.loads((tmp_path / "out" / "gate.json").read_text())["gates"]
    assert {row["kind"] for row in rows if row["status"] == "fail"} == {"images"}
    assert {row["why"] for row in rows if row["status"] == "fail"} == {"RuntimeError: rendering ended with exit code 1"}


def test_a_reference_image_that_is_missing_is_told_before_anything_is_measured(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured: list[Gate] = []

    def measure(situation: GateContext, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        measured.extend(of_kind)
        return {gate.name: sound(gate) for gate in of_kind}

    monkeypatch.setattr(gate_run, "MEASURES", dict.fromkeys(KINDS, measure))
    assert gate_run.INPUTS == INPUTS
    assert "lego.exr" in refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    assert measured == []
    assert gate_line(limits, tmp_path / "others", "--only", "worse", "speed", "--quiet") == 0
    assert {gate.kind for gate in measured} == {"worse", "speed"}


def test_a_gate_without_a_limit_fails_with_a_remedy(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(limits.read_text())
    data["kinds"]["images"]["settings"]["spp"] = 64
    limits.write_text(json.dumps(data))
    folder = limits.parent / "classes"
    stored = references(class_here())
    write_references(folder, References(**{**vars(stored), "kinds": {"worse": facts("worse")}}))
    names = ("speed.score", "images.lego.bias", "worse.all.psnr", "fairness.batches")
    assert gate_line(limits, tmp_path / "out", "--only", *names) == 4
    said = capsys.readouterr().out
    assert f"class {class_here()} has no references for it; renew with `python -m harness gate --renew --only" in said
    assert "measured with other settings" in said
    assert said.count("PASS") == 2


def test_both_questions_are_answered_apart(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    name = "changed.double.nerf"
    measuring[name] = Sample([0.01], "loss of step 3", limit=Limit(None, 1e-10))
    note = "changed, -0.030 ± 0.110 dB: not worse"
    measuring["worse.all.psnr"] = Sample([-0.03], limit=Limit(-0.1, None), note=note)
    assert gate_line(limits, tmp_path / "out", "--only", "changed", "worse") == 4
    said = capsys.readouterr().out
    assert f"Has anything changed? yes: {name}" in said
    assert f"Is it worse? {note}" in said
    answers = json.loads((tmp_path / "out" / "gate.json").read_text())["answers"]
    assert list(answers) == ["Has anything changed?", "Is it worse?"]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda file: file.unlink(), "there is no such file; make it with"),
        (lambda file: file.write_text("{"), "get it back from version control"),
        (lambda file: file.write_text("[]"), "damaged"),
        (lambda file: file.write_text('{"schema": 2}'), "schema 2"),
        (lambda file: file.write_text(file.read_text().replace('"high"', '"hihg"')), "damaged"),
        (lambda file: file.write_text(file.read_text().replace('"low": null', '"low": NaN', 1)), "JSON is malformed"),
        (lambda file: file.write_text(file.read_text().replace('"low": ', '"low": "a", "x": ', 1)), "damaged"),
    ],
)
def test_limits_that_cannot_be_read_are_bad_input(
    spoil: Callable[[Path], object], said: str, limits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(limits)
    out = tmp_path / "out"
    assert said in refused(capsys, "--limits", limits, "--out", out, "--quiet", command="gate")
    assert not out.exists()


def test_names_that_are_none_and_folders_in_use(
    limits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, "--limits", limits, "--only", "speed", "teapot", "--out", tmp_path / "out", command="gate")
    assert "'teapot'; known: changed worse images fairness speed" in said
    assert "in use" in refused(capsys, "--limits", limits, "--out", tmp_path, "--quiet", command="gate")
    lock = lock_folder(tmp_path / "two")
    said = refused(capsys, "--limits", limits, "--out", tmp_path / "two", "--quiet", command="gate")
    assert "in use by process" in said
    lock.release(remove=True)


def test_names_are_chosen_by_their_beginning() -> None:
    def names(*given: str) -> list[str]:
        return [gate.name for gate in gate_command.chosen(list(given))]

    assert names("speed.render") == ["speed.render.nerf", "speed.render.qnerf"]
    assert names("worse.nerf") == [f"worse.nerf.{score}" for score in ("psnr", "ssim", "depth_rmse")]
    assert gate_command.chosen(None) == gates()


def test_the_list_names_every_gate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gate", "--list"]) == 0
    said = capsys.readouterr().out
    assert all(gate.name in said for gate in gates())
    assert f"{FAMILY} gates" in said


def test_a_renewal_of_images_says_what_changed(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = read_limits(limits)
    brighter = {name: [1.2 * value for value in values] for name, values in measured_values().items()}
    monkeypatch.setattr(gate_run.images, "renew", lambda situation: brighter)
    monkeypatch.setattr(gate_run.images, "digest", lambda file: "")
    assert gate_line(limits, tmp_path / "out", "--renew", "--only", "images.lego") == 0
    old, new = (found.limits["images.lego.largest"].high for found in (before, read_limits(limits)))
    assert old is not None
    assert new == pytest.approx(1.2 * old, rel=1e-3)
    said = capsys.readouterr().out
    assert f"images.lego.largest:  … {old:.5g} →  … {new:.5g}" in said
    assert f"{len(brighter)} limits changed" in said


def test_a_gate_that_is_no_more_leaves_the_file_and_a_line_is_a_gate(limits: Path) -> None:
    found = read_limits(limits)
    stale = LimitsFile(found.kinds, {**found.values, "images.gone": [1.0, 2.0, 3.0]}, found.limits)
    renewed = stale.renewed("images", measured_values(), facts("images"), gates())
    assert "images.gone" not in renewed.values
    assert renewed.limits == found.limits
    lines = limits.read_text().splitlines()
    assert sum(line.startswith('  "images.lego.bias": {"low"') for line in lines) == 1


def test_the_committed_limits_are_those_that_follow_from_their_measurements() -> None:
    """A limit that was changed by hand would follow from nothing: it needs a renewal instead."""
    stored = read_limits(ROOT / gate_command.LIMITS)
    again = stored.renewed("images", {}, stored.kinds["images"], gates())
    for name, limit in again.limits.items():
        for side in ("low", "high", "detects"):
            old, new = getattr(stored.limits[name], side), getattr(limit, side)
            assert old == (None if new is None else pytest.approx(new, rel=1e-3, abs=1e-4)), name
    for gate in gates():
        if gate.kind == "images":
            assert stored.limit_of(gate)[1] == ""
