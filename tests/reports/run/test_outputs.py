"""Several outputs side by side: paired by scene, method and seed, and nothing judged that is not of one question."""

import html

import pytest

from harness.records.metric_table import METRICS
from reports.__main__ import main
from reports.page.grid import Entry
from reports.run.outputs import (
    EVERYWHERE,
    against,
    facts_grid,
    headline,
    named,
    outputs_page,
    scores_grid,
    sentences,
)
from tests.replacing import replace
from tests.reports.fake_run import fake_records
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts


def shifted(method, by):
    """A change of a run: a method's PSNR is higher everywhere, by a little more with each seed."""

    def change(cell):
        if cell.method != method or cell.status != "done":
            return cell
        return replace(cell, scores={**cell.scores, "psnr": cell.scores["psnr"] + by + 0.01 * cell.seed})

    return change


@pytest.fixture
def compared(whole, tmp_path):
    """The run with every cell finished against itself with something changed."""

    def of(**options):
        outputs = named([replace(whole, out=tmp_path / "a"), fake_records(tmp_path / "b", **options)])
        return outputs, against(*outputs)

    return of


def test_equal_outputs_are_the_same_to_the_last_bit(compared):
    outputs, found = compared()
    assert (found.identical, found.shared, found.alone, found.unlike) == (18, 18, [], {})
    assert headline(outputs[0], [found]) == "b has the same results as a, to the last bit"
    assert {row.difference for row in found.rows.values() if row.difference is not None} == {0.0}
    judged = {(metric, budget) for _, _, metric, budget in found.rows}
    every = {name for name, metric in METRICS.items() if not metric.optional}
    assert {metric for metric, budget in judged if budget == "steps"} == every
    along_training = {"psnr", "ssim", "rmse_linear"}
    assert {metric for metric, budget in judged if budget == "seconds"} == along_training


def test_a_change_is_found_where_it_is_and_as_large_as_it_is(compared):
    outputs, found = compared(change_cell=shifted("qnerf", 1.0))
    row = found.row(EVERYWHERE, "qnerf")
    assert row.difference == pytest.approx(1.01)
    assert row.chosen.verdict.phrase == "above 0, matters"
    assert found.row("chair", "qnerf").difference == pytest.approx(1.01)
    assert found.row(EVERYWHERE, "nerf").difference == 0.0
    assert found.identical == 12
    told = "b against a: nerf the same, nerf_matched the same and qnerf +1.01 dB (above 0, matters)"
    assert headline(outputs[0], [found]) == told


@pytest.mark.parametrize("fact", ["processor", "waiting"])
def test_seconds_of_another_machine_or_clock_are_not_compared(compared, fact):
    def elsewhere(run):
        return replace(run, provenance={**run.provenance, fact: "another"})

    outputs, found = compared(change=elsewhere)
    assert not found.same_clock
    assert {budget for *_, budget in found.rows} == {"steps"}
    assert any("seconds are not compared" in sentence for sentence in sentences(outputs[0], [found]))
    assert [column.small for column in scores_grid(outputs, [found], "nerf").columns][-1] == "at equal steps"


def test_another_ground_truth_is_shown_and_not_judged(compared):
    def larger(cell):
        return replace(cell, settings={"view_set": {"width": 64}}) if cell.scene == "drums" else cell

    outputs, found = compared(change_cell=larger)
    assert found.unlike == {"drums": "None against 64 px wide"}
    assert {scene for scene, *_ in found.rows} == {"chair"}
    assert "not judged" in " ".join(sentences(outputs[0], [found]))


def test_a_lost_cell_is_counted_and_the_others_are_judged(compared):
    _, found = compared(change_cell=shifted("qnerf", 1.0), with_diverged=True)
    row = found.row(EVERYWHERE, "qnerf")
    assert (row.chosen.verdict.sign, row.unpaired, row.pairs) == ("above 0", 1, 5)


def test_what_only_one_output_has_is_named_and_costs_the_others_nothing(compared):
    outputs, found = compared(seeds=2)
    assert len(found.alone) == 6
    assert found.alone[0] == "chair · nerf · seed 2 in a alone"
    assert found.row(EVERYWHERE, "nerf").unpaired == 0
    assert "and 3 more" in " ".join(sentences(outputs[0], [found]))


def test_the_headline_says_on_how_little_it_stands(tmp_path, capsys):
    first = fake_records(tmp_path / "a")
    few = fake_records(tmp_path / "b", scenes=("chair", "lego"))
    outputs = named([first, few])
    told = "b against a, on chair alone, in the 9 of 27 cells that both have: nerf the same, nerf_matched the same and"
    assert headline(outputs[0], [against(*outputs)]).startswith(told)
    assert main([str(first.out), str(few.out)]) == 0
    assert told in capsys.readouterr().out


def test_outputs_without_a_common_cell_say_so(compared):
    outputs, found = compared(scenes=("lego", "mic"))
    assert found.shared == 0
    assert headline(outputs[0], [found]) == "b and a have no cell in common"
    assert "not compared" not in outputs_page([one.records for one in outputs])[1].split("<main>")[0].split("</h1>")[0]


def test_names_are_as_short_as_they_can_be(whole, tmp_path):
    found = named([replace(whole, out=tmp_path / name) for name in ("x/run", "y/run", "z")])
    assert [one.name for one in found] == ["x/run", "y/run", "z"]
    assert [one.letter for one in found] == ["A", "B", "C"]


def test_settings_that_differ_are_named_and_no_others(compared):
    outputs, _ = compared(change=lambda run: replace(run, settings={**run.settings, "profile": "full"}))
    assert facts_grid(outputs, "settings", "").rows == [[Entry("profile"), Entry("reduced"), Entry("full")]]
    assert facts_grid(outputs, "provenance", "").rows == []


def test_the_page_is_well_formed_and_hostile_words_stay_words(tmp_path):
    def named_so(cell):
        return replace(cell, method=HOSTILE, reason=HOSTILE) if cell.method == "qnerf" else cell

    hostile = fake_records(tmp_path / "b", change=lambda run: replace(run, command=HOSTILE))
    hostile = replace(hostile, cells=[named_so(cell) for cell in hostile.cells])
    _, text = outputs_page([fake_records(tmp_path / "a"), hostile])
    outline = Outline(text)
    assert foreign_scripts(text) == []
    assert HOSTILE in html.unescape(text)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)


def test_the_command_writes_one_page_and_its_exit_code_speaks_of_all(tmp_path, capsys):
    a, b = (str(fake_records(tmp_path / name, with_diverged=name == "b").out) for name in "ab")
    assert main([a, b]) == 3
    assert (tmp_path / "a" / "outputs.html").is_file()
    assert not (tmp_path / "b" / "outputs.html").exists()
    assert main([a, a]) == 2
    assert main([a, "--page", str(tmp_path / "x.html")]) == 2
    assert main([a, b, "--publish", str(tmp_path)]) == 2
    assert main([a, str(tmp_path / "nothing")]) == 2
    said = capsys.readouterr().err
    assert "named twice" in said
    assert "no such folder" in said
