"""The words that a reader takes home."""

import pytest

from reports.claims.headline import headline, roles, title_of
from reports.data.load import Records, read_records
from tests.replacing import replace
from tests.reports.fake_run import METHODS, write_fake_run


def decided(records: Records, **verdicts: str) -> Records:
    """The same run with verdicts set by `rival_budget`."""
    changed = [
        replace(row, verdict=verdicts.get(f"{row.against}_{row.budget}", row.verdict)) if row.method == "qnerf" else row
        for row in records.comparisons
    ]
    return replace(records, comparisons=changed)


BOUND = "The gain of qnerf over nerf is no more than bandwidth alone brings: nerf_matched does "
UNSHOWN = "The gain of qnerf over nerf is not shown to be more than bandwidth alone brings: nerf_matched may do as well"
LONE = "qnerf scores above nerf, but without a bandwidth control beside it this says little"


@pytest.mark.parametrize(
    ("vs_baseline", "vs_control", "title"),
    [
        ("better", "better", "qnerf scores above both nerf and nerf_matched"),
        ("better", "equivalent", f"{BOUND}as well"),
        ("better", "worse", f"{BOUND}better still"),
        ("better", "inconclusive", UNSHOWN),
        ("better", None, LONE),
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
    shown = headline(records)
    assert shown.title == (
        "The gain of qnerf over nerf is no more than bandwidth alone brings: nerf_matched does as well "
        "(at equal steps, on scenes like these); still rising by 0.3 dB a doubling"
    )
    assert (
        shown.sentences[0] == "Mean test PSNR over 2 scenes: nerf 23.35 dB, nerf_matched 24.26 dB and qnerf 24.16 dB."
    )
    assert "owed to bandwidth" in shown.sentences[1]
    assert shown.sentences[2] == (
        "Equal steps and equal time differ on qnerf over all scenes against nerf_matched (equivalent → worse), "
        "on chair against nerf_matched (equivalent → worse) and on drums against nerf_matched (equivalent → worse)."
    )
    assert [(duel.method, duel.against) for duel in shown.duels] == [("qnerf", "nerf"), ("qnerf", "nerf_matched")]


def test_agreement_of_steps_and_time_is_said(whole: Records):
    same = {f"{rival}_{budget}": "better" for rival in ("nerf", "nerf_matched") for budget in ("steps", "seconds")}
    records = decided(whole, **same)
    shown = headline(records)
    better = "qnerf scores above both nerf and nerf_matched (on scenes like these)"
    assert shown.title == f"{better}; still rising by 0.3 dB a doubling"
    flat = [replace(cell, curve=[replace(point, psnr=20.0) for point in cell.curve]) for cell in records.cells]
    assert headline(replace(records, cells=flat)).title == better
    assert shown.sentences[-1] == "Equal steps and equal time lead to the same verdict on qnerf everywhere."
    kept = [row for row in records.comparisons if (row.scene, row.budget) != ("chair", "seconds")]
    assert headline(replace(records, comparisons=kept)).sentences[-1] == (
        "Equal steps and equal time lead to the same verdict on qnerf wherever both could be compared (2 could not)."
    )


def test_lost_cells_are_in_the_title(records: Records, whole: Records, tmp_path):
    title = headline(records).title
    assert title.startswith("The gain of qnerf over nerf is no more than bandwidth alone brings"), "others are judged"
    assert title.endswith("(on scenes like these); still rising by 0.3 dB a doubling; qnerf lost 1 of its 6 cells")
    cells = [replace(cell, status="error") if (cell.scene, cell.method, cell.seed) == ("chair", "nerf", 0) else cell
             for cell in whole.cells]  # fmt: skip
    baselines = headline(decided(replace(whole, cells=cells), nerf_steps="inconclusive"))
    assert baselines.title.startswith("This run cannot tell qnerf from nerf")
    assert baselines.title.endswith("; nerf lost 1 of its 6 cells")
    assert baselines.sentences[0].endswith("This is of the cells that finished: nerf lost 1 of its 6 cells.")
    never = headline(read_records(write_fake_run(tmp_path / "run", ("chair",), seeds=1, pictures=False)))
    assert never.title == "qnerf did not finish a single cell: nothing can be said of its quality"


def test_other_casts(whole: Records, tmp_path):
    def played(*names: str):
        out = tmp_path / "_".join(names)
        methods = {name: METHODS[name] for name in names}
        return headline(read_records(write_fake_run(out, methods=methods, pictures=False, with_diverged=False)))

    two = played("nerf", "qnerf")
    assert "without a bandwidth control" in two.title
    assert "nerf_matched was not run" in two.sentences[1]
    assert played("nerf").title == "Only nerf was run: there is nothing to compare it with"
    methods = {"nerf": "", "nerf_matched": "", "qnerf_theorem": "", "qnerf": ""}
    cast = roles(replace(whole, run=replace(whole.run, methods=methods)))
    assert (cast.baseline, cast.control, cast.contenders) == ("nerf", "nerf_matched", ["qnerf", "qnerf_theorem"])
