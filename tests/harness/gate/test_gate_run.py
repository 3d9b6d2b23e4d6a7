"""`python -m harness gate` with given measurements: outcomes, files, messages and exit codes."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from msgspec import structs

from harness.command import gate_command
from harness.command.main import main
from harness.gate import gate_run, images
from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import KINDS, TRAINED_SCENES, gates
from harness.gate.limits import LimitsFile, read_stored, write_stored
from harness.gate.references import REFERENCES_FILE
from harness.machine.processor_class import class_here
from harness.records.study import Check, read_studies
from harness.run_folder.folder_lock import lock_folder
from tests.harness.gate.gate_runs import CENTRE, GATES, LIMITED, MODULES, facts, gate_line, references, sound
from tests.harness.shell import refused

Capture = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch
FAMILY = len(gates())
Measuring = dict[str, tuple[list[float | None], str]]


def checks_of(out: Path) -> dict[str, Check]:
    return {check.id: check for _, check in read_studies(out / "gate.json").checks()}


def test_all_pass(limits: Path, tmp_path: Path, measuring: Measuring, capsys: Capture) -> None:
    out = tmp_path / "out"
    assert gate_line(limits, out) == 0
    assert capsys.readouterr().out.count(": pass: ") == FAMILY
    record = read_studies(out / "gate.json")
    assert [study.info.id for study in record.studies] == list(KINDS)
    assert record.settings["class"] == class_here()
    assert [(name, check.status) for name, check in checks_of(out).items()] == [(gate.name, "pass") for gate in gates()]
    top = ElementTree.parse(out / "junit.xml").getroot()
    assert (top.get("tests"), top.get("failures")) == (str(FAMILY), "0")
    assert [case.get("name") for case in top.iter("testcase")] == [gate.name for gate in gates()]
    assert sorted(file.name for file in out.iterdir()) == ["gate.json", "junit.xml"]


def test_a_failure_is_reported_everywhere(limits: Path, tmp_path: Path, measuring: Measuring, capsys: Capture) -> None:
    name = "images.lego.bias"
    measuring[name] = ([20.0] * 16, "darker")
    out = tmp_path / "out"
    assert gate_line(limits, out, "--only", "images.lego") == 4
    printed = capsys.readouterr().out
    limit = read_stored(limits, LimitsFile).limits[name]
    line = next(line for line in printed.splitlines() if "FAIL" in line)
    assert f"20 % (at least {limit.low:.3g}, at most {limit.high:.3g}); darker; detects {limit.detects:.3g} %" in line
    replay = f"replay: python -m harness gate --limits {limits} --only {name}"
    assert replay in printed
    top = ElementTree.parse(out / "junit.xml").getroot()
    assert top.get("failures") == "1"
    failure = next(top.iter("failure"))
    assert "20 %" in str(failure.get("message"))
    assert replay in str(failure.text)
    check = checks_of(out)[name]
    assert (check.status, check.value, check.low, check.high) == ("fail", 20.0, limit.low, limit.high)


@pytest.mark.parametrize("why", ["RuntimeError: rendering ended with exit code 1", "it was not measured"])
def test_an_error_in_one_kind_or_a_missing_measurement_fails_its_gates_and_no_others(
    why: str, limits: Path, tmp_path: Path, measuring: Measuring, monkeypatch: Patch
) -> None:
    def broken(context: GateContext) -> Iterator[Check]:
        yield sound(context.of_kind("images")["images.lego.bias"], context.limits)
        if "exit code" in why:
            raise RuntimeError("rendering ended with exit code 1")

    monkeypatch.setattr(images, "measure", complete("images")(broken))
    assert gate_line(limits, tmp_path / "out", "--quiet") == 4
    failed = {name: check for name, check in checks_of(tmp_path / "out").items() if check.is_broken}
    assert failed.keys() == {gate.name for gate in gates() if gate.kind == "images"} - {"images.lego.bias"}
    assert {(check.value, check.why) for check in failed.values()} == {(None, why)}


def test_a_missing_reference_image_is_reported_before_any_measurement(
    limits: Path, tmp_path: Path, monkeypatch: Patch, capsys: Capture
) -> None:
    measured: list[str] = []
    for kind in KINDS:
        monkeypatch.setattr(MODULES[kind], "measure", lambda context, kind=kind: iter(measured.append(kind) or ()))
    assert "lego.exr" in refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    assert measured == []
    assert gate_line(limits, tmp_path / "others", "--only", "worse", "speed", "--quiet") == 0
    assert measured == ["worse", "speed"]


def test_a_missing_limit_names_its_remedy(limits: Path, tmp_path: Path, measuring: Measuring, capsys: Capture) -> None:
    data = json.loads(limits.read_text())
    data["kinds"]["images"]["settings"]["spp"] = 64
    limits.write_text(json.dumps(data))
    stored = structs.replace(references(), kinds={"worse": facts("worse")})
    write_stored(limits.parent / REFERENCES_FILE, stored)
    names = ("changed.settings", "images.lego.bias", "worse.all.psnr", "fairness.batches")
    assert gate_line(limits, tmp_path / "out", "--only", *names) == 4
    printed = capsys.readouterr().out
    assert "nothing is stored for it; renew with `python -m harness gate --renew --only changed`" in printed
    assert (
        "measured with other settings of the gate; renew with `python -m harness gate --renew --only images`" in printed
    )
    assert printed.count(": pass: ") == 2
    assert checks_of(tmp_path / "out")["images.lego.bias"].value == pytest.approx(CENTRE)


def test_both_questions_are_answered_apart(limits: Path, tmp_path: Path, measuring: Measuring, capsys: Capture) -> None:
    name = "changed.double.nerf"
    measuring[name] = ([0.01], "loss of step 3")
    note = "changed, -0.030 ± 0.110 dB: not worse"
    measuring["worse.all.psnr"] = ([CENTRE], note)
    assert gate_line(limits, tmp_path / "out", "--only", "changed", "worse") == 4
    printed = capsys.readouterr().out
    answers = [answer for study in read_studies(tmp_path / "out" / "gate.json").studies for answer in study.answers]
    assert answers == [f"Has anything changed? yes: {name}", f"Is it worse? {note}"]
    assert all(answer in printed for answer in answers)


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("limits.json", lambda text: None, "there is no such file; get it back from version control, or make it with"),
        ("limits.json", lambda text: "{", "get it back from version control"),
        ("limits.json", lambda text: '{"schema": 2}', "schema 2"),
        ("limits.json", lambda text: text.replace('"low": null', '"low": NaN', 1), "JSON is malformed"),
        ("limits.json", lambda text: text.replace('"low": ', '"low": "a", "x": ', 1), "float"),
        ("limits.json", lambda text: text.replace('"limits": {', '"limits": {"a": {"low": null, "high": null}, '),
         "neither"),
        (REFERENCES_FILE, lambda text: text.replace('"psnr": [20.0', '"psnr": ["a"'), "cells"),
        (REFERENCES_FILE, lambda text: text.replace('"profiles"', '"known": false, "profiles"'), "known"),
        (REFERENCES_FILE, lambda text: text.replace("[0.25]", "[NaN]"), "JSON is malformed"),
    ],
)  # fmt: skip
def test_stored_files_that_cannot_be_read_are_bad_input(
    name: str, spoil: Callable[[str], str | None], message: str, limits: Path, tmp_path: Path,
    capsys: Capture,
) -> None:  # fmt: skip
    file, out = limits.parent / name, tmp_path / "out"
    content = spoil(file.read_text())
    file.unlink() if content is None else file.write_text(content)
    line = refused(capsys, "--limits", limits, "--out", out, "--quiet", command="gate")
    assert message in line
    assert str(file) in line
    assert not out.exists()


def test_unknown_names_and_folders_in_use_are_refused(limits: Path, tmp_path: Path, capsys: Capture) -> None:
    only = ("--limits", limits, "--only", "speed", "--quiet", "--out")
    message = refused(capsys, *only, tmp_path / "out", "--only", "speed", "teapot", command="gate")
    assert "'teapot'; known: changed worse families images fairness speed" in message
    assert "in use; name another one\n" in refused(capsys, *only, tmp_path, command="gate"), "gates are not resumed"
    lock = lock_folder(tmp_path / "two")
    message = refused(capsys, *only, tmp_path / "two", command="gate")
    assert "in use by process" in message
    lock.release(remove=True)


def test_names_are_chosen_by_their_beginning() -> None:
    of_nerf = [gate.name for gate in gate_command.chosen(["worse.nerf"])]
    of_scenes = [f"{scene}.psnr" for scene in TRAINED_SCENES]
    assert of_nerf == [f"worse.nerf.{score}" for score in ("psnr", "ssim", "depth_rmse", *of_scenes)]


def test_the_list_names_every_gate(capsys: Capture) -> None:
    assert main(["gate", "--list"]) == 0
    printed = capsys.readouterr().out
    assert all(gate.name in printed for gate in gates())
    assert f"{FAMILY} gates" in printed


def test_renewing_images_says_what_changed(limits: Path, tmp_path: Path, monkeypatch: Patch, capsys: Capture) -> None:
    before = read_stored(limits, LimitsFile)
    of_images = {name: values for name, values in before.values.items() if name.startswith("images.")}
    brighter = {name: [1.2 * value for value in values] for name, values in of_images.items()}
    monkeypatch.setitem(gate_run.RENEWED_LIMITS, "images", lambda context: brighter)
    monkeypatch.setattr(gate_run, "file_digest", lambda file: "")
    monkeypatch.setattr(gate_run, "committed", lambda: "0123456789ab")
    assert gate_line(limits, tmp_path / "out", "--renew", "--only", "images.lego") == 0
    old, new = (file.limits["images.lego.largest"].high for file in (before, read_stored(limits, LimitsFile)))
    assert new == pytest.approx(1.2 * old, rel=1e-3)
    printed = capsys.readouterr().out
    assert f"images.lego.largest:  … {old:.5g} →  … {new:.5g}" in printed
    assert f"{len(brighter)} limits changed" in printed


def test_a_gate_that_is_no_more_leaves_the_file_and_a_line_is_a_gate(limits: Path) -> None:
    stored = read_stored(limits, LimitsFile)
    stale = structs.replace(stored, values={**stored.values, "images.gone": [1.0, 2.0, 3.0]})
    assert stale.renewed("images", {}, facts("images")) == stored
    lines = limits.read_text().splitlines()
    assert sum(line.startswith('  "images.lego.bias": {"low"') for line in lines) == 1


def test_the_committed_limits_are_those_that_follow_from_their_measurements() -> None:
    """A limit must not be changed by hand, but by a renewal."""
    stored = read_stored(GATES / "limits.json", LimitsFile)
    again = stored.renewed("images", {}, stored.kinds["images"])
    for name, limit in again.limits.items():
        for side in ("low", "high", "detects"):
            old, new = getattr(stored.limits[name], side), getattr(limit, side)
            assert old == (None if new is None else pytest.approx(new, rel=1e-3, abs=1e-4)), name
    for gate in gates():
        if gate.kind in LIMITED:
            assert stored.limit_of(gate) == stored.limits[gate.name]
