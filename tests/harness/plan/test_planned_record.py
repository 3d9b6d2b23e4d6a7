"""What the record of a run states of its departures from the paper, and of what it does not test."""

from dataclasses import replace

from harness.command.plan_options import planned
from harness.plan.planned_record import deviations, not_tested
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan


def beginning(plan: Plan, words: str, **notes: tuple[str, ...]) -> list[str]:
    return [sentence for sentence in deviations(plan, notes) if sentence.startswith(words)]


def test_the_control_is_named_only_where_it_takes_part() -> None:
    for methods, words in (
        (("nerf", "nerf_matched", "qnerf"), "bandwidth, which is why nerf_matched is shown for comparison."),
        (("nerf", "qnerf"), "reward low bandwidth."),
    ):
        (sentence,) = (one for one in not_tested(replace(PROFILES["reduced"], methods=methods)) if "bandwidth" in one)
        assert sentence.endswith(words)


def test_rays_through_covered_pixels_are_a_deviation_that_is_said() -> None:
    plan = PROFILES["full"]
    assert not beginning(plan, "0%")
    assert beginning(replace(plan, train=replace(plan.train, covered_share=0.7)), "70% of the rays")


def test_whoever_cannot_leave_out_hidden_points_is_named() -> None:
    words = "Points behind matter"
    (sentence,) = beginning(planned("reduced", methods=["nerf", "qnerf", "qnerf_repaired"]), words)
    assert "In qnerf it depends on" in sentence
    assert not beginning(planned("reduced", methods=["nerf", "qnerf_repaired"]), words)
    assert not beginning(planned("reduced", without=["hidden"]), words)


def test_what_the_reader_of_images_noted_and_what_was_forced_is_said_once() -> None:
    plan = planned("reduced", need=["view_direction"])
    notes = {"ball": ("No alpha.",), "cup": ("No alpha.", "No test views.")}
    assert beginning(plan, "Of the view set of", **notes) == [
        "Of the view set of ball, cup: No alpha.",
        "Of the view set of cup: No test views.",
    ]
    assert len(beginning(plan, "Forced by --need, whatever the scene needs: kept are ")) == 1


def test_a_loss_or_schedule_of_its_own_is_stated_with_the_method() -> None:
    plan = planned("reduced", methods=["nerf", "qnerf"])
    assert not beginning(plan, "qnerf: It trains with")
    own = plan.own_settings(["qnerf"])["qnerf"]
    own = replace(own, loss="huber", learning_rate=0.003)
    (sentence,) = beginning(replace(plan, train=replace(plan.train, own={"qnerf": own})), "qnerf: It trains with")
    assert "loss huber, learning_rate 0.003, the other methods" in sentence
