"""Tables as data, against literals."""

import pytest

from harness.records.cells import Comparison, LeftOut
from harness.records.verdict import OPEN, Verdict
from reports.claims.psnr_table import difference_entry, differences_grids, score_entry, scores_grid
from reports.data.load import Records, read_records
from reports.data.table import Spread, average_of, cells_frame, shared_scenes, spread_of
from reports.page.grid import Entry
from reports.run.metrics_table import (
    costs_grid,
    failures_grid,
    left_out_grid,
    metrics_grid,
    properties_grid,
    waiting,
    warnings_grid,
)
from tests.replacing import replace
from tests.reports.fake_run import write_fake_run

ABOVE = Verdict("above 0", "open")


def test_spread_is_over_finished_seeds_alone(records: Records):
    frame = cells_frame(records)
    whole, lost = spread_of(frame, "chair", "nerf", "psnr"), spread_of(frame, "drums", "qnerf", "psnr")
    assert whole.mean == pytest.approx((22.886 + 22.85 + 22.874) / 3, abs=0.05)
    assert (whole.done, whole.seeds) == (3, 3)
    assert (lost.done, lost.seeds) == (2, 3)


def test_an_average_stands_on_scenes_that_every_method_finished(tmp_path):
    out = write_fake_run(tmp_path / "run", seeds=1, pictures=False)
    frame = cells_frame(read_records(out))
    assert shared_scenes(frame, "psnr") == ["chair"]
    assert average_of(frame, "qnerf", "psnr", ["chair"]).sd is None


def test_a_method_that_never_finished_has_no_number(tmp_path):
    out = write_fake_run(tmp_path / "run", scenes=("chair",), seeds=1, pictures=False)
    assert scores_grid(read_records(out)).rows[0][4] == Entry("1 of 1 diverged", tone="failed")


def test_differences_are_those_of_the_comparisons(records: Records):
    changed = [
        replace(one, difference=0.125, interval=(0.01, 0.3), simultaneous=(0.05, 0.2), verdict=ABOVE, unpaired=0)
        if (one.scene, one.against, one.budget) == ("chair", "nerf", "steps") and one.method == "qnerf"
        else one
        for one in records.comparisons
    ]
    (grid,) = differences_grids(replace(records, comparisons=changed))
    assert [column.label for column in grid.columns] == [
        "scene",
        "− nerf",
        "− nerf_matched",
        "− nerf",
        "− nerf_matched",
        "Δ",
    ]
    assert grid.rows[0][1] == Entry("+0.12", "[+0.05, +0.20]\nabove 0, size open", "above gain")
    assert grid.rows[0][5] == Entry("+1.4", tone="muted")
    assert grid.totals[0][0].text == "all scenes"
    assert "1 pair not judged" in grid.totals[0][1].small


@pytest.mark.parametrize(("metric", "tone"), [("psnr", "above gain"), ("flip", "above loss")])
def test_a_colour_follows_the_sign_and_the_direction_of_the_metric(metric, tone):
    pair = (0.3, 0.7)
    one = Comparison("all", "qnerf", "nerf", metric, "steps", 0.5, pair, ABOVE, 0.4, 6, 0, pair, 1, None, None)
    assert difference_entry(one).tone == tone
    assert difference_entry(replace(one, verdict=Verdict("open", "smaller than matters"))).tone == "open"


def test_a_comparison_without_pairs_shows_no_number():
    one = Comparison("lego", "qnerf", "nerf", "psnr", "steps", None, None, OPEN, None, 0, 3, None, 1, None, None)
    assert difference_entry(one) == Entry("–", "sign and size open\n3 pairs not judged", "open")


def test_diverged_cells_show_in_every_table_of_scores(records: Records):
    metrics = metrics_grid(records)
    assert [row[1] for row in metrics.rows if row[1].tone == "failed"] == [Entry("qnerf", "1 of 3 diverged", "failed")]
    assert failures_grid(records).rows == [
        [
            Entry("drums · qnerf · seed 2"),
            Entry("diverged", tone="failed"),
            Entry("not finite at step 412: density_head.weight"),
        ]
    ]


def test_a_score_that_no_cell_has_is_no_column(tmp_path):
    def without_depth(cell):
        return replace(cell, scores={**cell.scores, "depth_rmse": None})

    out = write_fake_run(tmp_path / "run", pictures=False, change_cell=without_depth)
    labels = [column.label for column in metrics_grid(read_records(out)).columns]
    assert labels == ["scene", "method", "PSNR ↑", "SSIM ↑", "linear RMSE ↓", "FLIP ↓", "ΔE₀₀ ↓", "opacity IoU ↑"]


def test_properties_show_mean_and_range(tmp_path):
    def other_chunks(cell):
        value = 0.01 * (1 + cell.seed) if cell.method == "qnerf" else 0.0
        return replace(cell, properties={"chunk_max_difference": value, "note": "per call", "nothing": None})

    out = write_fake_run(tmp_path / "run", pictures=False, with_diverged=False, change_cell=other_chunks)
    grid = properties_grid(read_records(out))
    assert [row[0].text for row in grid.rows] == [
        "largest change of a pixel when a view is rendered in small chunks",
        "note",
    ]
    assert grid.rows[0][1:] == [Entry("0"), Entry("0"), Entry("0.0200", "0.0100 – 0.0300")]
    assert grid.rows[1][1] == Entry("per call")


def test_columns_that_no_scene_fills_are_left_out(tmp_path):
    def unmeasured(run):
        scenes = [
            replace(one, left_out=[LeftOut("volumetric integrator", "no medium", None, None, None)])
            for one in run.scenes
        ]
        return replace(run, scenes=scenes)

    out = write_fake_run(tmp_path / "run", pictures=False, change=unmeasured)
    grid = left_out_grid(read_records(out))
    assert [column.label for column in grid.columns] == ["left out", "scene", "because"]


