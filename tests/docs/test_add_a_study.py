"""docs/add-a-study.md: its example is a working study."""

import importlib.util
import re
from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.study import read_studies
from harness.studies.evidence.evidence_studies import STUDIES
from harness.studies.framework import Shelf, asking
from reports.__main__ import main as report

DOCS = Path(__file__).parents[2] / "docs"


def test_the_example_runs_by_its_line_and_has_a_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (DOCS / "add-a-study.md").read_text(encoding="utf-8")
    line = re.search(r"```python\n(asking\(.*?\))\n```", text, re.DOTALL)
    study = eval(line[1], {"asking": asking})
    file, _, function = study.measure.partition(":")
    spec = importlib.util.spec_from_file_location(file, DOCS / "examples" / f"{file}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(STUDIES, study.info.id, study)
    monkeypatch.setattr(Shelf, "measure_of", lambda shelf, name: getattr(module, function))
    out = tmp_path / "mine"
    assert main(["evidence", "--quiet", "--studies", study.info.id, "--out", str(out)]) == 0
    (record,) = read_studies(out / "evidence.json").studies
    assert (record.info.question, len(record.answers), len(record.series)) == (study.info.question, 1, 2)
    assert [(check.status, check.value is not None) for check in record.checks] == [("pass", True)]
    assert report([str(out), "--quiet"]) == 0
    page = (out / "evidence.html").read_text(encoding="utf-8")
    assert study.info.question in page
    assert record.answers[0] in page
