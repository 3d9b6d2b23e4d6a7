"""The study of reach and base, on cells with known effects."""

import re

import pytest

from harness.records.cells import CellRecord
from harness.records.verdict import OPEN
from harness.studies.evidence.bandwidth import BASE, DECISIVE, LADDER_DESIGN, REACH, answer, bandwidth
from harness.studies.evidence.contrasts import contrast_effects
from harness.studies.evidence.evidence_context import LADDERS, TRAININGS
from harness.studies.framework import Found
from scenes.catalog.entries import CLASSICS
from tests.harness.studies.evidence.planted import STEPS, Truth, context_of, effect, lines, planted, sentences, table
from tests.replacing import replace

SCENES = tuple(CLASSICS)
PIXELS = {"bandwidth_100": 100, "bandwidth_200": 200, "bandwidth_300": 300}


def cells_of(truth: Truth, ripe: bool = True) -> list[CellRecord]:
    """The four methods of the design, and 1.65^k with the scores of nerf_phi_encoding."""
    share = (lambda step: 1.0) if ripe else (lambda step: STEPS[0] / step)
    cells = planted(LADDER_DESIGN, truth, scenes=SCENES, seeds=1, noise=0.01, ripeness=share)
    return cells + [replace(cell, method="nerf_base165") for cell in cells if cell.method == "nerf_phi_encoding"]


def study(by_training: dict[str, list[CellRecord]]) -> list[Found]:
    return list(bandwidth(context_of(by_training, PIXELS)))


@pytest.fixture(scope="module")
def findings() -> list[Found]:
    """Only reach: 0.9 dB at 100 px, 0.3 at 200 and -0.3 at 300."""
    return study({name: cells_of({(REACH,): size}) for name, size in zip(PIXELS, (0.9, 0.3, -0.3), strict=True)})


def test_the_two_factors_are_what_they_are_called(findings: list[Found]) -> None:
    """By highest frequency: a short reach is 64 to 76, a long one 512 to 521; the base is 2 or φ."""
    rows = {str(row[0]): row[1:4] for row in table(findings, "ladders_100").rows}
    assert rows == {
        "nerf": ["2", "10", "512"],
        "nerf_matched": ["2", "7", "64"],
        "nerf_phi_encoding": ["1.618", "10", "76.01"],
        "nerf_phi_far": ["1.618", "14", "521"],
        "nerf_base165": ["1.65", "10", "90.65"],
    }
    for (short, golden), method in LADDER_DESIGN.methods.items():
        base, _, highest = map(str, rows[method])
        assert (float(highest) < 80, base == "1.618") == (short, golden)
    assert set(LADDER_DESIGN.methods.values()) | {"nerf_base165"} == set(LADDERS)
    for name, px in PIXELS.items():
        training = TRAININGS[name]
        assert (training.methods, training.scenes, training.resolution) == (LADDERS, SCENES, px)


def test_reach_is_found_where_reach_was_planted(findings: list[Found]) -> None:
    for px, size, said in ((100, 0.9, "above 0"), (200, 0.3, "above 0"), (300, -0.3, "below 0")):
        reach, base, both = (effect(findings, f"{name} at {px} px") for name in (REACH, BASE, f"{REACH} × {BASE}"))
        assert (reach.verdict.sign, base.verdict.size, both.verdict.size) == (said, *("smaller than matters",) * 2)
        assert reach.difference == pytest.approx(size, abs=0.02)
        assert reach.pairs == len(SCENES)
        # one verdict of three makes the answer
        assert reach.family == base.family == len(PIXELS)


def test_one_seed_gives_a_single_scene_a_figure_and_no_verdict(findings: list[Found]) -> None:
    for scene in SCENES:
        single = effect(findings, f"{REACH} at 100 px", scene=scene)
        assert single.difference == pytest.approx(0.9, abs=0.05)
        assert (single.verdict, single.interval) == (OPEN, None)
    assert not any(scene in sentence for sentence in sentences(findings) for scene in SCENES)