def test_left_out_is_grouped_by_what_it_is(tmp_path):
    """And what holds for every scene stands once."""

    def two(run):
        def told(number):
            reasons = {"empty space": f"{number} of ten cells", "fine pass": "smooth"}
            return [LeftOut(what, why, None, None, None) for what, why in reasons.items()]

        return replace(run, scenes=[replace(one, left_out=told(k)) for k, one in enumerate(run.scenes)])

    records = read_records(write_fake_run(tmp_path / "run", pictures=False, change=two))
    names = [scene.name for scene in records.run.scenes]
    rows = [[entry.text for entry in row] for row in left_out_grid(records).rows]
    one_by_one = [["empty space", name, f"{number} of ten cells"] for number, name in enumerate(names)]
    assert rows == [*one_by_one, ["fine pass", f"all {len(names)} scenes", "smooth"]]


def test_left_out_says_what_it_may_cost_and_whether_it_does(tmp_path):
    told = [
        LeftOut("samples in empty space", "mostly empty", 3.0, -0.5, (-0.7, -0.3), "empty_space", "sampling", 0.2, "dB",
                "training", "costs more"),
        LeftOut("samples behind", "opaque", -0.1, 6.4e-5, None, "behind_opaque", "rendering", 1e-4, "colour",
                "rendering", "within its bound"),
        LeftOut("background model", "alpha is known", None, None, None, bound=0.0),
    ]  # fmt: skip

    def verified(run):
        return replace(run, scenes=[replace(run.scenes[0], left_out=told)])

    grid = left_out_grid(read_records(write_fake_run(tmp_path / "run", pictures=False, change=verified)))
    assert [column.label for column in grid.columns][3:] == ["time saved", "change in error", "may cost", "verdict"]
    texts = [[(entry.text, entry.small, entry.tone) for entry in row[3:]] for row in grid.rows]
    assert texts[0] == [
        ("3.0 s", "training", ""), ("−0.500 dB", "[−0.700, −0.300]", ""), ("0.200 dB", "", ""),
        ("costs more", "", "failed"),
    ]  # fmt: skip
    assert texts[1][1][0] == "6.40·10⁻⁵ of a colour"
    assert texts[1][3] == ("within its bound", "", "")
    assert [text for text, _, _ in texts[2]] == ["–", "–", "–", "–"]


@pytest.mark.parametrize(("mean", "ceiling", "limited"), [(37.5, 38.0, True), (36.9, 38.0, False), (37.5, None, False)])
def test_a_score_within_one_db_of_its_ceiling_is_called_reference_limited(mean, ceiling, limited):
    nothing = Spread(None, None, None, None, 0, 3)
    entry = score_entry(Spread(mean, 0.1, mean, mean, 3, 3), nothing, [], ceiling)
    assert ("reference-limited" in entry.small) == limited


def test_the_interval_of_a_family_stands_beside_the_one_of_the_comparison_alone() -> None:
    alone = Comparison(
        "all", "qnerf", "nerf", "psnr", "steps", 0.5, (0.1, 0.9), ABOVE, 0.4, 6, 0, (0.1, 0.9), 1, None, None
    )
    assert difference_entry(alone).small == "[+0.10, +0.90]\nabove 0, size open"
    of_eight = replace(alone, scene="lego", verdict=OPEN, simultaneous=(-0.3, 1.3), family=8)
    assert difference_entry(of_eight).small == "[−0.30, +1.30]\nsign and size open"
    older = replace(of_eight, simultaneous=None)
    assert "together" not in difference_entry(older).small


def test_what_a_method_costs_is_told_beside_what_nerf_does(records: Records):
    grid = costs_grid(records)
    assert [column.label for column in grid.columns] == [
        "method", "training", "multiple", "drawing", "weights", "file", "memory",
    ]  # fmt: skip
    nerf, matched, qnerf = grid.rows
    assert [entry.text for entry in nerf[1:]] == [
        "54.4 core s", "1", "42.1\u202fms", "24\u202f965", "101.4\u202fkB", "910.0\u202fMB",
    ]  # fmt: skip
    assert matched[2].text == "× 0.97"
    assert matched[2].small == "[0.97, 0.97]"
    assert qnerf[2].value == pytest.approx(1.06, rel=1e-12), "the cell that diverged did fewer steps, and is no pair"
    older = costs_grid(replace(records, cells=[replace(cell, costs={}) for cell in records.cells]))
    assert [column.label for column in older.columns] == ["method", "training", "multiple", "weights"]


def test_without_a_pair_of_as_many_steps_no_multiple_is_told(records: Records):
    apart = [replace(cell, steps=cell.steps + (cell.method == "qnerf")) for cell in records.cells]
    multiples = [row[2].text for row in costs_grid(replace(records, cells=apart)).rows]
    assert multiples == ["1", "× 0.97", "–"]


def test_cells_that_waited_for_a_processor_are_counted(records: Records):
    assert waiting(records) == ""
    slow = [replace(records.cells[0], train_seconds=1.5 * 54.4), *records.cells[1:]]
    assert waiting(replace(records, cells=slow)) == (
        "1 of 18 cells shared their processor: up to 1.5 seconds of the wall per core second. Other programs ran: "
        "scores are unaffected, wall times are too long."
    )
    slow[0] = replace(slow[0], provenance={"threads": 2})
    assert waiting(replace(records, cells=slow)).endswith(
        "Core seconds of 1 of them are too long as well: several threads waited actively."
    )
    (row,) = [row for row in warnings_grid(replace(records, cells=slow)).rows if "core seconds" in row[3].text]
    assert row[3].text == "core seconds too long: 2 threads waited actively"
