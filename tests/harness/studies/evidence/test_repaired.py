"""The study of the repaired Q-NeRF, on cells whose differences are known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from baselines.numerics.encoding import PHI
from harness.records.cells import CellRecord
from harness.records.study import Check
from harness.studies.evidence.contrasts import in_words
from harness.studies.evidence.repaired import MARGIN, METRICS, REPAIRED, equal_time, repaired
from harness.studies.framework import Found
from harness.verdicts import paper
from scenes.catalog.entries import CLASSICS
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence.planted import effect, sentences, situation, table, with_diverged
from tests.replacing import replace

SEEDS = (0, 1, 2)
FIRST = next(iter(CLASSICS))
NO_AMPLIFIER = "nerf_phi_encoding_phi_skip"
LEVELS = {"nerf": 24.0, "nerf_matched": 24.5, NO_AMPLIFIER: 24.6}


def cells_of(gain: float, slowness: float = 1.0, noise: float = 0.02, **facts: float | None) -> list[CellRecord]:
    """qnerf_repaired is `gain` dB above nerf at equal steps, and a step of it takes `slowness` times as long."""
    draw = np.random.default_rng(4)
    found = []
    for place, scene in enumerate(CLASSICS):
        for seed in SEEDS:
            for method, level in (LEVELS | {REPAIRED: LEVELS["nerf"] + gain}).items():
                psnr = level + place + 0.2 * seed + draw.normal(0.0, noise)
                slow = slowness if method == REPAIRED else 1.0
                alpha = 1.5 / PHI if method == REPAIRED else None
                curve = [
                    replace(
                        checkpoint(step, slow * step / 50, value, ssim=0.01 * value, rmse_linear=1 / value),
                        depth_rmse=2 / value,
                        alpha=alpha,
                    )
                    for step, value in ((60, psnr - 3.0), (600, psnr))
                ]
                scores = {name: getattr(curve[-1], name) for name in METRICS}
                properties = {"chunk_max_difference": 1e-7, "opacity_unit_slab": 1.0, **facts}
                found.append(cell(scene, method, seed, curve, scores=scores, properties=properties))
    return found


@pytest.fixture
def study(tmp_path: Path) -> Callable[[list[CellRecord]], list[Found]]:
    return lambda cells: list(repaired(situation(tmp_path, {"repaired": cells})))


Study = Callable[[list[CellRecord]], list[Found]]


def checks(found: list[Found]) -> dict[str, Check]:
    """By the first two words of what is checked."""
    return {" ".join(check.what.split()[:2]): check for check in found if isinstance(check, Check)}


@pytest.mark.parametrize(
    ("gain", "said"), [(1.6, "is reached"), (0.3, "is not reached"), (1.2, "is not settled"), (-0.5, "is not reached")]
)
def test_the_first_sentence_says_whether_the_paper_s_margin_is_reached(study: Study, gain: float, said: str) -> None:
    found = study(cells_of(gain))
    first, second = sentences(found)[:2]
    assert first.startswith("At equal steps the repaired Q-NeRF changes NeRF's PSNR by")
    assert second.startswith("At equal time ")
    assert first.rstrip(".").endswith(said)
    assert effect(found, REPAIRED, "nerf").difference == pytest.approx(gain, abs=0.05)
    (claim,) = [claim for claim in paper.ABSTRACT if claim.id == "abstract-psnr-range"]
    assert isinstance(claim.printed, tuple)
    assert min(claim.printed) == MARGIN


def test_equal_time_charges_for_slowness(study: Study) -> None:
    """Twice as long a step: at the time of the quicker one it is log10(2) of 3 dB a decade behind."""
    found = study(cells_of(1.6, slowness=2.0))
    loss = (effect(found, REPAIRED, "nerf").difference or 0.0) - (
        effect(found, REPAIRED, "nerf", budget="seconds").difference or 0.0
    )
    assert loss == pytest.approx(3.0 * np.log10(2.0), abs=1e-6)


def test_it_is_said_how_far_the_slower_one_has_come_at_equal_time(study: Study) -> None:
    for slowness, said in (
        (2.0, f"{REPAIRED}, the slower one, is met after 50 %"),
        (0.8, "nerf, the slower one, is met after 80 %"),
    ):
        (sentence,) = [
            sentence for sentence in sentences(study(cells_of(1.0, slowness))) if "Equal time is read off" in sentence
        ]
        assert said in sentence
    lost = [diverged(trained.scene, trained.method, trained.seed) for trained in cells_of(1.0)]
    assert "is not known: no pair ended" in equal_time(lost)


def test_the_controls_tell_bandwidth_and_the_amplifier_apart(study: Study) -> None:
    found = study(cells_of(0.55))
    for against, size, words in (("nerf_matched", 0.05, "beyond bandwidth"), (NO_AMPLIFIER, -0.05, "what Eq. 4 does")):
        assert effect(found, REPAIRED, against).difference == pytest.approx(size, abs=0.03)
        for sentence, budget in zip(sentences(found)[:2], ("steps", "seconds"), strict=True):
            assert f"{words}) by {in_words(effect(found, REPAIRED, against, budget=budget))}" in sentence


def test_a_cell_that_diverged_is_named_and_the_others_are_judged(study: Study) -> None:
    found = study(with_diverged(cells_of(1.9), (FIRST, REPAIRED, 1)))
    assert "1 of 24 pairs without a score" in sentences(found)[0]
    assert any("1 of 96 cells have no score" in sentence and FIRST in sentence for sentence in sentences(found))
    judged = effect(found, REPAIRED, "nerf")
    assert (judged.unpaired, judged.verdict.sign) == (1, "above 0")
    assert table(found, "contrast_learnt").rows[0][2] is None


def test_checks_hold_on_sound_cells_and_fail_one_by_one(study: Study) -> None:
    assert all(check.holds for check in study(cells_of(0.5)) if isinstance(check, Check))
    for facts, broken in (
        ({"chunk_max_difference": 3e-6}, {"largest difference"}),
        ({"opacity_unit_slab": 0.9}, {"opacity of"}),
        ({"chunk_max_difference": None, "opacity_unit_slab": None}, {"largest difference", "opacity of"}),
    ):
        failed = {name for name, check in checks(study(cells_of(0.5, **facts))).items() if not check.holds}
        assert failed == broken
