"""Error against work when one trained field is rendered: every quadrature rule and every sampler."""

import math
import statistics
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, Densities, Points, RadianceField, RayOf, Rays, Views
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import Sampling, render_rays
from harness.machine.device import use_threads
from harness.machine.stopwatch import Stopwatch
from harness.plan.seeds import generator_for
from harness.playback.run_loader import FinishedRun
from harness.records.study import Series, Table, check
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found, Rows
from harness.studies.power_laws import fitted_power
from harness.studies.trained_context import folder_of
from harness.training.scoring.evaluate import cameras_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

MEASURES = ("colour", "opacity")


class EmptyOutside:
    """A field without density outside its box: its integral along a ray is the same if the ray is cut to the box."""

    def __init__(self, inner: RadianceField, box: Box) -> None:
        # the first and last points of a ray that is cut to the box lie on a face, and rounding moves them
        margin = 1e-5 * (box.upper - box.lower).max()
        self.lower, self.upper = box.lower - margin, box.upper + margin
        self.inner, self.pointwise = inner, inner.pointwise

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Views:
        return self.inner.encode_directions(d)

    def density(self, x: Points) -> Densities:
        return self._inside(x, self.inner.density(x))

    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        before, after = self.inner.density_before_and_after(x)
        return self._inside(x, before), self._inside(x, after)

    def density_and_colour(self, x: Points, view: Views, ray: RayOf) -> tuple[Densities, Float[Tensor, "points 3"]]:
        sigma, colour = self.inner.density_and_colour(x, view, ray)
        return self._inside(x, sigma), colour

    def _inside(self, x: Tensor, sigma: Tensor) -> Tensor:
        return torch.where(((x >= self.lower) & (x <= self.upper)).all(dim=-1), sigma, 0.0)


@dataclass(frozen=True)
class Sampler:
    """The placement of a ray's points."""

    name: str
    clipped: bool = True
    grid: bool = False
    early_stop: bool = False
    random: bool = False
    two_passes: bool = False
    """Whether a second pass is made. A quarter of the points are spread evenly; half as many fenceposts as there are
    points are drawn where the first ones saw something; the second pass takes both. The evaluations are those of one
    pass over all points.
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
    """The rays to render, with near and far, and what they are rendered with."""

    field: RadianceField
    rays: Rays
    box: Box
    grid: OccupancyGrid | None
    background: Float[Tensor, " 3"]
    chunk: int

    @torch.no_grad()
    def render(self, rule: str, sampler: Sampler, samples: int) -> tuple[dict[str, Tensor], int]:
        """Return display colour [rays, 3], opacity [rays] and the evaluations, with about `samples` points per ray."""
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
        pictures = {name: torch.cat([getattr(part, name) for part in parts]) for name in MEASURES}
        return pictures, sum(part.network_evaluations for part in parts)


@dataclass
class Line:
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
        """Return the smallest `seconds` or `evaluations` at which the error of colour is at most `target`."""
        pairs = zip(getattr(self, unit), self.error["colour"], strict=True)
        return min((cost for cost, error in pairs if error <= target), default=None)

    def order(self, measure: str, floor: float) -> float | None:
        """Return the order of convergence, fitted to the finer half of the errors well above the reference's own."""
        clear = [(n, e) for n, e in zip(self.samples, self.error[measure], strict=True) if e > 3.0 * floor]
        finer = clear[len(clear) // 2 :] if len(clear) >= 6 else clear[-3:]
        return -fitted_power(*zip(*finer, strict=True))[0] if len(finer) >= 3 else None


def rms(difference: Tensor) -> float:
    return float(difference.double().square().mean().sqrt())


def measure_lines(
    frame: Frame,
    rules: Iterable[str],
    samplers: Iterable[Sampler],
    samples: Sequence[int],
    reference: dict[str, Tensor],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Line]:
    """Measure every rule with every sampler at each of `samples`, in turns: all of them once, then all again, …

    `reference` has `MEASURES`. Raises `ValueError` if an error is not finite, as `min` could hide it.
    """
    lines = [(Line(rule, sampler.name), sampler) for rule, sampler in product(rules, samplers)]
    for line, sampler in lines:
        frame.render(line.rule, sampler, min(samples))  # allocates, off the clock
    taken: dict[tuple[str, int], list[float]] = defaultdict(list)
    for number, (line, sampler), count in product(range(rounds), lines, samples):
        watch = Stopwatch(frame.background.device, clock)
        with watch.running():
            pictures, evaluations = frame.render(line.rule, sampler, count)
        taken[str(line), count].append(watch.seconds)
        if number == 0:
            line.samples.append(count)
            line.evaluations.append(evaluations)
            for name, picture in pictures.items():
                error = rms(picture - reference[name])
                if not math.isfinite(error):
                    raise ValueError(f"{line}: an error is not finite: {error}")
                line.error[name].append(error)
    for line, _ in lines:
        line.seconds += [statistics.median(taken[str(line), count]) for count in samples]
    return [line for line, _ in lines]


SCENE, METHOD, TRAINING = "lego", "nerf", "no_encoding"
SAMPLES = (4, 8, 16, 32, 64, 128, 256, 512)
REFERENCE_SAMPLES = 4096
TARGETS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4)
NAMED_TARGETS = (1e-2, 1e-3)
OWN_ERROR = 1e-4
"""The limit of the reference's own error: a tenth of the smallest error that a sentence names as reached."""
ROUNDS = 3
STRIDE = 3
"""The stride of pixels: every third along both axes covers all parts of a view with a ninth of its rays."""
BY_RULE, BY_SAMPLER = "box", "midpoint"
"""The sampler and the rule that are kept while the other is varied."""