def test_every_ladder_stands_against_nerf_and_phi_against_those_of_its_reach(findings: list[Found]) -> None:
    for method, size in (("nerf_matched", 0.9), ("nerf_phi_encoding", 0.9), ("nerf_base165", 0.9), ("nerf_phi_far", 0)):
        assert effect(findings, f"{method} at 100 px", "nerf").difference == pytest.approx(size, abs=0.02)
        assert effect(findings, f"{method} at 300 px", "nerf", budget="seconds").difference is not None
    for method, against in DECISIVE:
        assert effect(findings, f"{method} at 200 px", against).verdict.size == "smaller than matters"


def test_it_is_said_how_the_effect_moves_with_resolution(findings: list[Found]) -> None:
    moved = effect(findings, f"{REACH}, from 100 to 300 px")
    assert moved.difference == pytest.approx(-1.2, abs=0.02)
    assert moved.interval is not None
    assert moved.interval[1] < 0
    assert effect(findings, f"{BASE}, from 100 to 300 px").verdict.size == "smaller than matters"
    first, _ = (sentence for sentence in sentences(findings) if "from 100 to 300 px: the effect moves by" in sentence)
    assert "−1.2" in first


def test_it_is_said_how_the_effect_moves_with_training_time() -> None:
    findings = study(dict.fromkeys(PIXELS, cells_of({(REACH,): 2.0}, ripe=False)))
    change = effect(findings, f"{REACH} at 200 px, from step 100 to 500")
    assert change.difference == pytest.approx(2.0 * (10 / 500 - 10 / 100), abs=0.01)
    drawn_lines = lines(findings)
    assert len(drawn_lines) == (1 + len(PIXELS)) * (4 + 2), "over resolution, and at each along training"
    drawn = drawn_lines["Reach and base along training, at 200 px", REACH]
    assert (drawn.x, drawn.y) == ([10.0, 100.0, 500.0], pytest.approx([2.0, 0.2, 0.04], abs=0.02))
    over_resolution = drawn_lines["Difference from NeRF over resolution", "nerf_matched"]
    for each in (drawn, over_resolution):
        assert all(end is not None for end in (*each.low, *each.high)), "intervals over scenes"


@pytest.mark.parametrize(
    ("truth", "noise", "start"),
    [
        ({(REACH,): 0.9}, 0.005, "It is bandwidth: "),
        ({(REACH,): 0.9, (BASE,): 0.5}, 0.005, "A shorter reach raises PSNR in "),
        ({(BASE,): 0.5}, 0.005, "The base: "),
        ({(REACH,): 3.0, (BASE,): 0.15}, 0.4, "Bandwidth, as far as these runs can say: "),
        ({(REACH,): 0.05, (BASE,): 0.05}, 0.005, "Neither: "),
        ({}, 1.0, "Open: "),
        ({(REACH,): -0.9}, 0.005, "It is bandwidth: a shorter reach lowers PSNR in "),
        ({(BASE,): -0.9}, 0.005, "The base: φ for 2 at the same reach lowers PSNR in "),
    ],
)
def test_the_answer_follows_what_was_planted(truth: Truth, noise: float, start: str) -> None:
    cells = planted(LADDER_DESIGN, truth, scenes=SCENES, seeds=1, noise=noise)
    assert answer(contrast_effects(LADDER_DESIGN, cells, "at 100 px")).startswith(start)


def test_what_only_one_scene_shows_is_not_an_answer() -> None:
    """Even with enough seeds for a verdict on that scene."""
    cells = planted(LADDER_DESIGN, {(REACH,): 3.0}, scenes=SCENES[:1], seeds=6, noise=0.005)
    cells += planted(LADDER_DESIGN, {}, scenes=SCENES[1:], seeds=6, noise=0.005)
    effects = contrast_effects(LADDER_DESIGN, cells, "at 100 px")
    assert effect(effects, f"{REACH} at 100 px", scene=SCENES[0]).verdict.sign == "above 0"
    assert answer(effects).startswith("Open: ")


def test_the_answer_counts_and_gives_the_range(findings: list[Found]) -> None:
    first = sentences(findings)[0]
    ways = r"raises PSNR in 2 of 3 cases \(\+0\.3\d dB to \+0\.9\d dB\) and lowers PSNR in 1 of 3 cases \(−0\.[23]\d dB"
    assert re.match(rf"It is bandwidth: a shorter reach {ways}", first)
    assert first.endswith("judged over 8 scenes; the 3 cases of a factor are looked at together.")
