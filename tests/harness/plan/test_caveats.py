"""What a run says of itself that it does not test."""

from dataclasses import replace

from harness.plan.caveats import deviations, not_tested
from harness.plan.profiles import PROFILES, Plan, planned


def test_the_control_is_named_only_where_it_takes_part() -> None:
    plan = PROFILES["reduced"]
    with_it = replace(plan, methods=("nerf", "nerf_matched", "qnerf"))
    assert any("nerf_matched is shown for comparison" in one for one in not_tested(with_it))
    without = not_tested(replace(plan, methods=("nerf", "qnerf")))
    assert any("reward low bandwidth." in one for one in without)
    assert not any("nerf_matched" in one for one in without)


def test_the_ablation_is_left_to_the_ledger_which_knows_what_lies_beside() -> None:
    assert not any("ablation" in one for one in not_tested(replace(PROFILES["reduced"], methods=("nerf", "qnerf"))))


def test_rays_through_covered_pixels_are_a_deviation_that_is_said() -> None:
    plan = PROFILES["full"]
    assert not any("covered pixels" in sentence for sentence in deviations(plan))
    chosen = replace(plan, train=replace(plan.train, covered_share=0.7))
    (sentence,) = (sentence for sentence in deviations(chosen) if "covered pixels" in sentence)
    assert sentence.startswith("70% of the rays")


def test_whoever_cannot_leave_out_hidden_points_is_named() -> None:
    def told(plan: Plan) -> list[str]:
        return [sentence for sentence in deviations(plan) if sentence.startswith("Points behind matter")]

    (sentence,) = told(planned("reduced", methods=["nerf", "qnerf", "qnerf_repaired"]))
    assert "In qnerf it depends on" in sentence
    assert not told(planned("reduced", methods=["nerf", "qnerf_repaired"]))
    assert not told(planned("reduced", without=["hidden"]))
