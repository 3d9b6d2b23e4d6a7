"""References: renewed, by committed code only."""

import re
import subprocess
from pathlib import Path

import pytest
from msgspec import structs

from harness.gate import gate_run, gate_speed
from harness.gate.gate_context import REFERENCED
from harness.gate.limits import read_stored, unfit, write_stored
from harness.gate.references import REFERENCES_FILE, References
from harness.machine.processor_class import class_here
from harness.machine.provenance import committed
from scenes.files.errors import InputError
from tests.harness.gate.gate_runs import gate_line, references
from tests.harness.shell import refused


def test_a_renewal_writes_what_it_measured_and_of_which_commit(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gate_run, "committed", lambda: "0123456789ab")
    monkeypatch.setattr(gate_speed, "renew", lambda context: {"speed.score": [3.0, 3.1]})
    cells = {"lego/nerf/1000": {"psnr": [30.0]}}
    monkeypatch.setattr(gate_run, "RENEWALS", {"worse": lambda given: structs.replace(given.references, cells=cells)})
    assert read_stored(limits.parent / REFERENCES_FILE, References) == references()
    before = structs.replace(references(), speed={"avx1024": references().speed[class_here()]})
    write_stored(limits.parent / REFERENCES_FILE, before)
    assert gate_line(limits, tmp_path / "out", "--renew", "--only", "speed.train.nerf", "worse", "fairness") == 0
    after = read_stored(limits.parent / REFERENCES_FILE, References)
    assert after.speed[class_here()].gates == {"speed.score": [3.0, 3.1]}
    assert after.speed["avx1024"] == before.speed["avx1024"], "another class keeps its own"
    assert (after.cells, after.courses) == (cells, before.courses)
    for facts in (after.kinds["worse"], after.speed[class_here()].facts):
        assert facts.provenance["commit"] == "0123456789ab"
        assert facts.provenance["processor"]
    assert "speed: renewed in" in capsys.readouterr().out


def test_references_are_of_committed_code_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("GIT_AUTHOR", "GIT_COMMITTER"):
        monkeypatch.setenv(f"{name}_NAME", "name")
        monkeypatch.setenv(f"{name}_EMAIL", "name@example.org")
    checkout = tmp_path / "checkout"
    (checkout / "gates").mkdir(parents=True)
    for file in ("code.py", "gates/limits.json"):
        (checkout / file).write_text("1")
    for words in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "first"]):
        subprocess.run(["git", *words], cwd=checkout, check=True)
    name = committed(checkout)
    assert len(name) == 12
    (checkout / "gates" / "limits.json").write_text("2")
    assert committed(checkout / "gates") == name, "what a renewal of another kind has written"
    for file in ("more.py", "code.py"):
        (checkout / file).write_text("3")
        with pytest.raises(InputError, match=f"of committed code only; commit or remove {file}$"):
            committed(checkout)
        (checkout / "more.py").unlink(missing_ok=True)
    with pytest.raises(InputError, match="git knows no commit here"):
        committed(tmp_path)


def test_a_renewal_of_changed_code_is_refused_before_anything_is_written(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse() -> str:
        raise InputError("--renew: references are of committed code only; commit or remove a.py")

    monkeypatch.setattr(gate_run, "committed", refuse)
    out = tmp_path / "out"
    message = refused(capsys, "--limits", limits, "--out", out, "--renew", "--quiet", command="gate")
    assert "commit or remove a.py" in message
    assert not out.exists()


def test_the_committed_references_are_of_these_gates(stored: References) -> None:
    of_speed = [speed.facts for speed in stored.speed.values()]
    assert {unfit(kind, stored.kinds) for kind in REFERENCED} == {""}
    assert {unfit("speed", {"speed": facts}) for facts in of_speed} == {""}
    for facts in (*stored.kinds.values(), *of_speed):
        assert re.fullmatch("[0-9a-f]{12}", facts.provenance["commit"])
