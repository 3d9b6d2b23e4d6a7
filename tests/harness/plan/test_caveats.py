"""What a run says of itself that it does not test."""

from dataclasses import replace

from harness.plan.caveats import deviations, not_tested
from harness.plan.profiles import PROFILES


def test_the_control_is_named_only_where_it_takes_part() -> None:
    plan = PROFILES["reduced"]
    with_it = replace(plan, methods=("nerf", "nerf_matched", "qnerf"))
    assert any("nerf_matched stands beside" in one for one in not_tested(with_it))
    without = not_tested(replace(plan, methods=("nerf", "qnerf")))
    assert any("reward low bandwidth." in one for one in without)
    assert not any("nerf_matched" in one for one in without)


def test_the_ablation_is_left_to_the_ledger_which_knows_what_lies_beside() -> None:
    assert not any("ablation" in one for one in not_tested(replace(PROFILES["reduced"], methods=("nerf", "qnerf"))))


def test_rays_chosen_by_attention_are_a_deviation_that_is_said() -> None:
    plan = PROFILES["reduced"]
    said = [one for one in deviations(plan) if "chosen by attention" in one]
    assert said == []
    attended = replace(plan, train=replace(plan.train, ray_attention="gradients"))
    (sentence,) = (one for one in deviations(attended) if "chosen by attention" in one)
    assert "50% of each batch" in sentence
    assert "different comparison" in sentence
