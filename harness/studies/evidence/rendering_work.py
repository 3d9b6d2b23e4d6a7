"""Error against work when one trained field is rendered: every quadrature rule and every sampler."""

import json
import math
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import torch
from jaxtyping import Float, Int
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import Sampling, render_rays
from harness.execution.ground_truth import read_views
from harness.execution.run import view_set_folders
from harness.machine.device import use_threads
from harness.plan.needed import for_scene
from harness.plan.profiles import Plan
from harness.plan.seeds import generator_for
from harness.plan.settings import TrainSettings
from harness.records.study import Series, Table, check
from harness.studies.evidence.contrasts import listed
from harness.studies.evidence.evidence_context import EvidenceContext, Finding
from harness.studies.stability.rays.quadrature_orders import fitted_order
from harness.training.checkpoints import checkpoint_path, load_checkpoint, tensors_of
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

    def cost_of(self, target: float, costs: Sequence[float], measure: str = "colour") -> float | None:
        """Return the least of `costs` at which the error is no more than `target`."""
        reached = [cost for cost, error in zip(costs, self.error[measure], strict=True) if error <= target]
        return min(reached, default=None)

    def least(self, measure: str) -> float:
        """Return the least error. Raises `ValueError` if one is not finite, which a minimum would hide or be."""
        return min(_finite(error, self.rule, self.sampler) for error in self.error[measure])

    def order(self, measure: str, floor: float) -> float | None:
        """Return the order, fitted over the finer half of the errors well above the reference's own."""
        clear = [(n, e) for n, e in zip(self.samples, self.error[measure], strict=True) if e > 3.0 * floor]
        finer = clear[len(clear) // 2 :] if len(clear) >= 6 else clear[-3:]
        return fitted_order([e for _, e in finer], tuple(n for n, _ in finer))


def rms(difference: Tensor) -> float:
    return float(difference.double().square().mean().sqrt())


def _finite(error: float, rule: str, sampler: str) -> float:
    if not math.isfinite(error):
        raise ValueError(f"{rule} ({sampler}): an error is not finite: {error}")
    return error


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
    todo = [(rule, sampler, count) for rule in rules for sampler in samplers for count in samples]
    for rule, sampler in {(rule, sampler): None for rule, sampler, _ in todo}:
        frame.rendered(rule, sampler, min(samples))  # allocations, off the clock
    lines: dict[tuple[str, str], Line] = {}
    taken: dict[tuple[str, str, int], list[float]] = {}
    for number in range(rounds):
        for rule, sampler, count in todo:
            synchronise()
            began = clock()
            colour, opacity, evaluations = frame.rendered(rule, sampler, count)
            synchronise()
            taken.setdefault((rule, sampler.name, count), []).append(clock() - began)
            if number == 0:
                line = lines.setdefault((rule, sampler.name), Line(rule, sampler.name))
                line.samples.append(count)
                line.evaluations.append(evaluations)
                line.error["colour"].append(_finite(rms(colour - reference["colour"]), rule, sampler.name))
                line.error["opacity"].append(_finite(rms(opacity - reference["opacity"]), rule, sampler.name))
    for line in lines.values():
        line.seconds += [statistics.median(taken[line.rule, line.sampler, count]) for count in line.samples]
    return list(lines.values())


@dataclass(frozen=True)
class TrainedField:
    """A network method after its training, and what it was trained on."""

    trainer: Trainer
    views: ViewSet
    origin: str
    """The origin in words."""


def trained_field(situation: EvidenceContext, training: str, scene: str, method: str, seed: int = 0) -> TrainedField:
    """Return `method` as `training` leaves it. It is not trained again if the folder of the studies has it.

    Rendering uses float32 matrix multiplications, whatever the training used: their rounding is not examined here.
    """
    device = torch.device(situation.machine.device)
    plan = situation.plan(training)
    folder = view_set_folders(replace(plan, scenes=(scene,)), situation.view_sets, situation.show)[scene]
    views = read_views(folder, plan.views, situation.scratch)
    stored = situation.out / "studies" / training
    weights = checkpoint_path(stored, scene, method, seed)
    if weights.exists() and _settings_of(stored) == json.loads(json.dumps(plan.settings())):
        trainer = restored(weights, plan, views, stream_of(scene, seed), method, device)
        return TrainedField(trainer, views, f"checkpoint of the training {training}")
    alone = trained_alone(method, views, stream_of(scene, seed), plan.train, plan.budget, device)
    if not isinstance(alone, Trainer):
        raise TypeError(f"{method} is no network")
    found = empty_trainer(plan, views, stream_of(scene, seed), method, device)
    found.restore(tensors_of(alone), alone.step)
    return TrainedField(found, views, f"trained now, as {training} does")


def restored(weights: Path, plan: Plan, views: ViewSet, stream: str, method: str, device: torch.device) -> Trainer:
    """Return a trainer at the end of its budget, with the weights and the occupied cells of a checkpoint."""
    trainer = empty_trainer(plan, views, stream, method, device)
    load_checkpoint(trainer, weights, plan.budget.steps or trainer.settings.grid.first_step + 1)
    return trainer


def empty_trainer(plan: Plan, views: ViewSet, stream: str, method: str, device: torch.device) -> Trainer:
    """Return a trainer as the run makes it for this scene, with float32 matrix multiplications."""
    settings: TrainSettings = replace(for_scene(plan.train, views), precision="float32")
    directed = needs_view_direction(views)
    return Trainer(method, box_of(views, device), settings, plan.budget, stream, device, directed)


def _settings_of(stored: Path) -> object:
    from harness.records.cells import read_run
    from harness.records.json_record import DamagedRecord

    try:
        return read_run(stored).settings
    except DamagedRecord:
        return None


SCENE, METHOD, TRAINING = "lego", "nerf", "no_encoding"
SAMPLES = (4, 8, 16, 32, 64, 128, 256, 512)
REFERENCE_SAMPLES = 4096
TARGETS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4)
OWN_ERROR = 1e-4
"""The largest error of the reference itself: a tenth of the smallest error that a sentence names as reached."""
ROUNDS = 3
STRIDE = 3
"""The stride of pixels: every third along both axes shows all parts of a view in a ninth of its rays."""
BY_RULE, BY_SAMPLER = "box", "midpoint"
"""The rule or sampler that stays the same when the other is varied."""


