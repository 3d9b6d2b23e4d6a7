"""Error against work when one trained field is rendered: every quadrature rule and every sampler."""

import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import Sampling, render_rays
from harness.execution.ground_truth import read_views, view_set_folders
from harness.machine.device import use_threads
from harness.plan.needed import for_scene
from harness.plan.profiles import Plan
from harness.plan.seeds import generator_for
from harness.records.study import Series, Table, check
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import EvidenceContext, folder_of, is_of_another_plan
from harness.studies.framework import Found
from harness.studies.stability.rays.quadrature_orders import fitted_order
from harness.training.checkpoints import checkpoint_path, load_checkpoint, save_checkpoint
from harness.training.evaluate import cameras_of
from harness.training.lockstep import box_of, needs_view_direction, stream_of, trained_alone
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

MEASURES = ("colour", "opacity")


class EmptyOutside:
    """A field without density outside of its box, whose integral along a ray is the same, cut to the box or not."""

    def __init__(self, inner: RadianceField, box: Box) -> None:
        self.inner = inner
        self.box = box

    @property
    def pointwise(self) -> bool:
        return self.inner.pointwise

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays features"]:
        return self.inner.encode_directions(d)

    def density(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]:
        return self._inside(x, self.inner.density(x))

    def density_before_and_after(
        self, x: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
        before, after = self.inner.density_before_and_after(x)
        return self._inside(x, before), self._inside(x, after)

    def density_and_colour(
        self, x: Float[Tensor, "points 3"], view: Float[Tensor, "rays features"], ray: Int[Tensor, " points"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, "points 3"]]:
        sigma, colour = self.inner.density_and_colour(x, view, ray)
        return self._inside(x, sigma), colour

    def _inside(self, x: Tensor, sigma: Tensor) -> Tensor:
        # points on a face are the first and last ones of a ray that is cut to the box, and rounding moves them
        margin = 1e-5 * (self.box.upper - self.box.lower).max()
        within = ((x >= self.box.lower - margin) & (x <= self.box.upper + margin)).all(dim=-1)
        return torch.where(within, sigma, 0.0)


@dataclass(frozen=True)
class Sampler:
    """The placement of a ray's points."""

    name: str
    clipped: bool = True
    grid: bool = False
    early_stop: bool = False
    random: bool = False
    two_passes: bool = False
    """Whether a second pass is made: a quarter of the points spread evenly, half as many fenceposts as there are points
    drawn where those saw something, and a second pass over both: as many evaluations as one pass over all.
    """


SAMPLERS = (
    Sampler("near to far", clipped=False),
    Sampler("box"),
    Sampler("box, grid", grid=True),
    Sampler("box, grid, early stop", grid=True, early_stop=True),
    Sampler("box, random", random=True),
    Sampler("box, coarse and fine", two_passes=True),
)


@dataclass(frozen=True)
class Frame:
    """The rays to render; `near_to_far` is in its rays."""

    field: RadianceField
    rays: Rays
    box: Box
    grid: OccupancyGrid | None
    background: Float[Tensor, " 3"]
    chunk: int

    @torch.no_grad()
    def rendered(self, rule: str, sampler: Sampler, samples: int) -> tuple[Tensor, Tensor, int]:
        """Return display colour [rays, 3], opacity [rays] and network evaluations, with about `samples` points per
        ray.
        """
        bins = max(1, samples // QUADRATURES[rule].stride)
        sampling = Sampling(
            bins=max(1, bins // 4) if sampler.two_passes else bins,
            fine_bins=max(1, bins // 2) if sampler.two_passes else 0,
            quadrature=rule,
            clip_to_box=sampler.clipped,
            early_stop=sampler.early_stop,
        )
        fine = self.field if sampler.two_passes else None
        grid = self.grid if sampler.grid else None
        generator = generator_for("frame", samples) if sampler.random else None
        parts = [
            render_rays(
                self.field, fine, self.rays.part(start, start + self.chunk), self.box, sampling, grid,
                self.background, generator,
            )
            for start in range(0, len(self.rays), self.chunk)
        ]  # fmt: skip
        colour, opacity = (torch.cat([getattr(one, name) for one in parts]) for name in MEASURES)
        return colour, opacity, sum(one.network_evaluations for one in parts)


@dataclass
class Line:
    """One rule and sampler over growing numbers of samples."""

    rule: str
    sampler: str
    samples: list[int] = field(default_factory=list)
    error: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in MEASURES})
    evaluations: list[int] = field(default_factory=list)
    """The evaluations of the complete frame."""
    seconds: list[float] = field(default_factory=list)
    """The medians of the seconds."""

    def __str__(self) -> str:
        return f"{self.rule} ({self.sampler})"

    def cost_of(self, target: float, unit: str) -> float | None:
        """Return the least `seconds` or `evaluations` at which the error of colour is no more than `target`."""
        pairs = zip(getattr(self, unit), self.error["colour"], strict=True)
        return min((cost for cost, error in pairs if error <= target), default=None)

    def least(self, measure: str) -> float:
        """Return the least error. Raises `ValueError` if one is not finite, which a minimum would hide or be."""
        return min(self.finite(error) for error in self.error[measure])

    def finite(self, error: float) -> float:
        if not math.isfinite(error):
            raise ValueError(f"{self}: an error is not finite: {error}")
        return error

    def order(self, measure: str, floor: float) -> float | None:
        """Return the order, fitted over the finer half of the errors well above the reference's own."""
        clear = [(n, e) for n, e in zip(self.samples, self.error[measure], strict=True) if e > 3.0 * floor]
        finer = clear[len(clear) // 2 :] if len(clear) >= 6 else clear[-3:]
        return fitted_order([e for _, e in finer], tuple(n for n, _ in finer))


def rms(difference: Tensor) -> float:
    return float(difference.double().square().mean().sqrt())


def measured_lines(
    frame: Frame,
    rules: Iterable[str],
    samplers: Iterable[Sampler],
    samples: Sequence[int],
    reference: dict[str, Tensor],
    rounds: int,
    synchronise: Callable[[], object] = lambda: None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Line]:
    """Measure every rule with every sampler at each of `samples`, timed in turns: all of them once, then all again, …

    `reference` has `MEASURES`. Raises `ValueError` if an error is not finite.
    """
    lines = [(Line(rule, sampler.name), sampler) for rule in rules for sampler in samplers]
    for line, sampler in lines:
        frame.rendered(line.rule, sampler, min(samples))  # allocations, off the clock
    taken: dict[tuple[str, str, int], list[float]] = {}
    for number in range(rounds):
        for line, sampler in lines:
            for count in samples:
                synchronise()
                began = clock()
                colour, opacity, evaluations = frame.rendered(line.rule, sampler, count)
                synchronise()
                taken.setdefault((line.rule, line.sampler, count), []).append(clock() - began)
                if number == 0:
                    line.samples.append(count)
                    line.evaluations.append(evaluations)
                    line.error["colour"].append(line.finite(rms(colour - reference["colour"])))
                    line.error["opacity"].append(line.finite(rms(opacity - reference["opacity"])))
    for line, _ in lines:
        line.seconds += [statistics.median(taken[line.rule, line.sampler, count]) for count in line.samples]
    return [line for line, _ in lines]


SCENE, METHOD, TRAINING = "lego", "nerf", "no_encoding"
SAMPLES = (4, 8, 16, 32, 64, 128, 256, 512)
REFERENCE_SAMPLES = 4096
TARGETS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4)
NAMED_TARGETS = (1e-2, 1e-3)
OWN_ERROR = 1e-4
"""The largest error of the reference itself: a tenth of the smallest error that a sentence names as reached."""
ROUNDS = 3
STRIDE = 3
"""The stride of pixels: every third along both axes shows all parts of a view in a ninth of its rays."""
BY_RULE, BY_SAMPLER = "box", "midpoint"
"""The rule or sampler that stays the same when the other is varied."""


def trained_field(context: EvidenceContext) -> tuple[Trainer, ViewSet, str]:
    """Return `METHOD` as `TRAINING` leaves it, what it was trained on, and its origin in words. It is not trained again
    if the folder of the studies has it.
    """
    device, stream = torch.device(context.machine.device), stream_of(SCENE, 0)
    plan = context.plan(TRAINING)
    folder = view_set_folders(replace(plan, scenes=(SCENE,)), context.view_sets, context.show)[SCENE]
    views = read_views(folder, plan.views, context.scratch)
    run = folder_of(context.out, TRAINING)
    weights, origin = checkpoint_path(run, SCENE, METHOD, 0), f"checkpoint of the training {TRAINING}"
    if not weights.exists() or is_of_another_plan(run, plan):
        weights, origin = context.scratch / "field.safetensors", f"trained now, as {TRAINING} does"
        save_checkpoint(trained_alone(METHOD, views, stream, plan.train, plan.budget, device), weights)
    return restored(weights, plan, views, stream, METHOD, device), views, origin


def restored(weights: Path, plan: Plan, views: ViewSet, stream: str, method: str, device: torch.device) -> Trainer:
    """Return a trainer at the end of its budget, with the weights and the occupied cells of a checkpoint.

    It renders with float32 matrix multiplications, whatever the training used: their rounding is not examined here.
    """
    settings = replace(for_scene(plan.train, views), precision="float32")
    trainer = Trainer(method, box_of(views, device), settings, plan.budget, stream, device, needs_view_direction(views))
    load_checkpoint(trainer, weights, plan.budget.steps or settings.grid.first_step + 1)
    return trainer


def rendering_work(context: EvidenceContext) -> Iterator[Found]:
    machine = context.machine
    trained = trained_field(context)
    if machine.device == "cpu":
        use_threads(machine.workers * machine.threads)  # nothing else is measured meanwhile
    try:
        yield from _measured(context, *trained)
    finally:
        use_threads(machine.threads)


def _measured(context: EvidenceContext, trainer: Trainer, views: ViewSet, origin: str) -> Iterator[Found]:
    cameras = cameras_of(views, views.test, trainer.device)
    row, column = torch.meshgrid(
        *(torch.arange(STRIDE // 2, size, STRIDE, device=trainer.device) for size in (views.height, views.width)),
        indexing="ij",
    )
    view = torch.full((row.numel(),), len(cameras) // 2, device=trainer.device)
    rays = cameras.rays(view, column.flatten(), row.flatten())
    chunk = context.plan(TRAINING).score.chunk
    box = trainer.box
    frame = Frame(EmptyOutside(trainer.field, box), rays, box, trainer.grid, trainer.background, chunk)
    size = f"{column.shape[1]} × {row.shape[0]} rays of a test view of {SCENE}"

    finest = 1024 if context.quick else REFERENCE_SAMPLES
    sampler = next(one for one in SAMPLERS if one.name == BY_RULE)
    fine, coarse = (frame.rendered("midpoint", sampler, count) for count in (finest, finest // 2))
    reference = {"colour": fine[0], "opacity": fine[1]}
    own = {"colour": rms(fine[0] - coarse[0]), "opacity": rms(fine[1] - coarse[1])}
    synchronise: Callable[[], object] = torch.cuda.synchronize if trainer.device.type == "cuda" else lambda: None
    samples = SAMPLES[:3] if context.quick else SAMPLES
    lines = measured_lines(frame, QUADRATURES, SAMPLERS, samples, reference, ROUNDS, synchronise)
    yield from sentences(lines, f"{size} ({METHOD}, {origin})", len(rays))
    yield check(
        f"own error of the reference of {finest} samples a ray",
        own["colour"],
        high=OWN_ERROR,
        why=f"RMS difference of display colour from the rendering with half as many; opacity {own['opacity']:.1e}",
    )
    yield from _charts(lines, own, len(rays), size)
    yield tabled(lines, own, len(rays))


def fastest(lines: Sequence[Line], target: float, unit: str = "seconds") -> tuple[Line, float] | None:
    """Return the line that reaches an error of colour at the least cost, and that cost; None if none does."""
    costs = [(line, cost) for line in lines if (cost := line.cost_of(target, unit)) is not None]
    return min(costs, key=lambda one: one[1], default=None)


def sentences(lines: Sequence[Line], frame_words: str, rays: int) -> Iterator[str]:
    """Yield which combination is first, when that changes, and the error that the paper's rule and the grid leave."""
    first = []
    for target in NAMED_TARGETS:
        if best := fastest(lines, target):
            line, seconds = best
            work = (line.cost_of(target, "evaluations") or 0.0) / rays
            first.append(f"{line} reaches an error of {target:g} first ({seconds:.3g} s, {work:.3g} evaluations a ray)")
        else:
            first.append(f"none reaches an error of {target:g}")
    yield f"Of all rules and samplers, {' and '.join(first)}: a frame is {frame_words}."
    winners = [(target, best[0]) for target in TARGETS if (best := fastest(lines, target))]
    changes = [
        f"at {target:g} {after} overtakes {before}"
        for (_, before), (target, after) in pairwise(winners)
        if after is not before
    ]
    reached = f"from {winners[0][0]:g} to {winners[-1][0]:g}" if winners else "at no target"
    yield (
        f"The fastest combination {reached} changes {len(changes)} time{'s' * (len(changes) != 1)}: "
        f"{'; '.join(changes)}."
        if changes
        else f"The same combination is the fastest {reached}: the ranking's first place does not change."
    )
    thrifty = [
        f"{best[0]} is first at {target:g} ({best[1] / rays:.3g} a ray)"
        for target in NAMED_TARGETS
        if (best := fastest(lines, target, "evaluations"))
    ]
    if thrifty:
        yield f"By network evaluations, the same on every machine, {listed(thrifty)}."
    for rule in QUADRATURES:
        of_rule = [line for line in lines if line.rule == rule]
        if QUADRATURES[rule].of_the_paper and of_rule:
            colour, opacity = (min(line.least(name) for line in of_rule) for name in MEASURES)
            yield (
                f"{rule}, the paper's rule as printed, never comes below {colour:.2g} (colour) and {opacity:.2g} "
                "(opacity), whatever the samples: its last interval is endless and it has no background."
            )
    best_of = {line.sampler: line.least("colour") for line in lines if line.rule == BY_SAMPLER}
    if {"box", "box, random"} <= set(best_of):
        even, random = best_of["box"], best_of["box, random"]
        why = ", as spacing would that aliases with frequencies of the encoding" if even > 1.5 * random else ""
        yield f"With {BY_SAMPLER}, evenly spread points leave {even:.1e} at best and random ones {random:.1e}{why}."
    if {"box", "box, grid"} <= set(best_of):
        shows = best_of["box, grid"] > 2.0 * best_of["box"]
        cost = "costs an error that no number of samples takes away" if shows else "does not show"
        yield (
            f"What the occupancy grid skips {cost}: with {BY_SAMPLER} {best_of['box, grid']:.1e} is left at best, "
            f"{best_of['box']:.1e} without the grid."
        )


def _charts(lines: Sequence[Line], own: dict[str, float], rays: int, size: str) -> Iterator[Series]:
    """Yield rules with one sampler and samplers with one rule, against seconds and against evaluations."""
    views = (
        (f"Rules, sampler: {BY_RULE}", {one.rule: one for one in lines if one.sampler == BY_RULE}),
        (f"Samplers, rule: {BY_SAMPLER}", {one.sampler: one for one in lines if one.rule == BY_SAMPLER}),
    )
    costs = {"seconds": (f"seconds a frame ({size})", 1), "evaluations": ("network evaluations a ray", rays)}
    labels = {"colour": "RMSE of display colour", "opacity": "RMSE of opacity"}
    for (title, shown), measure, unit in product(views, MEASURES, costs):
        panel, (x_label, share), y_label = f"{title}; {measure} against {unit}", costs[unit], labels[measure]
        ends: list[float] = []
        for name, line in shown.items():
            x = [value / share for value in getattr(line, unit)]
            ends += x
            of_paper = name in QUADRATURES and QUADRATURES[name].of_the_paper
            full = f"{name} (the paper's)" if of_paper else name
            yield Series(panel, 0, full, x_label, y_label, x, list(line.error[measure]))
        ends = [min(ends), max(ends)]
        yield Series(panel, 0, "own error of the reference", x_label, y_label, ends, [own[measure]] * 2)


def tabled(lines: Sequence[Line], own: dict[str, float], rays: int) -> Table:
    """Return every combination: orders, the error that remains at the end, and the cost of 1e-2 and 1e-3."""
    columns = ["rule", "sampler", "order of colour", "order of opacity", "least error of colour", "of opacity",
               "s to 1e-2", "evaluations a ray", "s to 1e-3", "evaluations a ray"]  # fmt: skip
    rows: list[list[str | float | None]] = []
    for line in lines:
        orders = [line.order(name, own[name]) for name in MEASURES]
        costs: list[float | None] = []
        for target in NAMED_TARGETS:
            work = line.cost_of(target, "evaluations")
            costs += [line.cost_of(target, "seconds"), None if work is None else work / rays]
        rows.append([line.rule, line.sampler, *orders, *map(line.least, MEASURES), *costs])
    title = "Fitted orders in the number of samples, and what an error of display colour costs (none: not reached)"
    return Table("rendering_work", 0, title, columns, rows)
