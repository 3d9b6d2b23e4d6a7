"""A study of whether the φ encoding's effect comes from the golden ratio, or from how far its frequencies reach."""

from collections.abc import Iterator
from itertools import pairwise

from baselines.catalog import CATALOG
from baselines.composition import LADDERS as BASES
from harness.records.cells import CellRecord
from harness.records.study import Effect, Series, Table
from harness.studies.evidence.contrasts import (
    Design,
    along_training,
    amount,
    chosen,
    common_steps,
    contrast_effects,
    contrast_tables,
    duel,
    effects,
    effects_of_table,
    in_words,
    line,
    listed,
    score_table,
    without_a_score,
)
from harness.studies.evidence.evidence_context import LADDERS, EvidenceContext
from harness.studies.framework import Found
from harness.studies.trained_context import StudyRun

TRAININGS = ("bandwidth_100", "bandwidth_200", "bandwidth_300")
REACH, BASE = FACTORS = ("shorter reach", "φ as base")
LADDER_DESIGN = Design(
    FACTORS,
    {
        (False, False): "nerf",
        (False, True): "nerf_phi_far",
        (True, False): "nerf_matched",
        (True, True): "nerf_phi_encoding",
    },
)
"""Reach: to 2^9 = 512, or only to φ^9 = 76, as nearly as whole bands allow. Base: 2 or φ."""
DECISIVE = (("nerf_phi_encoding", "nerf_matched"), ("nerf_phi_encoding", "nerf_base165"))
"""The golden ratio against two other bases of about the same reach."""
At = tuple[int, int | None]
"""A resolution, and a step or the end."""
OTHERS = tuple(method for method in LADDERS if method != "nerf")


def bandwidth(context: EvidenceContext) -> Iterator[Found]:
    """Judge reach and base as factors over scenes, at each resolution and along training, and the decisive pairs."""
    trained = {run.scenes[0].width: run for run in map(context.trained, TRAININGS)}
    cells = {px: run.cells for px, run in trained.items()}
    parts = [
        effect
        for px, some in cells.items()
        for effect in contrast_effects(LADDER_DESIGN, some, f"at {px} px", together=len(cells))
    ]
    duels = [
        effect
        for px, some in cells.items()
        for pair in (*((method, "nerf") for method in OTHERS), *DECISIVE)
        for effect in effects(some, *pair, f"at {px} px")
    ]
    changes = list(_changes(cells))
    yield answer(parts)
    for px in cells:
        reach, base = (_over_scenes(parts, f"{factor} at {px} px") for factor in FACTORS)
        yield f"At {px} px a shorter reach changes PSNR by {reach}; φ for 2 at the same reach by {base}."
        others = [
            f"against {against} {_over_scenes(duels, f'{method} at {px} px', against)}" for method, against in DECISIVE
        ]
        yield f"φ with ten bands at {px} px, {listed(others)}."
    for name in dict.fromkeys(effect.name for effect in changes):
        yield f"{name}: the effect moves by {_over_scenes(changes, name)}."
    shares = []
    for px, run in trained.items():
        rays = max(cell.steps for cell in run.cells) * run.plan.train.rays
        shares.append(f"{rays / (run.plan.views.train * px * px):.2g} at {px} px")
    yield f"Training rays per pixel of the training views: {listed(shares)}."
    for px, some in cells.items():
        yield from without_a_score(some, f"At {px} px ")
    yield from [*parts, *duels, *changes]
    for px, run in trained.items():
        yield _table(run, px)
    yield from _lines(cells)


def _changes(cells: dict[int, list[CellRecord]]) -> Iterator[Effect]:
    """Yield how the effects on PSNR change from the lowest resolution to the highest, and at the end of training."""
    low, high = min(cells), max(cells)
    spans: list[tuple[str, At, At]] = [(f", from {low} to {high} px", (low, None), (high, None))]
    for px, some in cells.items():
        for step, last in pairwise(common_steps(some)[-2:]):
            spans.append((f" at {px} px, from step {step} to {last}", (px, step), (px, last)))
    for words, start, end in spans:
        for factor in FACTORS:
            before, after = (
                contrast_tables(LADDER_DESIGN, (factor,), cells[px], "psnr", "steps", step) for px, step in (start, end)
            )
            table = {scene: after[scene] - before[scene] for scene in before}
            yield from effects_of_table(table, f"{factor}{words}", "psnr", "steps", 1, note="change of an effect")


