"""The study of the three parts, on cells whose effects are known."""

from itertools import chain

import pytest

from baselines.catalog import CATALOG
from baselines.methods.ablations import PARTS_OF_QNERF
from baselines.methods.nerf import NERF
from harness.records.cells import CellRecord
from harness.records.verdict import OPEN
from harness.studies.evidence.contrasts import Term, spread
from harness.studies.evidence.evidence_context import READINGS, TRAININGS
from harness.studies.evidence.factorial import PARTS, cumulative, design_of, factorial, pairs
from harness.studies.framework import Found
from tests.harness.studies.evidence.planted import context_of, effect, planted, sentences, table, with_diverged
from tests.replacing import replace

TRUTH: dict[str, dict[Term, float]] = {
    "Listing 2": {("φ encoding",): 0.6, ("amplifier",): -4.0, ("φ skip",): 0.02, ("φ encoding", "amplifier"): -0.5},
    "Eq. 4": {("φ encoding",): 1.1, ("amplifier",): 0.03, ("φ skip",): 0.02},
}
"""Without an amplifier both designs have the same cells: φ encoding is worth 0.6 + 0.5 = 1.1 dB there in both."""


def cells_of(noise: float = 0.02) -> list[CellRecord]:
    """The cells of all twelve methods; those without an amplifier come from the second design."""
    cells = {}
    for reading, truth in TRUTH.items():
        # so that the corner without any part has the same score in both designs
        level = sum(size * (-1) ** len(term) for term, size in truth.items()) / 2
        for trained in planted(design_of(reading), truth, noise=noise):
            up = [replace(point, psnr=(point.psnr or 0) - level) for point in trained.curve]
            cells[trained.scene, trained.method, trained.seed] = replace(
                trained,
                curve=up,
                scores={"psnr": up[-1].psnr, "ssim": up[-1].ssim},
                properties={"largest_density": 1.0 if reading == "Listing 2" else 50.0, "opacity_unit_slab": 0.632},
            )
    return list(cells.values())


def study(cells: list[CellRecord]) -> list[Found]:
    return list(factorial(context_of({"factorial": cells})))


@pytest.fixture(scope="module")
def findings() -> list[Found]:
    return study(cells_of())


@pytest.mark.parametrize("reading", READINGS)
def test_a_corner_holds_exactly_the_parts_that_are_on(reading: str) -> None:
    design = design_of(reading)
    assert len(set(design.methods.values())) == len(design.methods) == 8
    qnerf = CATALOG[READINGS[reading][1]].parts
    assert qnerf is not None
    for corner, method in design.methods.items():
        on = [PARTS_OF_QNERF[name] for name, is_on in zip(PARTS.values(), corner, strict=True) if is_on]
        assert CATALOG[method].parts == replace(NERF, **{name: getattr(qnerf, name) for name in chain(*on)}), method


def test_every_corner_is_trained_and_rows_of_table_4_are_in_the_order_of_the_paper() -> None:
    corners = [method for reading in READINGS for method in design_of(reading).methods.values()]
    assert set(corners) == set(TRAININGS["factorial"].methods)
    assert len(TRAININGS["factorial"].methods) == 12
    assert cumulative("Listing 2") == ["nerf", "nerf_phi_encoding", "nerf_phi_encoding_amplifier", "qnerf"]
    assert cumulative("Eq. 4") == ["nerf", "nerf_phi_encoding", "nerf_phi_encoding_equation4", "qnerf_theorem"]
    assert len(set(pairs())) == len(pairs())
    assert {("qnerf", "nerf_phi_encoding_amplifier"), ("qnerf", "nerf"), ("nerf_phi_skip", "nerf")} <= set(pairs())


@pytest.mark.parametrize("reading", READINGS)
def test_what_was_planted_is_found_on_every_scene(findings: list[Found], reading: str) -> None:
    for scene in ("all", "lego", "ficus", "hotdog"):
        for term in design_of(reading).terms():
            part = effect(findings, f"{' × '.join(term)} ({reading})", scene=scene)
            assert part.difference == pytest.approx(TRUTH[reading].get(term, 0.0), abs=0.03)
    assert effect(findings, f"φ encoding ({reading})").verdict.sign == "above 0"
    assert effect(findings, f"φ skip ({reading})").verdict.size == "smaller than matters"


