"""A method whose library is missing: shown with its reason, not counted as a failure, no effect on other methods."""

import pytest

from reports.__main__ import main
from reports.claims.headline import headline
from reports.claims.psnr_table import scores_grid
from reports.data.load import Records
from reports.run.metrics_table import metrics_grid
from tests.replacing import replace
from tests.reports.fake_run import METHODS, fake_records

REASON = "no shared library of LLVM 16 or newer"


def absent(cell):
    if cell.method != "voxels_drjit":
        return cell
    return replace(cell, status="not_available", reason=REASON, steps=0, train_seconds=0.0,
                   scores=dict.fromkeys(cell.scores), curve=[], views=[], trace={}, pictures=None)  # fmt: skip


@pytest.fixture(scope="module")
def lacking(tmp_path_factory) -> Records:
    methods = {**METHODS, "voxels_drjit": "explicit voxels"}
    return fake_records(tmp_path_factory.mktemp("lacking") / "run", methods=methods, change_cell=absent)


def test_it_is_not_a_failure_and_the_page_says_it_once_on_the_first_screen(lacking, capsys):
    assert lacking.failed == []
    assert lacking.not_available == {"voxels_drjit": {REASON: 6}}
    assert main([str(lacking.out)]) == 0
    assert f"voxels_drjit: not available ({REASON})" in capsys.readouterr().out.splitlines()
    text = (lacking.out / "report.html").read_text(encoding="utf-8")
    top = text[: text.index("<nav")]
    assert "voxels_drjit was not available</b> in 6 of 24 cells, which is not a failure: " + REASON in top
    assert "did not finish" not in top


def test_tables_state_the_reason_without_alarm(lacking):
    row = scores_grid(lacking).rows[0]
    entry = row[2 + lacking.methods.index("voxels_drjit")]
    assert (entry.text, entry.small, entry.tone) == ("3 of 3 not available", REASON, "muted")
    named = next(row[1] for row in metrics_grid(lacking).rows if row[1].text == "voxels_drjit")
    assert (named.small, named.tone) == ("3 of 3 not available", "muted")


def test_the_others_keep_their_averages(lacking, whole):
    assert scores_grid(lacking).totals[0][2:5] == scores_grid(whole).totals[0][2:5]
    said = headline(lacking).sentences[0]
    assert said == headline(whole).sentences[0]
    assert "voxels_drjit" not in said


def test_an_unavailable_contender_has_no_verdict(lacking):
    cells = [replace(cell, status="not_available", reason=REASON) if cell.method == "qnerf" else cell
             for cell in lacking.cells]  # fmt: skip
    title = headline(replace(lacking, cells=cells)).title
    assert title == "qnerf was not available: nothing can be said of it"