def answer(effects_of_factors: list[Effect]) -> str:
    """Return which factors have an effect. One verdict is enough, so those of a factor must be one family."""
    here = chosen(effects_of_factors, scene="all", note="")
    cases = {factor: [effect for effect in here if effect.name.startswith(f"{factor} at")] for factor in FACTORS}
    changes = {factor: _direction(some) for factor, some in cases.items()}
    small = "smaller than matters"
    nothing = {factor: all(effect.verdict.size == small for effect in some) for factor, some in cases.items()}
    if all(nothing.values()):
        verdict = "Neither: at these resolutions neither reach nor base changes PSNR by as much as matters"
    elif changes[REACH] and nothing[BASE]:
        verdict = (
            f"It is bandwidth: a shorter reach {changes[REACH]}, and at the same reach φ for 2 does not change it by "
            "as much as matters"
        )
    elif changes[REACH] and changes[BASE]:
        verdict = f"A shorter reach {changes[REACH]}; φ for 2 at the same reach {changes[BASE]}"
    elif changes[REACH]:
        verdict = (
            f"Bandwidth, as far as these runs can say: a shorter reach {changes[REACH]}; at the same reach no "
            "difference between φ and 2 is distinguished from 0, nor is it smaller than matters at every resolution"
        )
    elif changes[BASE]:
        verdict = f"The base: φ for 2 at the same reach {changes[BASE]}; the sign of what the reach changes is open"
    else:
        verdict = "Open: neither reach nor base has an effect distinguished from 0 at any resolution"
    scenes = len({effect.scene for effect in effects_of_factors} - {"all"})
    return (
        f"{verdict}. A case is a resolution, judged over {scenes} scenes; the {here[0].family} cases of a factor are "
        "looked at together."
    )


def _direction(cases: list[Effect]) -> str:
    """Return the sign, the number of cases and the sizes of the effects that differ from 0; empty if none does."""
    ways = []
    for verb, sign in (("raises", "above 0"), ("lowers", "below 0")):
        values = sorted(effect.difference or 0.0 for effect in cases if effect.verdict.sign == sign)
        if values:
            ends = dict.fromkeys(amount(value, "psnr") for value in (values[0], values[-1]))
            ways.append(f"{verb} PSNR in {len(values)} of {len(cases)} cases ({' to '.join(ends)})")
    return " and ".join(ways)


def _over_scenes(some: list[Effect], name: str, against: str = "") -> str:
    (effect,) = chosen(some, scene="all", name=name, against=against)
    return in_words(effect)


def _table(run: StudyRun, px: int) -> Table:
    title = f"Frequency ladders at {px} px, equal steps: scores by scene"
    table = score_table(f"ladders_{px}", title, run.cells, LADDERS)
    table.columns[1:1] = ["base", "bands", "highest"]
    for method, row in zip(LADDERS, table.rows, strict=True):
        parts = CATALOG[method].parts
        assert parts is not None
        ladder = BASES[parts.encoding]
        base, bands = ladder.base, ladder.bands(run.plan.train.network.position_bands)
        row[1:1] = [f"{base:.4g}", str(bands), f"{base ** (bands - 1):.4g}"]
    return table


def _lines(cells: dict[int, list[CellRecord]]) -> Iterator[Series]:
    ladders = {method: (duel(method, "nerf"), (method,)) for method in OTHERS}
    factors = {factor: (LADDER_DESIGN, (factor,)) for factor in FACTORS}
    for what, lines in (("Difference from NeRF", ladders), ("Reach and base", factors)):
        for name, (design, term) in lines.items():
            tables = {float(px): contrast_tables(design, term, some, "psnr", "steps") for px, some in cells.items()}
            yield line(tables, f"{what} over resolution", name, "pixels along a side")
        for px, some in cells.items():
            for name, (design, term) in lines.items():
                yield along_training(design, term, some, f"{what} along training, at {px} px", name)
