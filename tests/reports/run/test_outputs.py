"""Several outputs side by side: paired by scene, method and seed, and judged only where they are comparable."""

import html

import pytest

from harness.records.metric_table import METRICS
from reports.__main__ import main
from reports.page.grid import Entry
from reports.run.outputs import EVERYWHERE, against, facts_grid, headline, named, outputs_page, scores_grid, sentences
from tests.replacing import replace
from tests.reports.fake_run import fake_records
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts


def shifted(method, by):
    """Return a change of cells: the method's PSNR is higher everywhere, by a little more with each seed."""

    def change(cell):
        if cell.method != method or cell.status != "done":
            return cell
        return replace(cell, scores={**cell.scores, "psnr": cell.scores["psnr"] + by + 0.01 * cell.seed})

    return change


@pytest.fixture
def compared(whole, tmp_path):
    """Compare the run with every cell finished with a changed copy of itself."""

    def of(**options):
        outputs = named([replace(whole, out=tmp_path / "a"), fake_records(tmp_path / "b", **options)])
        return outputs, against(*outputs)

    return of


def test_equal_outputs_are_the_same_to_the_last_bit(compared):
    outputs, versus = compared()
    assert (versus.identical, versus.shared, versus.unshared, versus.unlike) == (18, 18, [], {})
    assert headline(outputs[0], [versus]) == "b has the same results as a, to the last bit"
    assert {row.difference for row in versus.rows.values() if row.difference is not None} == {0.0}
    judged = {(metric, budget) for _, _, metric, budget in versus.rows}
    every = {name for name, metric in METRICS.items() if not metric.optional}
    assert {metric for metric, budget in judged if budget == "steps"} == every
    along_training = {"psnr", "ssim", "rmse_linear"}
    assert {metric for metric, budget in judged if budget == "seconds"} == along_training


def test_a_change_is_found_where_it_is_and_as_large_as_it_is(compared):
    outputs, versus = compared(change_cell=shifted("qnerf", 1.0))
    row = versus.row(EVERYWHERE, "qnerf")
    assert row.difference == pytest.approx(1.01)
    assert row.chosen.verdict.phrase == "above 0, matters"
    assert versus.row("chair", "qnerf").difference == pytest.approx(1.01)
    assert versus.row(EVERYWHERE, "nerf").difference == 0.0
    assert versus.identical == 12
    title = "b against a: nerf the same, nerf_matched the same and qnerf +1.01 dB (above 0, matters)"
    assert headline(outputs[0], [versus]) == title


@pytest.mark.parametrize("fact", ["processor", "waiting"])
def test_seconds_of_another_machine_or_clock_are_not_compared(compared, fact):
    def elsewhere(run):
        return replace(run, provenance={**run.provenance, fact: "another"})

    outputs, versus = compared(change=elsewhere)
    assert not versus.same_clock
    assert {budget for *_, budget in versus.rows} == {"steps"}
    assert any("seconds are not compared" in sentence for sentence in sentences(outputs[0], [versus]))
    assert [column.small for column in scores_grid(outputs, [versus], "nerf").columns][-1] == "at equal steps"


def test_another_ground_truth_is_shown_and_not_judged(compared):
    def larger(cell):
        return replace(cell, settings={"view_set": {"width": 64}}) if cell.scene == "drums" else cell

    outputs, versus = compared(change_cell=larger)
    assert versus.unlike == {"drums": "None against 64 px wide"}
    assert {scene for scene, *_ in versus.rows} == {"chair"}
    assert "not judged" in " ".join(sentences(outputs[0], [versus]))


def test_a_lost_cell_is_counted_and_the_others_are_judged(compared):
    _, versus = compared(change_cell=shifted("qnerf", 1.0), with_diverged=True)
    row = versus.row(EVERYWHERE, "qnerf")
    assert (row.chosen.verdict.sign, row.unpaired, row.pairs) == ("above 0", 1, 5)


def test_cells_of_only_one_output_are_named_and_leave_the_others_paired(compared):
    outputs, versus = compared(seeds=2)
    assert len(versus.unshared) == 6
    assert versus.unshared[0] == "chair · nerf · seed 2 only in a"
    assert versus.row(EVERYWHERE, "nerf").unpaired == 0
    assert "and 3 more" in " ".join(sentences(outputs[0], [versus]))


def test_the_headline_states_the_scenes_and_cells_that_both_have(compared):
    outputs, versus = compared(scenes=("chair", "lego"))
    title = "b against a, only on chair, in the 9 of 27 cells that both have: nerf the same, nerf_matched the same and"
    assert headline(outputs[0], [versus]).startswith(title)


def test_outputs_without_a_common_cell_say_so(compared):
    outputs, versus = compared(scenes=("lego", "mic"))
    assert versus.shared == 0
    assert headline(outputs[0], [versus]) == "b and a have no cell in common"
    text = outputs_page([output.records for output in outputs])[1]
    assert "not compared" not in text.split("<main>")[0].split("</h1>")[0]


def test_names_are_as_short_as_possible(whole, tmp_path):
    outputs = named([replace(whole, out=tmp_path / name) for name in ("x/run", "y/run", "z")])
    assert [(output.letter, output.name) for output in outputs] == [("A", "x/run"), ("B", "y/run"), ("C", "z")]


def test_settings_that_differ_are_named_and_no_others(compared):
    outputs, _ = compared(change=lambda run: replace(run, settings={**run.settings, "profile": "full"}))
    assert facts_grid(outputs, "settings", "").rows == [[Entry("profile"), Entry("reduced"), Entry("full")]]
    assert facts_grid(outputs, "provenance", "").rows == []


def test_the_page_is_well_formed_and_escapes_hostile_words(whole, tmp_path):
    def renamed(cell):
        return replace(cell, method=HOSTILE, reason=HOSTILE) if cell.method == "qnerf" else cell

    run = replace(whole.run, command=HOSTILE)
    hostile = replace(whole, out=tmp_path / "b", run=run, cells=[renamed(cell) for cell in whole.cells])
    _, text = outputs_page([replace(whole, out=tmp_path / "a"), hostile])
    outline = Outline(text)
    assert foreign_scripts(text) == []
    assert HOSTILE in html.unescape(text)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)


def test_the_command_writes_one_page_and_its_exit_code_is_about_all(tmp_path, capsys):
    a, b = (str(fake_records(tmp_path / name, with_diverged=name == "b").out) for name in "ab")
    assert main([a, b]) == 3
    assert capsys.readouterr().out.startswith("b against a: nerf the same, nerf_matched the same and qnerf ")
    assert (tmp_path / "a" / "outputs.html").is_file()
    assert not (tmp_path / "b" / "outputs.html").exists()
    assert main([a, a]) == 2
    assert main([a, b, "--publish", str(tmp_path)]) == 2
    assert main([a, str(tmp_path / "nothing")]) == 2
    said = capsys.readouterr().err
    assert "named twice" in said
    assert "no such folder" in said
