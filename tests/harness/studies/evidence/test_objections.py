"""The study of objections, on cells whose differences are known."""

import math
from pathlib import Path

import numpy as np
import pytest

from baselines.catalog import CATALOG
from harness.records.cells import CellRecord
from harness.studies.evidence.evidence_context import OBJECTED, TRAININGS, WITHOUT_SILHOUETTES
from harness.studies.evidence.objections import OBJECTIONS, amplifier_after_training, objections, octaves
from harness.studies.trained_context import StudyRun
from scenes.catalog.entries import CLASSICS
from tests.harness.cells import cell, checkpoint
from tests.harness.studies.evidence.planted import context_of, effect, sentences, table
from tests.replacing import replace

GAINS = {"qnerf": 0.4, "nerf_released": -0.3, "qnerf_shifted": 1.0}


def cells_of(methods: tuple[str, ...]) -> list[CellRecord]:
    draw = np.random.default_rng(3)
    made = []
    for place, scene in enumerate(CLASSICS):
        for seed in (0, 1):
            for method in methods:
                psnr = 24.0 + place + GAINS.get(method, 0.0) + draw.normal(0.0, 0.02)
                amplifier = {"alpha_phi": 1.1, "psnr_without_amplifier": -0.05} if method == "qnerf" else {}
                curve = [checkpoint(1000, 10.0, psnr, ssim=0.9)]
                made.append(cell(scene, method, seed, curve, scores={"psnr": psnr, "ssim": 0.9}, properties=amplifier))
    return made


def test_each_objection_has_its_difference_and_the_amplifier_its_sentence(tmp_path: Path) -> None:
    context = context_of(tmp_path, {"objections": cells_of(OBJECTED), "no_silhouettes": cells_of(WITHOUT_SILHOUETTES)})
    findings = list(objections(context))
    first, *others = sentences(findings)
    assert "α φ lies between 1.10 and 1.10 (16 trainings)" in first
    assert "to within 10 %" in first
    assert "−0.05 dB on average" in first
    for objection in OBJECTIONS:
        pair = f"{objection.words}: {objection.method} − {objection.against} is"
        assert any(words.startswith(pair) for words in others)
    truth = GAINS["qnerf"] - GAINS["nerf_released"]
    assert effect(findings, "qnerf", "nerf_released").difference == pytest.approx(truth, abs=0.03)
    assert len(table(findings, "taken_out").rows) == len(CLASSICS)


def test_without_an_amplifier_there_is_nothing_to_take_out() -> None:
    assert amplifier_after_training(cells_of(("nerf",))) == "No trained method has an amplifier."


def test_octaves_are_those_of_the_two_encodings(tmp_path: Path) -> None:
    """A box of half extent π would have the same reach: 2^k x against 2^k π x / h."""
    run = context_of(tmp_path, {"objections": cells_of(("nerf",))}).trained("objections")
    halves = (math.pi, math.pi / 2)
    boxed = [
        replace(scene, bounds=[[-half] * 3, [half] * 3]) for scene, half in zip(run.scenes[:2], halves, strict=True)
    ]
    assert "lies 0.0 to 1.0 octaves below" in octaves(StudyRun(run.plan, boxed, run.cells))


def test_what_is_objected_to_is_trained_on_all_scenes() -> None:
    for objection in OBJECTIONS:
        training = TRAININGS[objection.training]
        assert {objection.method, objection.against} <= set(training.methods) <= set(CATALOG)
        assert training.scenes == tuple(CLASSICS)
    assert set(TRAININGS["no_silhouettes"].need) == {"outside_hull", "background_rays"}
