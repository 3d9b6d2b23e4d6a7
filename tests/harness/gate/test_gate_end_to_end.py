"""The committed limits, on this machine: this code passes, and what is broken on purpose does not."""

from pathlib import Path

import numpy as np
import pytest

from harness import trainer
from harness.__main__ import main
from harness.gate import images, options
from harness.gate.images import Renders
from tests.harness.trained_runs import in_this_process

ROOT = Path(__file__).parents[3]
GATES = ("training.lego.nerf", "images.materials", "fairness.first_weights", "fairness.copies.nerf")


@pytest.mark.thorough
@pytest.mark.slow
def test_sound_code_passes_and_broken_code_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("harness.runner.run_locally", in_this_process)

    def gate(out: str, *names: str) -> int:
        places = ["--limits", str(ROOT / options.LIMITS), "--view-sets", str(tmp_path / "view_sets")]
        return main(["gate", "--only", *names, *places, "--out", str(tmp_path / out)])

    assert gate("sound", *GATES) == 0, capsys.readouterr().out
    assert (tmp_path / "sound" / "junit.xml").exists()
    assert not (tmp_path / "sound" / "renders").exists()

    rate, rendered = trainer.learning_rate, images.rendered
    monkeypatch.setattr(trainer, "learning_rate", lambda *facts: 0.2 * rate(*facts))

    def brighter(*given: object) -> Renders:
        return {scene: image * np.array([1.002, 1.002, 1.002, 1.0]) for scene, image in rendered(*given).items()}  # type: ignore[arg-type]

    monkeypatch.setattr(images, "rendered", brighter)
    capsys.readouterr()
    assert gate("broken", *GATES) == 4
    failed = {line.split()[1] for line in capsys.readouterr().out.splitlines() if line.startswith("FAIL")}
    assert {"training.lego.nerf.psnr", "images.materials.bias"} <= failed
    assert not any(name.startswith("fairness") for name in failed)
    for name in failed:
        files = sorted(file.name for file in (tmp_path / "broken" / "failed" / name).iterdir())
        assert files == ["difference.png", "image.png", "reference.png"]
