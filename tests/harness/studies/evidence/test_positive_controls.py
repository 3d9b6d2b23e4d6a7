"""Known losses, planted: found if they exist, reported if they do not, not applicable if nothing is missing."""

import pytest

from harness.records.cells import CellRecord
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import TRAININGS
from harness.studies.evidence.positive_controls import CONTROLS, HISTORY, positive_controls
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.evidence import planted
from tests.harness.studies.evidence.planted import Planted, checks, effect, effects, sentences
from tests.replacing import replace

LOSSES = {
    "nerf_no_encoding": 2.0,
    "nerf_no_direction": 3.0,
    "half_images": 1.0,
    "quarter_images": 2.5,
    "steps_850": 0.35,
    "steps_930": 0.15,
}
SCENES = ("drums", "lego", "materials")


def run(scene: str, method: str, seed: int, last: float) -> CellRecord:
    curve = [checkpoint(60, 6.0, last - 5, ssim=0.7), checkpoint(600, 60.0, last, ssim=0.8)]
    return cell(scene, method, seed, curve, scores={"psnr": last, "ssim": 0.8})


def context_of(losses: dict[str, float], without: tuple[str, ...] = (), **others: list[CellRecord]) -> Planted:
    """Three scenes, three seeds."""
    cells = {}
    for name in dict.fromkeys(name for control in CONTROLS for name in (control.baseline, control.training)):
        methods = {"nerf": losses.get(name, 0.0)}
        if f"nerf_{name}" in ("nerf_no_encoding", "nerf_no_direction"):
            methods |= {f"nerf_{name}": losses[f"nerf_{name}"]}
        cells[name] = [
            run(scene, method, seed, 25.0 + k + 0.1 * seed - loss * (1 + 0.1 * k) + 0.01 * ((seed + k) % 2) * loss)
            for k, scene in enumerate(SCENES)
            for method, loss in methods.items()
            for seed in range(3)
        ]
    return planted.context_of({**cells, **others}, without=without)


def test_known_losses_are_found() -> None:
    findings = list(positive_controls(context_of(LOSSES)))
    assert all(check.holds for check in checks(findings))
    assert str(findings[0]).startswith("Yes")
    assert {each.name for each in effects(findings)} == {control.name for control in CONTROLS}
    # nerf with fewer images is a separate run with another clock
    assert {each.budget for each in effects(findings) if "images" in each.name} == {"steps"}
    assert effect(findings, "nerf_half_images", "nerf").difference == pytest.approx(-1.1, abs=0.05)


@pytest.mark.parametrize(
    ("control", "loss", "held"),
    [
        ("half_images", 0.0, [False, False]),
        ("nerf_no_encoding", -2.0, [False, False]),
        ("nerf_no_encoding", 15.0, [True, False]),
    ],
)
def test_a_loss_that_is_missing_a_gain_or_absurd_fails(control: str, loss: float, held: list[bool]) -> None:
    findings = list(positive_controls(context_of({**LOSSES, control: loss})))
    words = "half of the images" if control == "half_images" else "positional"
    assert [check.holds for check in checks(findings) if words in check.what] == held
    assert all(check.holds for check in checks(findings) if words not in check.what)
    assert str(findings[0]).startswith("Yes" if held[0] else "In part")


def test_a_scene_that_needs_no_view_direction_has_no_pair() -> None:
    findings = list(positive_controls(context_of(LOSSES, without=("lego",))))
    pairs = {(each.scene, each.unpaired) for each in effects(findings) if each.name == "nerf_no_direction"}
    assert pairs == {("all", 0), ("drums", 0), ("materials", 0)}
    assert any("No view direction is needed on lego" in sentence for sentence in sentences(findings))
    nowhere = list(positive_controls(context_of(LOSSES, without=SCENES)))
    missing = [check for check in checks(nowhere) if "view direction" in check.what]
    assert [(check.value, check.holds) for check in missing] == [(None, False)] * 2
    assert any("not applicable" in sentence for sentence in sentences(nowhere))


def test_a_lost_run_keeps_the_loss_from_being_found() -> None:
    quarter = [diverged(scene, "nerf", seed) for scene in SCENES for seed in range(3)]
    findings = positive_controls(context_of(LOSSES, quarter_images=quarter))
    lost = [(check.value, check.holds) for check in checks(findings) if "quarter" in check.what]
    assert lost == [(0.0, False), (None, False)]


def test_a_small_loss_is_judged_at_the_end_of_its_own_steps_with_its_power() -> None:
    here = context_of(LOSSES)
    short = [replace(cell, steps=510) for cell in here.cells["steps_850"]]
    findings = list(positive_controls(context_of(LOSSES, steps_850=short)))
    small = effect(findings, "nerf_850_steps", "nerf")
    assert small.difference == pytest.approx(-0.385, abs=0.01)
    power = f"A loss of {small.smallest_detectable:.2f} dB would be found in 80 %"
    assert any("15 % fewer steps" in sentence and power in sentence for sentence in sentences(findings))


def test_it_is_said_that_the_design_was_changed_after_results() -> None:
    """The current figures are those of the plans."""
    assert HISTORY in list(positive_controls(context_of(LOSSES)))
    images = [TRAININGS[name] for name in ("images", "half_images", "quarter_images")]
    views, direction = [str(training.train_views) for training in images], TRAININGS["no_direction"]
    assert f"now there are {listed(views)} at {images[0].steps} steps" in HISTORY
    seeds = f"{direction.steps} steps with {len(direction.seeds)} seeds on {listed(direction.scenes)}."
    assert f"now it is tried at {seeds}" in HISTORY
