"""This code passes the committed limits on this machine, and deliberately broken code does not."""

from pathlib import Path

import numpy as np
import pytest

from harness.command.main import main
from harness.gate import gate_run, images
from harness.gate.images import Renders
from harness.records.study import read_studies
from tests.harness.gate.gate_runs import GATES as STORED
from tests.harness.gate.mutations import MUTATIONS
from tests.harness.patching import changed

GATES = ("changed.double.nerf", "images.materials", "fairness.first_weights", "fairness.copies.nerf")


@pytest.mark.thorough
@pytest.mark.slow
def test_sound_code_passes_and_broken_code_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def gate(out: str, *names: str) -> int:
        places = ["--limits", str(STORED / "limits.json"), "--view-sets", str(tmp_path / "view_sets")]
        return main(["gate", "--only", *names, *places, "--out", str(tmp_path / out)])

    assert gate("sound", *GATES) == 0, capsys.readouterr().out
    assert (tmp_path / "sound" / "junit.xml").exists()
    assert sorted(file.name for file in (tmp_path / "sound").iterdir()) == ["gate.json", "junit.xml"]

    monkeypatch.setattr(gate_run, "in_child", lambda function, *given: function(*given))
    MUTATIONS["optimiser", "learning rate", "× 1.01"](monkeypatch)

    def brighter(renders: Renders, *_: object) -> Renders:
        return {scene: image * np.array([1.002, 1.002, 1.002, 1.0]) for scene, image in renders.items()}

    changed(monkeypatch, images, "rendered", brighter)
    assert gate("broken", *GATES) == 4
    failed = {check.id for _, check in read_studies(tmp_path / "broken" / "gate.json").broken}
    assert {"changed.double.nerf", "images.materials.bias"} <= failed
    assert not any(name.startswith("fairness") for name in failed)
    for name in failed - {"changed.double.nerf"}:
        files = sorted(file.name for file in (tmp_path / "broken" / "failed" / name).iterdir())
        assert files == ["difference.png", "image.png", "reference.png"]
