"""Contrasts of full factorial designs: planted effects come back, and none is found where none was planted."""

from itertools import product

import numpy as np
import pytest

from harness.records.study import Effect
from harness.studies.evidence import contrasts
from harness.studies.evidence.contrasts import contrast, contrast_effects, scores_together
from harness.verdicts.comparisons import FEWEST_SEEDS, differences, keyed
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence.planted import STEPS, planted, with_diverged
from tests.replacing import replace

FACTORS = ("a", "b", "c")
DESIGN = contrasts.Design(
    FACTORS,
    {corner: "m" + "".join(name for name, on in zip(FACTORS, corner, strict=True) if on)
     for corner in product((False, True), repeat=3)},
)  # fmt: skip
PLANTED = {("a",): 0.9, ("b",): -3.0, ("c",): 0.05, ("a", "b"): 0.4, ("b", "c"): -0.2, ("a", "b", "c"): 0.1}
ZERO = dict.fromkeys(DESIGN.terms(), 0.0)


def test_the_design_matrix_is_orthogonal_and_balanced() -> None:
    matrix = np.array([np.ones(8), *(contrasts.signs(DESIGN, term) for term in DESIGN.terms())])
    assert np.array_equal(matrix @ matrix.T, 8 * np.eye(8))
    assert set(np.unique(matrix)) == {-1.0, 1.0}


def test_contrasts_are_the_textbook_s_differences_of_means() -> None:
    values = np.random.default_rng(3).normal(size=8)
    y = values.reshape(2, 2, 2)  # axes a, b, c
    assert contrast(values, DESIGN, ("b",)) == pytest.approx(y[:, 1].mean() - y[:, 0].mean())
    a_with_c, a_without_c = (y[1, :, c].mean() - y[0, :, c].mean() for c in (1, 0))
    assert contrast(values, DESIGN, ("a", "c")) == pytest.approx((a_with_c - a_without_c) / 2)

    def ab(c: int) -> float:
        return float((y[1, 1, c] - y[0, 1, c]) - (y[1, 0, c] - y[0, 0, c])) / 2

    assert contrast(values, DESIGN, ("a", "b", "c")) == pytest.approx((ab(1) - ab(0)) / 2)


def test_one_factor_is_the_difference_that_a_run_compares() -> None:
    cells = planted(DESIGN, PLANTED, noise=0.3, seconds=lambda method: 10.0 + 3 * len(method))
    by_key, scenes, seeds = keyed(cells)
    for budget in ("steps", "seconds"):
        ours = contrasts.contrast_tables(contrasts.duel("ma", "m"), ("ma",), cells, "psnr", budget)
        theirs = differences(by_key, scenes, seeds, "ma", "m", "psnr", budget)
        assert all(np.allclose(ours[scene], theirs[scene]) for scene in scenes)


def named(effects: list[Effect], scene: str, budget: str = "steps") -> dict[str, Effect]:
    return {effect.name: effect for effect in contrasts.chosen(effects, scene=scene, budget=budget)}


def test_effects_are_those_planted_on_every_scene_and_over_all() -> None:
    effects = contrast_effects(DESIGN, planted(DESIGN, PLANTED), "(here)")
    assert len(effects) == 7 * 2 * 2 * 4
    for scene in ("all", "lego", "ficus", "hotdog"):
        for term in DESIGN.terms():
            effect = named(effects, scene)[f"{' × '.join(term)} (here)"]
            assert effect.difference == pytest.approx(PLANTED.get(term, 0.0), abs=1e-9)
            assert (effect.against, effect.unpaired, effect.pairs) == ("", 0, 9 if scene == "all" else 3)


def test_families_are_one_for_a_part_and_all_four_interactions_together() -> None:
    effects = contrast_effects(DESIGN, planted(DESIGN, PLANTED), "")
    families = {(effect.metric, effect.scene, effect.note): effect.family for effect in effects}
    assert families["psnr", "all", ""] == 1
    assert families["psnr", "lego", ""] == 3
    assert families["psnr", "all", "interaction"] == 4
    assert families["ssim", "ficus", "interaction"] == 4 * 3


def test_a_diverged_cell_is_counted_in_every_contrast_and_the_others_are_judged() -> None:
    """The scene that is left with a pair too few for a verdict gets none."""
    cells = planted(DESIGN, PLANTED, seeds=FEWEST_SEEDS, noise=0.01)
    effects = contrast_effects(DESIGN, with_diverged(cells, ("ficus", "mbc", 1)), "")
    for scene, unpaired, pairs, sign in (("all", 1, 14, "below 0"), ("ficus", 1, 4, "open"), ("lego", 0, 5, "below 0")):
        counts = {(effect.unpaired, effect.pairs) for effect in named(effects, scene).values()}
        assert counts == {(unpaired, pairs)}
        assert named(effects, scene)["b"].verdict.sign == sign


def test_at_equal_time_all_corners_are_compared_when_the_quickest_ended() -> None:
    def cost(method: str) -> float:
        return 10.0 * 10 ** method.count("a")

    cells = planted(DESIGN, ZERO, scenes=("lego",), seeds=2, seconds=cost)
    effects = contrast_effects(DESIGN, cells, "")
    # ten times as slow: at the time of the quickest a tenth of the steps are done, 1 dB less than at the end
    assert STEPS[-1] / 10 > STEPS[0]
    for budget, term, size in (("seconds", "a", -1.0), ("seconds", "b", 0.0), ("steps", "a", 0.0)):
        assert named(effects, "lego", budget)[term].difference == pytest.approx(size, abs=1e-9)


def test_scores_together_of_what_is_missing_failed_or_unscored() -> None:
    good = cell("lego", "x", 0, [checkpoint(10, 1.0, 20.0), checkpoint(100, 10.0, 22.0)])
    late = cell("lego", "y", 0, [checkpoint(100, 90.0, 23.0)])
    assert np.array_equal(
        scores_together([good, None, diverged("lego", "y", 0)], "psnr", "steps"), [22.0, np.nan, np.nan], equal_nan=True
    )
    assert np.isnan(scores_together([None, None], "psnr", "steps")).all()
    assert scores_together([good, late], "psnr", "seconds")[0] == 22.0
    assert np.isnan(scores_together([good, late], "psnr", "seconds")[1]), "not scored so early"
    assert np.isnan(scores_together([good], "delta_e", "steps"))[0]
    # what a cell scored before it diverged does not count, else survivors would be compared with those that fall
    fallen = replace(good, status="diverged", steps=150, train_seconds=15.0, scores={})
    for budget, step in (("steps", None), ("seconds", None), ("steps", 10)):
        assert np.isnan(scores_together([good, fallen], "psnr", budget, step)[1])
    shorter = replace(good, steps=10, scores={"psnr": 20.0})
    assert scores_together([good, shorter], "psnr", "steps").tolist() == [20.0, 20.0]


def test_checkpoints_that_not_all_have_are_not_common() -> None:
    cells = [
        cell("lego", method, 0, [checkpoint(first, 1.0, 20.0), checkpoint(50, 5.0, 22.0)])
        for method, first in (("x", 10), ("y", 20))
    ]
    assert contrasts.common_steps([*cells, diverged("lego", "z", 0)]) == [50]
    assert contrasts.common_steps([diverged("lego", "z", 0)]) == []


def test_a_line_has_a_gap_where_there_is_nothing() -> None:
    tables = {1.0: {"lego": np.array([np.nan])}, 2.0: {"lego": np.array([1.0])}}
    drawn = contrasts.line(tables, panel="p", name="n", x_label="x")
    assert (drawn.y, drawn.low, drawn.high) == ([None, 1.0], [None, None], [None, None])