def rendering_work(situation: EvidenceContext) -> Iterator[Finding]:
    machine = situation.machine
    found = trained_field(situation, TRAINING, SCENE, METHOD)
    if machine.device == "cpu":
        use_threads(machine.workers * machine.threads)  # nothing else is measured meanwhile
    try:
        yield from _measured(situation, found.origin, *_frame_of(situation, found))
    finally:
        use_threads(machine.threads)


def _frame_of(situation: EvidenceContext, found: TrainedField) -> tuple[Frame, str]:
    trainer, views = found.trainer, found.views
    cameras = cameras_of(views, views.test, trainer.device)
    row, column = torch.meshgrid(
        *(torch.arange(STRIDE // 2, size, STRIDE, device=trainer.device) for size in (views.height, views.width)),
        indexing="ij",
    )
    view = len(cameras) // 2
    rays = cameras.rays(torch.full((row.numel(),), view, device=trainer.device), column.flatten(), row.flatten())
    field = EmptyOutside(trainer.field, trainer.box)
    chunk = situation.plan(TRAINING).score.chunk
    frame = Frame(field, rays, trainer.box, trainer.grid, trainer.background, chunk)
    return frame, f"{column.shape[1]} × {row.shape[0]} rays of a test view of {SCENE}"


def _measured(situation: EvidenceContext, origin: str, frame: Frame, size: str) -> Iterator[Finding]:
    finest = 1024 if situation.quick else REFERENCE_SAMPLES
    samples = SAMPLES[:3] if situation.quick else SAMPLES
    box = next(one for one in SAMPLERS if one.name == BY_RULE)
    fine, coarse = (frame.rendered("midpoint", box, count) for count in (finest, finest // 2))
    reference = {"colour": fine[0], "opacity": fine[1]}
    own = {"colour": rms(fine[0] - coarse[0]), "opacity": rms(fine[1] - coarse[1])}
    synchronise: Callable[[], object] = torch.cuda.synchronize if frame.background.is_cuda else lambda: None
    lines = measured_lines(frame, QUADRATURES, SAMPLERS, samples, reference, ROUNDS, synchronise)
    yield from sentences(lines, frame_words=f"{size} ({METHOD}, {origin})", rays=len(frame.rays))
    yield check(
        f"own error of the reference of {finest} samples a ray",
        own["colour"],
        high=OWN_ERROR,
        why=f"RMS difference of display colour from the rendering with half as many; opacity {own['opacity']:.1e}",
    )
    yield from charts(lines, own, len(frame.rays), size)
    yield tabled(lines, own, len(frame.rays))


def sentences(lines: Sequence[Line], frame_words: str, rays: int) -> Iterator[str]:
    """Yield which combination is first, when that changes, and the error that the paper's rule and the grid leave."""
    named = [_first_words(lines, target, rays) for target in (1e-2, 1e-3)]
    yield f"Of all rules and samplers, {' and '.join(named)}: a frame is {frame_words}."
    winners = [(target, one) for target in TARGETS if (one := fastest(lines, target))]
    changes = [
        f"at {later[0]:g} {_name(later[1])} overtakes {_name(earlier[1])}"
        for earlier, later in pairwise(winners)
        if later[1] is not earlier[1]
    ]
    reached = f"from {winners[0][0]:g} to {winners[-1][0]:g}" if winners else "at no target"
    times = f"{len(changes)} time{'s' * (len(changes) != 1)}"
    yield (
        f"The fastest combination {reached} changes {times}: {'; '.join(changes)}."
        if changes
        else f"The same combination is the fastest {reached}: the ranking's first place does not change."
    )
    thrifty = [(target, one) for target in (1e-2, 1e-3) if (one := fastest(lines, target, by="evaluations"))]
    counts = [
        f"{_name(one)} is first at {target:g} ({work / rays:.3g} a ray)"
        for target, one in thrifty
        if (work := one.cost_of(target, one.evaluations)) is not None
    ]
    if counts:
        yield f"By network evaluations, the same on every machine, {listed(counts)}."
    for rule, of_rule in QUADRATURES.items():
        own_lines = [line for line in lines if line.rule == rule]
        if of_rule.of_the_paper and own_lines:
            least = min(line.least("colour") for line in own_lines)
            clear = min(line.least("opacity") for line in own_lines)
            yield (
                f"{rule}, the paper's rule as printed, never comes below {least:.2g} (colour) and {clear:.2g} "
                "(opacity), whatever the samples: its last interval is endless and it has no background."
            )
    kept = {line.sampler: line.least("colour") for line in lines if line.rule == BY_SAMPLER}
    if {"box", "box, random"} <= set(kept):
        even, random = kept["box"], kept["box, random"]
        why = ", as spacing would that aliases with frequencies of the encoding" if even > 1.5 * random else ""
        yield f"With {BY_SAMPLER}, evenly spread points leave {even:.1e} at best and random ones {random:.1e}{why}."
    if {"box", "box, grid"} <= set(kept):
        yield (
            f"What the occupancy grid skips costs an error that no number of samples takes away: with {BY_SAMPLER} "
            f"{kept['box, grid']:.1e} is left at best, {kept['box']:.1e} without the grid."
            if kept["box, grid"] > 2.0 * kept["box"]
            else f"What the occupancy grid skips does not show: with {BY_SAMPLER} {kept['box, grid']:.1e} is left at "
            f"best, {kept['box']:.1e} without the grid."
        )


def fastest(lines: Sequence[Line], target: float, by: str = "seconds") -> Line | None:
    """Return the line that reaches an error of colour with the least `seconds` or `evaluations`; None if none does."""
    reached = [(cost, line) for line in lines if (cost := line.cost_of(target, getattr(line, by))) is not None]
    return min(reached, key=lambda one: one[0])[1] if reached else None


def _first_words(lines: Sequence[Line], target: float, rays: int) -> str:
    one = fastest(lines, target)
    if one is None:
        return f"none reaches an error of {target:g}"
    seconds, work = one.cost_of(target, one.seconds), one.cost_of(target, one.evaluations)
    assert seconds is not None
    assert work is not None
    return f"{_name(one)} reaches an error of {target:g} first ({seconds:.3g} s, {work / rays:.3g} evaluations a ray)"


def _name(line: Line) -> str:
    return f"{line.rule} ({line.sampler})"


def charts(lines: Sequence[Line], own: dict[str, float], rays: int, size: str) -> Iterator[Series]:
    """Yield rules with one sampler and samplers with one rule, against seconds and against evaluations."""
    views = (
        (f"Rules, sampler: {BY_RULE}", [(one.rule, one) for one in lines if one.sampler == BY_RULE]),
        (f"Samplers, rule: {BY_SAMPLER}", [(one.sampler, one) for one in lines if one.rule == BY_SAMPLER]),
    )
    for title, shown in views:
        for measure in MEASURES:
            for cost, label in (("seconds", f"seconds a frame ({size})"), ("evaluations", "network evaluations a ray")):
                panel = f"{title}; {measure} against {cost}"
                named = f"RMSE of {'display colour' if measure == 'colour' else 'opacity'}"
                ends: list[float] = []
                for name, line in shown:
                    x = [value / (rays if cost == "evaluations" else 1) for value in getattr(line, cost)]
                    ends += x
                    of_paper = name in QUADRATURES and QUADRATURES[name].of_the_paper
                    yield Series(panel, 0, f"{name} (the paper's)" if of_paper else name, label, named, x,
                                 list(line.error[measure]))  # fmt: skip
                ends = [min(ends), max(ends)]
                yield Series(panel, 0, "own error of the reference", label, named, ends, [own[measure]] * 2)


def tabled(lines: Sequence[Line], own: dict[str, float], rays: int) -> Table:
    """Return every combination: orders, the error that remains at the end, and the cost of 1e-2 and 1e-3."""
    columns = ["rule", "sampler", "order of colour", "order of opacity", "least error of colour", "of opacity",
               "s to 1e-2", "evaluations a ray", "s to 1e-3", "evaluations a ray"]  # fmt: skip
    rows: list[list[str | float | None]] = []
    for line in lines:
        row: list[str | float | None] = [line.rule, line.sampler]
        row += [line.order(name, own[name]) for name in MEASURES]
        row += [line.least(name) for name in MEASURES]
        for target in (1e-2, 1e-3):
            work = line.cost_of(target, line.evaluations)
            row += [line.cost_of(target, line.seconds), None if work is None else work / rays]
        rows.append(row)
    title = "Fitted orders in the number of samples, and what an error of display colour costs (none: not reached)"
    return Table("rendering_work", 0, title, columns, rows)
