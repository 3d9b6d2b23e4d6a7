"""The words that a reader takes home."""

import pytest

from reports.claims.headline import headline, roles, title_of
from reports.data.load import Records, read_records
from tests.replacing import replace
from tests.reports.fake_run import METHODS, write_fake_run


def decided(records: Records, **verdicts: str) -> Records:
    """The same run with verdicts set by `rival_budget`."""
    changed = [
        replace(one, verdict=verdicts.get(f"{one.against}_{one.budget}", one.verdict)) if one.method == "qnerf" else one
        for one in records.comparisons
    ]
    return replace(records, comparisons=changed)


@pytest.mark.parametrize(
    ("vs_baseline", "vs_control", "title"),
    [
        ("better", "better", "qnerf scores above both nerf and nerf_matched"),
        (
            "better",
            "equivalent",
            "The gain of qnerf over nerf is no more than bandwidth alone brings: nerf_matched does as well",
        ),
        (
            "better",
            "worse",
            "The gain of qnerf over nerf is no more than bandwidth alone brings: nerf_matched does better still",
        ),
        (
            "better",
            "inconclusive",
            "The gain of qnerf over nerf is not shown to be more than bandwidth alone brings: "
            "nerf_matched may do as well",
        ),
        ("better", None, "qnerf scores above nerf, but without a bandwidth control beside it this says little"),
        ("worse", "worse", "qnerf scores below both nerf and nerf_matched"),
        ("equivalent", "better", "qnerf and nerf score the same within the margin; qnerf scores above nerf_matched"),
        ("worse", "better", "qnerf scores below nerf; qnerf scores above nerf_matched"),
        ("inconclusive", "worse", "This run cannot tell qnerf from nerf; qnerf scores below nerf_matched"),
        ("inconclusive", "inconclusive", "This run cannot tell qnerf from nerf or nerf_matched"),
        ("worse", None, "qnerf scores below nerf"),
        (None, "better", "No comparison of qnerf with nerf could be made"),
    ],
)
def test_titles(vs_baseline, vs_control, title):
    assert title_of("qnerf", "nerf", "nerf_matched", vs_baseline, vs_control) == title


def test_the_headline_names_both_rivals_and_where_time_changes_the_verdict(whole: Records):
    records = decided(
        whole, nerf_steps="better", nerf_seconds="better", nerf_matched_steps="equivalent", nerf_matched_seconds="worse"
    )
    said = headline(records)
    assert said.title == (
        "The gain of qnerf over nerf is no more than bandwidth alone brings: nerf_matched does as well "
        "(at equal steps, on scenes like these)"
    )
    assert said.sentences[0] == "Mean test PSNR over 2 scenes: nerf 23.35 dB, nerf_matched 24.26 dB and qnerf 24.16 dB."
    assert "owed to bandwidth" in said.sentences[1]
    assert said.sentences[2] == (
        "Equal steps and equal time differ on qnerf over all scenes against nerf_matched (equivalent → worse), "
        "on chair against nerf_matched (equivalent → worse) and on drums against nerf_matched (equivalent → worse)."
    )
    assert [(duel.method, duel.against) for duel in said.duels] == [("qnerf", "nerf"), ("qnerf", "nerf_matched")]


def test_agreement_of_steps_and_time_is_said(whole: Records):
    same = {f"{rival}_{budget}": "better" for rival in ("nerf", "nerf_matched") for budget in ("steps", "seconds")}
    said = headline(decided(whole, **same))
    assert said.title == "qnerf scores above both nerf and nerf_matched (on scenes like these)"
    assert said.sentences[-1] == "Equal steps and equal time lead to the same verdict on qnerf everywhere."


def test_lost_cells_are_in_the_title(records: Records):
    title = headline(records).title
    assert title.startswith("The gain of qnerf over nerf is no more than bandwidth alone brings"), "others are judged"
    assert title.endswith("(on scenes like these); qnerf lost 1 of its 6 cells")


def test_a_method_that_never_finished_is_named(tmp_path):
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False)
    assert headline(read_records(out)).title == (
        "qnerf did not finish a single cell: nothing can be said of its quality"
    )


def test_without_the_control_the_headline_says_so(tmp_path):
    two = {name: METHODS[name] for name in ("nerf", "qnerf")}
    said = headline(read_records(write_fake_run(tmp_path / "run", methods=two, pictures=False, with_diverged=False)))
    assert "without a bandwidth control" in said.title
    assert "nerf_matched was not run" in said.sentences[1]


def test_one_method_alone_is_no_comparison(tmp_path):
    out = write_fake_run(tmp_path / "run", methods={"nerf": ""}, pictures=False, with_diverged=False)
    assert headline(read_records(out)).title == "Only nerf was run: there is nothing to compare it with"


def test_roles(tmp_path):
    methods = {"nerf": "", "nerf_matched": "", "qnerf_theorem": "", "qnerf": ""}
    records = read_records(write_fake_run(tmp_path / "run", methods=METHODS, pictures=False))
    cast = roles(replace(records, run=replace(records.run, methods=methods)))
    assert (cast.baseline, cast.control, cast.contenders) == ("nerf", "nerf_matched", ["qnerf", "qnerf_theorem"])


def test_the_baselines_lost_cells_are_in_the_title_too(whole: Records):
    cells = [replace(cell, status="error") if (cell.scene, cell.method, cell.seed) == ("chair", "nerf", 0) else cell
             for cell in whole.cells]  # fmt: skip
    said = headline(decided(replace(whole, cells=cells), nerf_steps="inconclusive"))
    assert said.title.startswith("This run cannot tell qnerf from nerf")
    assert said.title.endswith("; nerf lost 1 of its 6 cells")
    assert said.sentences[0].endswith("This is of the cells that finished: nerf lost 1 of its 6 cells.")


def test_pairs_without_seconds_are_not_said_to_agree(whole: Records):
    same = {f"{rival}_{budget}": "better" for rival in ("nerf", "nerf_matched") for budget in ("steps", "seconds")}
    records = decided(whole, **same)
    kept = [one for one in records.comparisons if (one.scene, one.budget) != ("chair", "seconds")]
    assert headline(replace(records, comparisons=kept)).sentences[-1] == (
        "Equal steps and equal time lead to the same verdict on qnerf wherever both could be compared (2 could not)."
    )
