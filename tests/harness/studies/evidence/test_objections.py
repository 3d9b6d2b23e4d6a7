"""The studies of objections, and of trainings that end without a picture, on cells whose figures are known."""

import math
from itertools import product

import numpy as np
import pytest
from scipy.stats import t

from harness.plan.profiles import PROFILES
from harness.records.cells import CellRecord
from harness.studies.evidence.collapse import BOXES, collapse, end_of
from harness.studies.evidence.evidence_context import DENSITIES, OBJECTED, TRAININGS, WITHOUT_SILHOUETTES
from harness.studies.evidence.objections import OBJECTIONS, amplifier_after_training, objections, octaves
from harness.studies.trained_context import StudyRun
from scenes.catalog.entries import CLASSICS
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence.planted import checks, context_of, effect, sentences, table
from tests.replacing import replace

AMPLIFIERS = {
    "qnerf": {"alpha_phi": 1.1, "psnr_without_amplifier": -0.05},
    "qnerf_listing4": {"alpha_phi": 0.5, "psnr_without_amplifier": -9.0},
}
GAINS = {"qnerf": 0.4, "nerf_released": -0.3, "qnerf_shifted": 1.0}


def cells_of(methods: tuple[str, ...]) -> list[CellRecord]:
    draw = np.random.default_rng(3)
    made = []
    for (place, scene), seed, method in product(enumerate(CLASSICS), (0, 1), methods):
        psnr = 24.0 + place + GAINS.get(method, 0.0) + draw.normal(0.0, 0.02)
        facts = {"scores": {"psnr": psnr, "ssim": 0.9}, "properties": AMPLIFIERS.get(method, {})}
        made.append(cell(scene, method, seed, [checkpoint(1000, 10.0, psnr, ssim=0.9)], **facts))
    return made


def test_each_objection_has_its_difference_and_the_amplifier_its_sentence() -> None:
    context = context_of({"objections": cells_of(OBJECTED), "no_silhouettes": cells_of(WITHOUT_SILHOUETTES)})
    findings = list(objections(context))
    first, *others = sentences(findings)
    assert "α φ lies between 1.10 and 1.10 (16 trainings)" in first
    assert "to within 10 %" in first
    assert "−0.05 dB on average" in first
    assert first.endswith("Rendered by Listing 4, α φ lies between 0.50 and 0.50 (16 trainings).")
    for objection in OBJECTIONS:
        pair = f"{objection.words}: {objection.method} − {objection.against} is"
        assert any(words.startswith(pair) for words in others)
    truth = GAINS["qnerf"] - GAINS["nerf_released"]
    found = effect(findings, "qnerf", "nerf_released")
    assert found.difference == pytest.approx(truth, abs=0.03)
    assert found.family == len(OBJECTIONS)
    # of so many scenes Bonferroni's interval is wider by the ratio of two quantiles of t
    own, wide = (np.ptp(ends) for ends in (found.interval, found.simultaneous))
    quantiles = t.ppf([0.975, 1 - 0.025 / len(OBJECTIONS)], len(CLASSICS) - 1)
    assert wide / own == pytest.approx(quantiles[1] / quantiles[0])
    assert len(table(findings, "taken_out").rows) == len(AMPLIFIERS) * len(CLASSICS)
    assert context.plan("no_silhouettes").views.need == ("outside_hull", "background_rays")


def test_without_an_amplifier_there_is_nothing_to_take_out() -> None:
    assert amplifier_after_training(cells_of(("nerf",))) == "No trained method has an amplifier."


def test_octaves_are_those_of_the_two_encodings() -> None:
    """A box of half extent π would have the same reach: 2^k x against 2^k π x / h."""
    run = context_of({"objections": cells_of(("nerf",))}).trained("objections")
    halves = (math.pi, math.pi / 2)
    boxed = [replace(one, bounds=[[-half] * 3, [half] * 3]) for one, half in zip(run.scenes[:2], halves, strict=True)]
    assert "lies 0.0 to 1.0 octaves below" in octaves(StudyRun(run.plan, boxed, run.cells))


# trainings that end without a picture


def trained(psnr: float, method: str = "nerf", seed: int = 0, warnings: tuple[str, ...] = ()) -> CellRecord:
    scores = {"psnr": psnr, "psnr_floor": 20.0}
    return cell("mic", method, seed, [checkpoint(200, 4.0, psnr)], scores=scores, warnings=list(warnings))


def test_what_counts_as_no_picture() -> None:
    assert end_of(trained(20.1)) is None
    assert end_of(trained(19.9)) == "below the floor"
    assert end_of(trained(25.0, warnings=("empty collapse: mean test opacity 0.000",))) == "empty collapse"
    assert end_of(diverged("mic", "nerf", 0)) == "diverged"


def test_every_end_is_counted_with_its_exact_interval() -> None:
    own = [trained(25.0, seed=seed) for seed in range(7)]
    own += [trained(19.0, seed=7), diverged("mic", "nerf", 8), trained(25.0, seed=9, warnings=("empty collapse",))]
    own += [cell("mic", "nerf", 10, [], status="error", reason="the disk is full")]
    good = [trained(25.0, method, seed) for method in DENSITIES for seed in range(4)]
    findings = list(collapse(context_of(dict.fromkeys(BOXES, good) | {"box_own": own})))
    # Clopper and Pearson for 3 of 10 and 0 of 20
    assert "3 of 10 in the scene's own box (95 % interval 6.7 to 65.2 %); 0 of 20 in" in sentences(findings)[0]
    assert "(95 % interval 0.0 to 16.8 %)" in sentences(findings)[0]
    assert [check.id for check in checks(findings) if check.status == "fail"] == ["lost.box_own"]
    rows = table(findings, "ends").rows
    assert rows[0] == ["the scene's own box", "nerf", "10", "1", "1", "1", "6.7 %", "65.2 %"]
    assert len(rows) == 1 + 3 * len(DENSITIES)


@pytest.mark.parametrize("name", BOXES[1:])
def test_larger_boxes_are_boxes_of_the_same_views(name: str) -> None:
    """The box is larger, and the views are those of the default run."""
    views, default = context_of({}).plan(name).views, PROFILES["reduced"].views
    assert views.region is not None
    half = TRAININGS[name].half_side
    assert views.region.bounds == (*[-(half or 0)] * 3, *[half] * 3)
    for field in ("resolution", "train", "test", "spp_test"):
        assert getattr(views, field) == getattr(default, field)
