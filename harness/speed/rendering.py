"""Question 4: seconds of a whole rendered view."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from baselines.accelerations import NO_ACCELERATION
from harness.evaluate import cameras_of, render_view
from harness.lockstep import box_of
from harness.speed.situation import Situation, paper_settings, reduced_plan, views_of
from harness.speed.timing import interleaved, measured, quotients
from harness.speed.trained import new_trainer, trained_reduced, variant_of
from harness.speed_record import Measurement

ITEM = 4


def measure(situation: Situation) -> Iterator[Measurement]:
    """The same weights, with and without; and the paper's network, every sample evaluated."""
    views = views_of(situation, "lego")
    cameras = cameras_of(views, views.test, situation.device)
    # with directions on both sides, as a field without them is another one
    fast = trained_reduced(situation, view_dependent=True)
    slow = variant_of(fast, situation, NO_ACCELERATION)
    paper = paper_settings(situation)
    dense = new_trainer(situation, paper, box_of(views, situation.device), view_dependent=True)
    plain = new_trainer(
        situation,
        replace(paper, precision="float32", accelerations=NO_ACCELERATION),
        box_of(views, situation.device),
        view_dependent=True,
    )
    plan = reduced_plan(situation)
    chunk = plan.score.chunk
    view = len(cameras) // 2
    pixels = f"{cameras.width} × {cameras.height}"
    seconds = interleaved(
        {name: partial(render_view, one, cameras, view, chunk) for name, one in (("on", fast), ("off", slow))},
        situation.repeats(7),
        situation.synchronise,
        0.1,
    )
    settings = f"reduced settings after {fast.step} steps, {plan.train.precision} on both sides, chunks of {chunk} rays"
    yield measured(
        "rendering.reduced.ratio",
        ITEM,
        f"A view of {pixels}, accelerations on against off",
        quotients(seconds["off"], seconds["on"]),
        "×",
        detail=settings,
    )
    for name, title in (("on", "all accelerations"), ("off", "none")):
        yield measured(
            f"rendering.reduced.{name}.seconds",
            ITEM,
            f"A view of {pixels}, {title}",
            seconds[name],
            "s",
            detail=settings,
        )
    whole = interleaved(
        {name: partial(render_view, one, cameras, view, chunk) for name, one in (("on", dense), ("off", plain))},
        situation.repeats(3),
        situation.synchronise,
    )
    words = f"{paper.network.depth} × {paper.network.width}, {paper.bins} samples a ray, every one evaluated"
    yield measured(
        "rendering.paper.ratio",
        ITEM,
        f"A view of {pixels}, paper's network, {paper.precision} against float32 without accelerations",
        quotients(whole["off"], whole["on"]),
        "×",
        detail=words,
    )
    yield measured(
        "rendering.paper.seconds", ITEM, f"A view of {pixels}, paper's network", whole["on"], "s", detail=words
    )
