"""References of a class of processor: read, renewed, missing, and whether their order predicts that of a run."""

import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from msgspec import structs

from harness.__main__ import main
from harness.command import gate_command
from harness.gate import gate_run
from harness.gate.gate_context import GateContext
from harness.gate.gates import WIDER
from harness.gate.limits import unfit, write_stored
from harness.gate.references import RANK_FILE, References, publish, ranks, read_references
from harness.machine.processor_class import class_here
from harness.records.study import read_studies
from tests.harness.gate.gate_runs import gate_line, references
from tests.harness.shell import refused

ROOT = Path(__file__).parents[3]


def test_a_class_without_references_is_held_to_the_usual_one_and_told_so(
    limits: Path, tmp_path: Path, measuring: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = limits.parent / "classes"
    (folder / f"{class_here()}.json").unlink()
    assert "avx2.json" in refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    write_stored(folder / "avx2.json", references("avx2"))
    if class_here() != "avx2":
        assert gate_line(limits, tmp_path / "others") == 0
        assert "of which nothing is stored: held to avx2 with wider limits" in capsys.readouterr().out
        settings = read_studies(tmp_path / "others" / "gate.json").settings
        assert (settings["class"], settings["references"]) == (class_here(), "avx2")
    assert "can be measured as" in refused(
        capsys, "--limits", limits, "--class", "avx1024", "--out", tmp_path / "no", "--quiet", command="gate"
    )


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda text: "{", "truncated"),
        (lambda text: text.replace('"schema": 1', '"schema": 7'), "schema 7"),
        (lambda text: text.replace('"psnr": [20.0', '"psnr": ["a"'), "cells"),
        (lambda text: text.replace('"profiles"', '"known": false, "profiles"'), "known"),
        (lambda text: text.replace("[0.25]", "[NaN]"), "JSON is malformed"),
        (lambda text: text.replace(f'"name": "{class_here()}"', '"name": "other"'), "'other'"),
    ],
)
def test_references_that_cannot_be_read_are_bad_input(
    spoil: Callable[[str], str], words: str, limits: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = limits.parent / "classes" / f"{class_here()}.json"
    stored = references(class_here())
    assert read_references(file.parent, class_here()) == stored
    file.write_text(spoil(file.read_text()))
    message = refused(capsys, "--limits", limits, "--out", tmp_path / "out", "--quiet", command="gate")
    assert words in message
    assert str(file) in message


def test_a_renewal_writes_what_it_measured_class_by_class(
    limits: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def renew(context: GateContext) -> References:
        asked.append(context.references.name)
        return structs.replace(context.references, speed={"speed.score": [3.0, 3.1]})

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
    assert [unfit(kind, stored.kinds) for kind in WIDER] == [""] * 3


OURS = {("lego", "nerf"): 20.0, ("lego", "qnerf"): 18.0, ("hotdog", "nerf"): 25.0, ("hotdog", "qnerf"): 26.0}


@pytest.mark.parametrize(
    ("theirs", "wanted"),
    [
        ({key: 2 * value + 1 for key, value in OURS.items()}, (1.0, 1.0, 2)),
        ({key: -value for key, value in OURS.items()}, (-1.0, -1.0, 0)),
        # ranks 2 1 3 4 against 1 2 3 4: Spearman 1 − 6 · 2 / (4 · 15), Kendall (5 − 1) / 6
        ({**OURS, ("lego", "nerf"): 17.0}, (0.8, 0.667, 1)),
    ],
)
def test_the_same_order_the_reverse_and_one_pair_that_changed_places(
    theirs: dict[tuple[str, str], float], wanted: tuple[float, float, int]
) -> None:
    both = pd.DataFrame({"gate": pd.Series(OURS), "run": pd.Series(theirs)})
    spearman, kendall, same = wanted
    assert ranks(both) == {"spearman": spearman, "kendall": kendall, "pairs": 4, "compared": 2, "same_order": same}


def summary(folder: Path, scale: float = 1.0) -> Path:
    cells = [
        {"scene": scene, "method": method, "seed": seed, "status": "done", "psnr": scale * value}
        for (scene, method), value in OURS.items()
        for seed in (0, 1)
    ]
    cells.append({"scene": "lego", "method": "nerf", "seed": 2, "status": "diverged", "psnr": None})
    folder.mkdir()
    data = {"profile": "reduced", "provenance": {"commit": "abc"}, "cells": cells}
    (folder / "summary.json").write_text(json.dumps(data))
    return folder


def test_a_run_is_compared_and_published(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = {f"{scene}/{method}/1000": {"psnr": [value]} for (scene, method), value in OURS.items()}
    write_stored(tmp_path / "classes" / "avx2.json", References("avx2", cells=cells))
    run = summary(tmp_path / "run", scale=1.5)
    words = publish(run, tmp_path)
    assert "Spearman 1.00, Kendall 1.00 over 4 pairs" in words
    data = json.loads((tmp_path / RANK_FILE).read_text())
    assert data["run"] == {"profile": "reduced", "commit": "abc"}
    assert data["scores"][0] == {"scene": "hotdog", "method": "nerf", "gate": 25.0, "run": 37.5}
    assert main(["gate", "--rank", str(run), "--limits", str(tmp_path / "limits.json")]) == 0
    (run / "summary.json").write_text('{"cells": []}')
    assert "no summary" in refused(capsys, "--rank", run, "--limits", tmp_path / "limits.json", command="gate")
