"""`python -m harness gate` with measurements that the test gives: outcomes, files, words and exit codes."""

import json
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from harness.__main__ import main
from harness.folder_lock import lock_folder
from harness.gate import options, runner
from harness.gate.catalog import KINDS, Gate, gates, settings_of
from harness.gate.limits import EXACT
from harness.gate.limits_file import KindFacts, LimitsFile, read_limits, write_limits
from harness.gate.outcome import Pictures, Sample
from harness.gate.situation import Situation
from scenes.images import read_image
from tests.harness.shell import refused

CENTRE = 25.0
FAMILY = len(gates())
ROOT = Path(__file__).parents[3]
INPUTS = dict(runner.INPUTS)


def measured_values(kind: str) -> dict[str, list[float]]:
    """As a renewal gives them: 12 values about 25, or their logarithms about its."""
    generator = np.random.default_rng(1)
    return {
        gate.name: (CENTRE + 0.1 * generator.standard_normal(12)).tolist()
        for gate in gates()
        if gate.rule not in EXACT and (gate.kind == kind or (gate.rule == "null" and kind == "training"))
    }


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    found = LimitsFile()
    for kind in ("training", "images", "speed"):
        found = found.renewed(kind, measured_values(kind), KindFacts(settings_of(kind), {}, 1.0), gates())  # type: ignore[arg-type]
    file = tmp_path / "gates" / "limits.json"
    write_limits(file, found, FAMILY)
    return file


