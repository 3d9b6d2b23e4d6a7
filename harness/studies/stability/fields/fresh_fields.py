"""A6: whether a fresh field of each reading of the paper trains without the help that a run gives.

There are no silhouettes (no hull, no rays drawn through covered pixels) and no occupancy grid: pixels are drawn evenly
from views of a small ball on white, in a box of ±1.5, and Adam's rate is 5e-4. The network is the paper's, as the
change of its output in a step of Adam grows with its width. A field that is opaque at first hides the ball and learns
the colour of the background at once: white is the end of the range of a colour, where its sigmoid has no gradient. A
grey background, with a smaller network at ten times the rate, distinguishes this from the clamp of Listing 2.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.catalog import CATALOG
from baselines.contract import NO_ACCELERATION, Box, NetworkSize, Rays
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.study import Owner, Series, Table, check
from harness.studies.drawn_views import DISTANCE, FOV_X_RADIANS, poses
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields.small_training import CPU
from harness.studies.stability.stability_context import StabilityContext
from harness.training.batches import Batch, Cameras
from harness.training.learner import Job, steps
from harness.training.trainer import TRACE_EVERY, Trainer

STREAM = "stability/A6"
RADIUS = 0.5
"""The radius in scene units: the ball covers 9 % of a view. With 0.6, 15 % are covered and Listing 2 learns it."""
BALL = (0.5, 0.25, 0.15)
WHITE, GREY = 1.0, 0.8
VIEWS, PIXELS = 24, 32
HALF_EXTENT = 1.5
PAPER = TrainSettings(
    rays=32, bins=16, first_bins=16, fine_bins=0, last_learning_rate=5e-4, grid=GridSettings(cells=0),
    accelerations=replace(NO_ACCELERATION, clipping=True, directions=True),
)  # fmt: skip
SMALL = replace(
    PAPER, network=NetworkSize(6, 64, 2, 64, 6, 2), rays=48, bins=24, first_bins=24,
    learning_rate=5e-3, last_learning_rate=5e-3,
)  # fmt: skip
STEPS = 120
PROBES = 1024
LEARNT = 0.5
"""The share of the loss of a picture of only background below which a field has learnt something."""


@dataclass(frozen=True)
class FreshField:
    method: str
    unit: float
    """The unit of density, per half of the box."""
    start: float | None
    """The density of the fresh field, per half of the box; None without a shift."""
    owner: Owner
    settings: TrainSettings = PAPER
    background: float = WHITE


FRESH_FIELDS: dict[str, FreshField] = {
    "nerf": FreshField("nerf", 25.0, 0.3, "ours"),
    "nerf, no shift": FreshField("nerf", 25.0, None, "usual"),
    **{f"Listing 2, unit {unit:g}": FreshField("qnerf", unit, None, "paper") for unit in (25.0, 100.0, 1000.0)},
    "Listing 2, unit 25, small network": FreshField("qnerf", 25.0, None, "paper", SMALL),
    "Listing 2, unit 25, small network, grey": FreshField("qnerf", 25.0, None, "paper", SMALL, GREY),
    **{f"Listing 2 shifted, unit {unit:g}": FreshField("qnerf_shifted", unit, 0.3, "ours") for unit in (25.0, 100.0)},
    "Eq. 4 about a running mean": FreshField("qnerf_running_mean", 25.0, 0.3, "ours"),
    "Listing 2 about a running mean": FreshField("qnerf_running_mean_listing2", 25.0, 0.3, "ours"),
}


PANELS = {
    "error": ("error of a held-out view", "error / that of the background only"),
    "largest": ("largest density", "per half box"),
    "gradient": ("norm of the gradient", "norm"),
    "clamped": ("density of exactly 0", "share of points"),
    "white": ("colour of exactly 1", "share of points"),
}
"""Record of a training → its title and unit. No gradient passes where a density is exactly 0 or a colour exactly 1."""


def cameras(pixels: int) -> Cameras:
    focal = 0.5 * pixels / math.tan(0.5 * FOV_X_RADIANS)
    return Cameras.of(poses(VIEWS, 0.0), pixels, pixels, focal, DISTANCE - 2.0, DISTANCE + 2.0)


def ball(rays: Rays, background: float = WHITE) -> Float[Tensor, "rays 3"]:
    along = (rays.origins * rays.directions).sum(-1, keepdim=True)
    hit = along.square() - rays.origins.square().sum(-1, keepdim=True) + RADIUS**2 > 0.0
    return torch.where(hit, torch.tensor(BALL), torch.full((3,), background))


def batches(count: int, background: float = WHITE) -> Callable[[int], Batch]:
    seen = cameras(PIXELS)

    def batch_at(step: int) -> Batch:
        drawn = torch.randint(VIEWS * PIXELS**2, (count,), generator=generator_for(STREAM, step))
        rays = seen.rays(drawn // PIXELS**2, drawn % PIXELS, drawn // PIXELS % PIXELS)
        return Batch(rays, ball(rays, background))

    return batch_at


def course_of(fresh: FreshField, count: int) -> dict[str, list[float]]:
    """Train for `count` steps; return the records of `PANELS` at each recorded `step`."""
    side = torch.full((3,), HALF_EXTENT)
    own = replace(CATALOG[fresh.method].settings, density_scale=fresh.unit, start=fresh.start)
    settings = replace(fresh.settings, own={fresh.method: own})
    trainer = Trainer(Job(fresh.method, Box(-side, side), settings, Budget(count, None), STREAM, CPU, False))
    trainer.background = torch.full((3,), fresh.background)
    held_out = cameras(PIXELS // 2).all_rays(VIEWS // 2)
    truth = ball(held_out, fresh.background)
    background_error = float((fresh.background - truth).square().mean())
    points = HALF_EXTENT * (torch.rand(PROBES, 3, generator=generator_for(STREAM, "probes")) - 0.5)
    course: dict[str, list[float]] = {record: [] for record in ("step", *PANELS)}
    for _ in steps(trainer, batches(settings.rays, fresh.background)):
        if trainer.trace["step"][-1] != trainer.step:
            continue
        with torch.no_grad():
            view = trainer.field.encode_directions(torch.zeros(1, 3))
            ray = torch.zeros(PROBES, dtype=torch.long)
            density, (_, colour) = trainer.field.density(points), trainer.field.density_and_colour(points, view, ray)
            error = (trainer.render(held_out, len(held_out)).colour - truth).square().mean()
        course["step"].append(float(trainer.step))
        course["error"].append(float(error) / background_error)
        course["largest"].append(float(density.max()) * HALF_EXTENT)
        course["gradient"].append(trainer.trace["gradient_norm"][-1] or 0.0)
        course["clamped"].append(float((density == 0.0).float().mean()))
        course["white"].append(float((colour == 1.0).all(dim=-1).float().mean()))
    return course


def fresh_fields(context: StabilityContext) -> Iterator[Found]:
    count = TRACE_EVERY if context.quick else STEPS
    rows: Rows = []
    for name, fresh in FRESH_FIELDS.items():
        if context.quick:
            fresh = replace(fresh, settings=replace(SMALL, network=NetworkSize(6, 16, 2, 16, 6, 2)))
        course = course_of(fresh, count)
        ends = {record: course[record][-1] for record in PANELS}
        rows.append([name, *ends.values()])
        why = (
            f"in the middle of the box density ends at {ends['largest']:.2g} per half box, is exactly 0 at "
            f"{100 * ends['clamped']:.0f} % of the points and colour exactly 1 at {100 * ends['white']:.0f} %; the "
            f"gradient's norm ends at {ends['gradient']:.1e}"
        )
        what = f"smallest error of a held-out view in {count} steps, relative to that of the background only"
        high = None if context.quick else LEARNT  # nothing is learnt in so few steps
        yield check(what, min(course["error"]), high=high, why=why, subject=name, owner=fresh.owner)
        for record, (title, unit) in PANELS.items():
            panel, log_y = f"A fresh field without help: {title}", "share" not in unit
            yield Series(panel, 6, name, "step", unit, course["step"], course[record], log_x=False, log_y=log_y)
    columns = ["reading", *(f"{title}, {unit}" for title, unit in PANELS.values())]
    title = f"A fresh field without silhouettes and without an occupancy grid, after {count} steps of Adam"
    yield Table("fresh-fields", 6, title, columns, rows)