def trained_field(context: EvidenceContext) -> tuple[Trainer, ViewSet]:
    """Return `METHOD` as trained by `TRAINING`, and its views.

    It renders with float32 matrix multiplications even if the training did not: their rounding is not examined here.
    """
    context.trained(TRAINING)
    run = FinishedRun.of(folder_of(context.out, TRAINING))
    (scene,) = run.scenes([SCENE])
    trainer = run.trained(scene, METHOD, 0, torch.device(context.machine.device)).learner
    assert isinstance(trainer, Trainer)
    trainer.field.dtype = torch.float32
    return trainer, run.views(scene, context.view_sets, geometry=False, scratch=context.scratch)


def rendering_work(context: EvidenceContext) -> Iterator[Found]:
    trainer, views = trained_field(context)
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
    sampler = next(sampler for sampler in SAMPLERS if sampler.name == BY_RULE)
    samples, machine = SAMPLES[:3] if context.quick else SAMPLES, context.machine
    use_threads(machine.workers * machine.threads)  # nothing else is measured meanwhile
    try:
        reference, coarser = (frame.render("midpoint", sampler, count)[0] for count in (finest, finest // 2))
        lines = measure_lines(frame, QUADRATURES, SAMPLERS, samples, reference, ROUNDS)
    finally:
        use_threads(machine.threads)
    own = {name: rms(reference[name] - coarser[name]) for name in MEASURES}
    yield from sentences(lines, f"{size} ({METHOD}, checkpoint of the training {TRAINING})", len(rays))
    yield check(
        f"own error of the reference of {finest} samples per ray",
        own["colour"],
        high=OWN_ERROR,
        why=f"RMS difference of display colour from the rendering with half as many; opacity {own['opacity']:.1e}",
    )
    yield from _charts(lines, own, len(rays), size)
    yield table_of(lines, own, len(rays))


def fastest(lines: Sequence[Line], target: float) -> tuple[Line, float] | None:
    """Return the line that reaches an error of colour first, and its seconds; None if none does."""
    costs = [(line, seconds) for line in lines if (seconds := line.cost_of(target, "seconds")) is not None]
    return min(costs, key=lambda pair: pair[1], default=None)


def sentences(lines: Sequence[Line], frame_words: str, rays: int) -> Iterator[str]:
    first = []
    for target in NAMED_TARGETS:
        if best := fastest(lines, target):
            line, seconds = best
            work = (line.cost_of(target, "evaluations") or 0.0) / rays
            first.append(
                f"{line} reaches an error of {target:g} first ({seconds:.3g} s, {work:.3g} evaluations per ray)"
            )
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
    for rule in QUADRATURES:
        of_rule = [line for line in lines if line.rule == rule]
        if QUADRATURES[rule].of_the_paper and of_rule:
            colour, opacity = (min(min(line.error[name]) for line in of_rule) for name in MEASURES)
            yield (
                f"{rule}, the paper's rule as printed, never comes below {colour:.2g} (colour) and {opacity:.2g} "
                "(opacity) with any number of samples: its last interval is infinite and it has no background."
            )
    least = {line.sampler: min(line.error["colour"]) for line in lines if line.rule == BY_SAMPLER}
    if {"box", "box, random"} <= set(least):
        even, random = least["box"], least["box, random"]
        why = ", as if even spacing aliased with the encoding's frequencies" if even > 1.5 * random else ""
        yield f"With {BY_SAMPLER}, evenly spread points leave {even:.1e} at best and random ones {random:.1e}{why}."
    if {"box", "box, grid"} <= set(least):
        shows = least["box, grid"] > 2.0 * least["box"]
        cost = "costs an error that no number of samples removes" if shows else "does not show"
        yield (
            f"What the occupancy grid skips {cost}: with {BY_SAMPLER} at least {least['box, grid']:.1e} remains, "
            f"{least['box']:.1e} without the grid."
        )


def _charts(lines: Sequence[Line], own: dict[str, float], rays: int, size: str) -> Iterator[Series]:
    labels = {rule: f"{rule} (the paper's)" if QUADRATURES[rule].of_the_paper else rule for rule in QUADRATURES}
    views = (
        (f"Rules, sampler: {BY_RULE}", {labels[line.rule]: line for line in lines if line.sampler == BY_RULE}),
        (f"Samplers, rule: {BY_SAMPLER}", {line.sampler: line for line in lines if line.rule == BY_SAMPLER}),
    )
    costs = {"seconds": (f"seconds per frame ({size})", 1), "evaluations": ("network evaluations per ray", rays)}
    errors = {"colour": "RMSE of display colour", "opacity": "RMSE of opacity"}
    for (title, shown), (measure, y_label), (unit, (x_label, share)) in product(views, errors.items(), costs.items()):
        panel = f"{title}; {measure} against {unit}"
        ends: list[float] = []
        for name, line in shown.items():
            x = [value / share for value in getattr(line, unit)]
            ends += x
            yield Series(panel, 0, name, x_label, y_label, x, list(line.error[measure]))
        floor = [own[measure]] * 2
        yield Series(panel, 0, "own error of the reference", x_label, y_label, [min(ends), max(ends)], floor)


def table_of(lines: Sequence[Line], own: dict[str, float], rays: int) -> Table:
    columns = ["rule", "sampler", "order of colour", "order of opacity", "least error of colour", "of opacity",
               "s to 1e-2", "evaluations per ray", "s to 1e-3", "evaluations per ray"]  # fmt: skip
    rows: Rows = []
    for line in lines:
        orders = [line.order(name, own[name]) for name in MEASURES]
        costs: list[float | None] = []
        for target in NAMED_TARGETS:
            work = line.cost_of(target, "evaluations")
            costs += [line.cost_of(target, "seconds"), None if work is None else work / rays]
        rows.append([line.rule, line.sampler, *orders, *(min(line.error[name]) for name in MEASURES), *costs])
    title = "Fitted orders in the number of samples, and what an error of display colour costs (none: not reached)"
    return Table("rendering_work", 0, title, columns, rows)