def sound(gate: Gate) -> Sample:
    value = {"none_differs": 0.0, "null": 0.01, "false_calls": 0.05, "found": 0.8}.get(gate.rule, CENTRE)
    picture = np.full((4, 4, 3), 0.25)
    return Sample([value] * gate.new, pictures=Pictures(picture, 2 * picture, picture))


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> dict[str, Sample]:
    """Gates that give something else than what is sound, by name."""
    changed: dict[str, Sample] = {}

    def measure(situation: Situation, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        return {gate.name: changed.get(gate.name, sound(gate)) for gate in of_kind}

    monkeypatch.setattr(runner, "MEASURES", dict.fromkeys(KINDS, measure))
    monkeypatch.setattr(runner, "INPUTS", {})
    return changed


def gate_command(limits: Path, out: Path, *others: str) -> int:
    return main(["gate", "--limits", str(limits), "--out", str(out), *others])


def test_all_pass(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    assert gate_command(limits, tmp_path / "out") == 0
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
    name = "training.lego.nerf.psnr"
    picture = np.linspace(0, 1, 48).reshape(4, 4, 3)
    measuring[name] = Sample([20.0, 20.0], pictures=Pictures(picture, 1 - picture, np.abs(1 - 2 * picture)))
    out = tmp_path / "out"
    assert gate_command(limits, out, "--only", "training.lego") == 4
    said = capsys.readouterr().out
    limit = read_limits(limits).limits[name]
    assert limit.low is not None
    line = next(one for one in said.splitlines() if one.startswith("FAIL"))
    assert "20 dB" in line
    assert f"excess {limit.low - 20:.3g} dB" in line
    assert f"{limit.low:.4g} … {limit.high:.4g} dB" in line
    assert f"replay: python -m harness gate --limits {limits} --only {name}" in said
    folder = out / "failed" / name
    assert str(folder) in said
    assert sorted(file.name for file in folder.iterdir()) == ["difference.png", "image.png", "reference.png"]
    assert np.allclose(read_image(folder / "image.png")[::6, ::6, :3], picture, atol=0.003)
    top = ElementTree.parse(out / "junit.xml").getroot()
    assert top.get("failures") == "1"
    failure = next(top.iter("failure"))
    assert "20 dB" in str(failure.get("message"))
    assert "replay: python -m harness gate" in str(failure.text)
    row = next(row for row in json.loads((out / "gate.json").read_text())["gates"] if row["name"] == name)
    assert (row["status"], row["measured"], row["excess"]) == ("fail", 20.0, pytest.approx(limit.low - 20.0))


@pytest.mark.parametrize("value", [float("nan"), None, float("inf")])
@pytest.mark.parametrize("name", ["training.drums.qnerf.ssim", "images.lego.largest", "speed.score"])
def test_what_is_no_number_fails_and_is_written_as_none(
    value: float | None, name: str, limits: Path, tmp_path: Path, measuring: dict[str, Sample]
) -> None:
    gate = next(one for one in gates() if one.name == name)
    measuring[name] = Sample([CENTRE] * (gate.new - 1) + [value], "seed 1001 diverged")
    assert gate_command(limits, tmp_path / "out", "--only", name, "--quiet") == 4
    row = json.loads((tmp_path / "out" / "gate.json").read_text())["gates"][0]
    assert (row["measured"], row["status"], row["why"]) == (None, "fail", "seed 1001 diverged")


def test_an_error_in_one_kind_fails_its_gates_and_no_others(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(situation: Situation, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        raise RuntimeError("rendering ended with exit code 1")

    monkeypatch.setitem(runner.MEASURES, "images", broken)
    assert gate_command(limits, tmp_path / "out", "--quiet") == 4
    rows = json.loads((tmp_path / "out" / "gate.json").read_text())["gates"]
    assert {row["kind"] for row in rows if row["status"] == "fail"} == {"images"}
    assert {row["why"] for row in rows if row["status"] == "fail"} == {"RuntimeError: rendering ended with exit code 1"}


def test_a_reference_image_that_is_missing_is_told_before_anything_is_measured(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured: list[Gate] = []

    def measure(situation: Situation, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        measured.extend(of_kind)
        return {gate.name: sound(gate) for gate in of_kind}

    monkeypatch.setattr(runner, "MEASURES", dict.fromkeys(KINDS, measure))
    assert runner.INPUTS == INPUTS
    assert "lego.exr" in refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    assert measured == []
    assert gate_command(limits, tmp_path / "others", "--only", "training", "speed", "--quiet") == 0
    assert {gate.kind for gate in measured} == {"training", "speed"}


def test_a_gate_without_a_limit_fails_with_a_remedy(
    limits: Path, tmp_path: Path, measuring: dict[str, Sample], capsys: pytest.CaptureFixture[str]
) -> None:
    data = json.loads(limits.read_text())
    del data["limits"]["speed.score"]
    data["kinds"]["images"]["settings"]["spp"] = 64
    limits.write_text(json.dumps(data))
    assert gate_command(limits, tmp_path / "out", "--only", "speed.score", "images.lego.bias", "speed.train.nerf") == 4
    said = capsys.readouterr().out
    assert "there is no limit for it; renew with `python -m harness gate --renew --only speed.score`" in said
    assert "measured with other settings" in said
    assert said.count("PASS") == 1


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda file: file.unlink(), "there is no such file; make it with"),
        (lambda file: file.write_text("{"), "get it back from version control"),
        (lambda file: file.write_text("[]"), "damaged"),
        (lambda file: file.write_text('{"schema": 2}'), "schema 2"),
        (lambda file: file.write_text(file.read_text().replace('"high"', '"hihg"')), "damaged"),
        (lambda file: file.write_text(file.read_text().replace('"low": null', '"low": NaN', 1)), "NaN is no number"),
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
    assert "'teapot'; known: training images fairness speed" in said
    assert "in use" in refused(capsys, "--limits", limits, "--out", tmp_path, "--quiet", command="gate")
    lock = lock_folder(tmp_path / "two")
    said = refused(capsys, "--limits", limits, "--out", tmp_path / "two", "--quiet", command="gate")
    assert "in use by process" in said
    lock.release()


def test_names_are_chosen_by_their_beginning() -> None:
    def names(*given: str) -> list[str]:
        return [gate.name for gate in options.chosen(list(given))]

    assert names("speed.render") == ["speed.render.nerf", "speed.render.qnerf"]
    assert names("training.lego.nerf") == [f"training.lego.nerf.{score}" for score in ("psnr", "ssim", "depth_rmse")]
    assert options.chosen(None) == gates()


def test_the_list_names_every_gate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gate", "--list"]) == 0
    said = capsys.readouterr().out
    assert all(gate.name in said for gate in gates())
    assert f"{FAMILY} gates, together at most 1% false alarms" in said


def test_a_renewal_writes_what_it_measured_and_says_what_changed(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = read_limits(limits)
    slower = {name: [1.2 * value for value in values] for name, values in measured_values("speed").items()}
    asked: list[str] = []

    def renew(situation: Situation, of_kind: tuple[Gate, ...]) -> dict[str, list[float]]:
        asked.extend(gate.name for gate in of_kind)
        return slower

    monkeypatch.setattr(runner, "RENEWALS", {**dict.fromkeys(("training", "images")), "speed": renew})
    assert gate_command(limits, tmp_path / "out", "--renew", "--only", "speed.train.nerf") == 0
    assert asked == list(slower), "a kind is renewed as a whole"
    after, said = read_limits(limits), capsys.readouterr().out
    assert after.limits["training.lego.nerf.psnr"] == before.limits["training.lego.nerf.psnr"]
    old, new = (found.limits["speed.score"].high for found in (before, after))
    assert old is not None
    assert new == pytest.approx(1.2 * old, rel=1e-3)
    assert f"speed.score:  … {old:.5g} →  … {new:.5g}" in said
    assert f"{len(slower)} limits changed" in said
    assert after.kinds["speed"].provenance["processor"]


def test_a_gate_that_is_no_more_leaves_the_file_and_a_line_is_a_gate(limits: Path) -> None:
    found = read_limits(limits)
    stale = LimitsFile(found.kinds, {**found.values, "speed.gone": [1.0, 2.0, 3.0]}, found.limits)
    renewed = stale.renewed("speed", measured_values("speed"), KindFacts(settings_of("speed"), {}, 1.0), gates())
    assert "speed.gone" not in renewed.values
    assert renewed.limits == found.limits
    lines = limits.read_text().splitlines()
    assert sum(line.startswith('  "speed.score": {"low"') for line in lines) == 1


def test_the_committed_limits_are_those_that_follow_from_their_measurements() -> None:
    """A limit that was changed by hand would be a limit without a rate: it needs a renewal instead."""
    stored = read_limits(ROOT / options.LIMITS)
    again = stored.renewed("speed", {}, stored.kinds["training"], gates())
    for name, limit in again.limits.items():
        for side in ("low", "high", "detects"):
            old, new = getattr(stored.limits[name], side), getattr(limit, side)
            assert old == (None if new is None else pytest.approx(new, rel=1e-3, abs=1e-4)), name
    for gate in gates():
        if gate.rule not in EXACT:
            assert stored.limit_of(gate, FAMILY)[1] == ""
