"""`python -m harness study stability`: the table of cases, its options, and a case that trains in the folder."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.study import CHAPTERS, check, read_studies
from harness.run_folder.integrity import repair
from harness.studies.framework import Found, Shelf
from harness.studies.stability.cases import CASES
from harness.studies.stability.stability_context import METHODS, StabilityContext
from tests.harness import shell


def test_every_case_has_its_facts() -> None:
    assert len(CASES) == 39
    for case in CASES.values():
        assert all(case.info.facts[name] for name in ("input", "danger", "reference"))
    assert list(CHAPTERS) == list(range(1, len(CHAPTERS) + 1))


refused = partial(shell.refused, command="stability")


def trains_in_the_same_folder(context: StabilityContext) -> Iterator[Found]:
    repair(context.out, context.plan("smoke"), lambda line: None)
    assert context.scratch.is_dir()
    yield check("a figure", 0.5, high=1.0)


def test_a_training_that_repairs_the_folder_keeps_the_scratch_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Shelf, "measure_of", lambda shelf, name: trains_in_the_same_folder)
    options = ["stability", "--quiet", "--out", str(tmp_path / "out"), "--studies", "Q1"]
    assert main(options) == 0
    record = read_studies(tmp_path / "out/stability.json")
    assert record.settings["methods"] == list(METHODS)
    assert "was made with other options" in refused(capsys, *options[1:], "--resume", "--methods", "nerf")
    (tmp_path / "out/stability.json").write_text("{", encoding="utf-8")  # damaged, and moved away
    assert main([*options, "--resume"]) == 0
    assert read_studies(tmp_path / "out/stability.json").studies[0].checks == record.studies[0].checks
