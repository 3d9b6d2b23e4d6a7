"""How much of a picture is the amplifier: what taking Eq. 4 out changes, and that training keeps what it learnt."""

from contextlib import suppress

import pytest
import torch

from baselines.amplifiers import without_effect
from baselines.numerics.encoding import PHI
from harness.training.scoring import evaluate
from harness.training.scoring.amplifier_effect import amplifier_effect
from scenes.view_sets.view_set import ViewSet
from tests.harness.tiny import CPU, train, trainer

CHUNK = 64


def effect_of(method: str, alpha: float, ball: ViewSet) -> dict[str, float | None]:
    learner = train(trainer(method), 3)
    amplifier = learner.field.amplifier
    if hasattr(amplifier, "alpha"):
        with torch.no_grad():
            amplifier.alpha.fill_(alpha)
            if hasattr(amplifier, "beta"):
                amplifier.beta.fill_(1.0)
    cameras = evaluate.cameras_of(ball, ball.test, CPU)
    images = evaluate.render_split(learner, cameras, CHUNK)
    scored = [evaluate.view_scores(image, ball.test, index).psnr for index, image in enumerate(images)]
    return amplifier_effect(learner, cameras, ball.test, scored, CHUNK)


def test_a_method_without_an_amplifier_has_none(ball: ViewSet) -> None:
    assert effect_of("nerf", 1.0, ball) == {}


@pytest.mark.parametrize("method", ["qnerf", "qnerf_theorem", "qnerf_running_mean", "qnerf_running_mean_listing2"])
def test_at_the_identity_nothing_is_taken_out(method: str, ball: ViewSet) -> None:
    found = effect_of(method, 1.0 / PHI, ball)
    assert found["alpha_phi"] == pytest.approx(1.0)
    assert found["psnr_without_amplifier"] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("method", ["qnerf", "qnerf_running_mean_listing2"])
def test_a_strong_contrast_is_seen(method: str, ball: ViewSet) -> None:
    found = effect_of(method, 2.0 / PHI, ball)
    assert found["alpha_phi"] == pytest.approx(2.0)
    assert abs(found["psnr_without_amplifier"] or 0.0) > 1e-3


def test_what_was_learnt_is_put_back_even_after_an_error() -> None:
    amplifier = trainer("qnerf").field.amplifier
    with torch.no_grad():
        amplifier.alpha.fill_(0.9)
        amplifier.beta.fill_(1.3)
    with suppress(KeyError), without_effect([amplifier, None]):
        assert (amplifier.alpha.item(), amplifier.beta.item()) == (pytest.approx(1.0 / PHI), 1.0)
        raise KeyError
    assert (amplifier.alpha.item(), amplifier.beta.item()) == (pytest.approx(0.9), pytest.approx(1.3))
