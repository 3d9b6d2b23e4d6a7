"""Error against work of rendering one trained field: every quadrature rule and every sampler."""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import torch

from baselines.numerics.quadrature import QUADRATURES
from harness.chart_record import Series, Table
from harness.device import use_threads
from harness.evaluate import cameras_of
from harness.evidence.frame_work import MEASURES, SAMPLERS, EmptyOutside, Frame, Line, measured_lines, rms
from harness.evidence.situation import Finding, Situation
from harness.evidence.trained_field import TrainedField, trained_field
from harness.evidence.wording import listed
from harness.evidence_record import Check

SCENE, METHOD, TRAINING = "lego", "nerf", "no_encoding"
SAMPLES = (4, 8, 16, 32, 64, 128, 256, 512)
REFERENCE_SAMPLES = 4096
TARGETS = (3e-2, 1e-2, 3e-3, 1e-3, 3e-4)
OWN_ERROR = 1e-4
"""A tenth of the smallest error that a sentence names as reached."""
ROUNDS = 3
STRIDE = 3
"""Every third pixel along both axes: all of a view's parts, a ninth of its rays."""
BY_RULE, BY_SAMPLER = "box", "midpoint"
"""What stays the same where the other is varied."""


def rendering_work(situation: Situation) -> Iterator[Finding]:
    machine = situation.machine
    found = trained_field(situation, TRAINING, SCENE, METHOD)
    if machine.device == "cpu":
        use_threads(machine.workers * machine.threads)  # nothing else is measured meanwhile
    try:
        yield from _measured(situation, found.origin, *_frame_of(situation, found))
    finally:
        use_threads(machine.threads)


def _frame_of(situation: Situation, found: TrainedField) -> tuple[Frame, str]:
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


def _measured(situation: Situation, origin: str, frame: Frame, size: str) -> Iterator[Finding]:
    finest = 1024 if situation.quick else REFERENCE_SAMPLES
    samples = SAMPLES[:3] if situation.quick else SAMPLES
    box = next(one for one in SAMPLERS if one.name == BY_RULE)
    fine, coarse = (frame.rendered("midpoint", box, count) for count in (finest, finest // 2))
    reference = {"colour": fine[0], "opacity": fine[1]}
    own = {"colour": rms(fine[0] - coarse[0]), "opacity": rms(fine[1] - coarse[1])}
    synchronise: Callable[[], object] = torch.cuda.synchronize if frame.background.is_cuda else lambda: None
    lines = measured_lines(frame, QUADRATURES, SAMPLERS, samples, reference, ROUNDS, synchronise)
    yield from sentences(lines, frame_words=f"{size} ({METHOD}, {origin})", rays=len(frame.rays))
    yield Check(
        f"own error of the reference of {finest} samples a ray", own["colour"], high=OWN_ERROR,
        why=f"RMS difference of display colour from the rendering with half as many; opacity {own['opacity']:.1e}",
    )  # fmt: skip
    yield from charts(lines, own, len(frame.rays), size)
    yield tabled(lines, own, len(frame.rays))


def sentences(lines: Sequence[Line], frame_words: str, rays: int) -> Iterator[str]:
    """Who is first, where that changes, what the paper's rule and the grid leave."""
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
    """The line that reaches an error of colour with the least `seconds` or `evaluations`; None where none does."""
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
    """Rules with one sampler and samplers with one rule, against seconds and against evaluations."""
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
    """Every combination: orders, what is left at the end, and what 1e-2 and 1e-3 cost."""
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