def test_rows_of_table_4_are_effects_against_the_row_above_and_against_nerf(findings: list[Found]) -> None:
    """φ encoding alone 0.6 + 0.5; the amplifier on top of it −4 − 0.5; everything the sum of the odd terms."""
    for scene in ("lego", "all"):
        for method, against, size in (
            ("nerf_phi_encoding", "nerf", 1.1),
            ("nerf_phi_encoding_amplifier", "nerf_phi_encoding", -4.5),
            ("qnerf", "nerf", -3.38),
        ):
            assert effect(findings, method, against, scene).difference == pytest.approx(size, abs=0.05)
        assert effect(findings, "qnerf", "nerf_phi_encoding_amplifier", scene, metric="ssim").difference is not None
        at_equal_time = effect(findings, "qnerf_theorem", "nerf", scene, budget="seconds")
        assert at_equal_time.difference == pytest.approx(1.15, abs=0.1)


def test_sentences_say_which_part_does_what(findings: list[Found]) -> None:
    first, *others = sentences(findings)
    listing, _, equation = first.partition("with the amplifier of Eq. 4 ")
    assert "φ encoding +0.6" in listing
    assert "amplifier −4.0" in listing
    assert "φ encoding +1.1" in equation
    together = "\n".join(others)
    for words in (
        "At equal steps over all scenes (Eq. 4): φ encoding +1.1",
        "differently together than alone (Listing 2): φ encoding × amplifier −0.5",
        "No interaction is distinguished from 0 over all scenes (Eq. 4)",
        "density of 1 per half of the box: a solid of that thickness hides at most 63.2 %",
    ):
        assert words in together
    assert "no score" not in together


def test_table_4_has_the_printed_scores(findings: list[Found]) -> None:
    table4, combinations = table(findings, "table4_Listing 2"), table(findings, "combinations")
    rows = table4.rows
    assert [row[1] for row in rows] == cumulative("Listing 2")
    assert [row[3] for row in rows] == ["32.5", "33.2", "33.8", "34.0"]
    assert str(rows[2][4]).startswith("−4.")
    assert [row[7] for row in rows] == ["0.961", "0.967", "0.972", "0.974"]
    assert [row[5] for row in rows] == ["", "+0.70 dB", "+0.60 dB", "+0.20 dB"]
    assert all(len(row) == len(table4.columns) for row in rows)
    assert len(combinations.rows) == 12
    lego = combinations.columns.index("lego: PSNR, dB")
    assert combinations.rows[0][lego] == rows[0][2]


def test_a_diverged_cell_is_named_and_the_others_are_judged() -> None:
    findings = study(with_diverged(cells_of(), ("lego", "qnerf", 1)))
    assert effect(findings, "qnerf", "nerf").unpaired == 1
    assert effect(findings, "amplifier (Listing 2)").verdict.sign == "below 0"
    three_seeds = effect(findings, "amplifier (Listing 2)", scene="hotdog")
    assert (three_seeds.pairs, three_seeds.verdict) == (3, OPEN), "too few on a single scene"
    assert any("qnerf on lego, seed 1 (not finite at step 7: loss)" in sentence for sentence in sentences(findings))
    assert "(2 of 3 seeds)" in str(table(findings, "table4_Listing 2").rows[3][2])


def test_a_method_without_any_score_does_not_break_the_study() -> None:
    cells = cells_of()
    keys = [(trained.scene, trained.method, trained.seed) for trained in cells if "amplifier" in trained.method]
    findings = study(with_diverged(cells, *keys))
    lost = effect(findings, "amplifier (Listing 2)")
    assert (lost.difference, lost.verdict, lost.unpaired) == (None, OPEN, 9)
    assert effect(findings, "amplifier (Eq. 4)").verdict.size == "smaller than matters"


@pytest.mark.parametrize(
    ("scores", "metric", "words"),
    [
        ([24.0, 24.2], "psnr", "24.10 ± 0.14"),
        ([0.9, 0.902], "ssim", "0.901 ± 0.001"),
        ([24.0, None], "psnr", "24.00 (1 of 2 seeds)"),
        ([None, None], "psnr", "no seed ended well"),
    ],
)
def test_scores_of_seeds_in_words(scores: list[float | None], metric: str, words: str) -> None:
    assert spread(scores, metric) == words
