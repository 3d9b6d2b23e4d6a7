"""Whether the φ encoding's effect comes from the golden ratio, or from how far its frequencies reach."""

from collections.abc import Iterator

import numpy as np

from baselines.catalog import CATALOG
from baselines.composition import LADDERS as BASES
from baselines.composition import encoding_bands
from harness.records.cells import CellRecord
from harness.records.study import Effect, Series, Table
from harness.studies.evidence.contrasts import (
    Design,
    amount,
    common_steps,
    contrast_effects,
    contrast_tables,
    duel,
    effects,
    effects_of_table,
    line,
    listed,
    told,
)
from harness.studies.evidence.evidence_context import LADDERS, EvidenceContext, Finding, StudyRun
from harness.studies.evidence.factorial import scores_of, spread
from harness.verdicts.comparisons import Budget, keyed

TRAININGS = ("bandwidth_100", "bandwidth_200", "bandwidth_300")
REACH, BASE = "shorter reach", "φ as base"
LADDER_DESIGN = Design(
    (REACH, BASE),
    {
        (False, False): "nerf",
        (False, True): "nerf_phi_far",
        (True, False): "nerf_matched",
        (True, True): "nerf_phi_encoding",
    },
)
"""Reach: as far as 2^9 = 512, or only as far as φ^9 = 76, as near as integer bands come. Base: 2 or φ."""
DECISIVE = (("nerf_phi_encoding", "nerf_matched"), ("nerf_phi_encoding", "nerf_base165"))
"""The golden ratio against two other bases that reach about as far."""
METRICS = ("psnr", "ssim")
BUDGETS: tuple[Budget, ...] = ("steps", "seconds")
Tables = dict[str, list[Effect]]


def bandwidth(situation: EvidenceContext) -> Iterator[Finding]:
    """Yield reach and base as two factors, at each resolution and along training, with the decisive pairs beside
    them.
    """
    trained = {pixels_of(one): one for one in (situation.trained(name) for name in TRAININGS)}
    parts = {
        px: contrast_effects(LADDER_DESIGN, one.cells, f"at {px} px", together=len(trained))
        for px, one in trained.items()
    }
    duels = {px: list(_duels(one.cells, px)) for px, one in trained.items()}
    moved = list(_moved({px: one.cells for px, one in trained.items()}))
    ripened = [one for px, some in trained.items() for one in _ripened(some.cells, px)]
    yield answer([one for some in parts.values() for one in some])
    for px in trained:
        yield from _at(px, parts[px], duels[px])
    yield from _changes(moved, ripened)
    yield _seen(trained)
    yield from _without_a_score(trained)
    for px in trained:
        yield from parts[px]
        yield from duels[px]
    yield from moved
    yield from ripened
    for px, one in trained.items():
        yield _table(one, px)
    yield from _lines({px: one.cells for px, one in trained.items()})


def pixels_of(trained: StudyRun) -> int:
    """Return the pixels along one side of its images."""
    return trained.scenes[0].width


def _duels(cells: list[CellRecord], px: int) -> Iterator[Effect]:
    """Yield every ladder against NeRF, then the decisive pairs."""
    for method, against in (*((method, "nerf") for method in LADDERS if method != "nerf"), *DECISIVE):
        yield from effects(cells, method, against, METRICS, BUDGETS, name=f"{method} at {px} px")


def _moved(cells: dict[int, list[CellRecord]]) -> Iterator[Effect]:
    """Yield the effects of reach and base at the highest resolution minus those at the lowest, paired by seed."""
    low, high = min(cells), max(cells)
    for factor in (REACH, BASE):
        first, last = (contrast_tables(LADDER_DESIGN, (factor,), cells[px], "psnr", "steps") for px in (low, high))
        yield from _change(first, last, f"{factor}, from {low} to {high} px")


def _ripened(cells: list[CellRecord], px: int) -> Iterator[Effect]:
    """Yield the effects of reach and base at the end minus those at the checkpoint before the last."""
    steps = common_steps(cells)
    for factor in (REACH, BASE) if len(steps) > 1 else ():
        before, end = (contrast_tables(LADDER_DESIGN, (factor,), cells, "psnr", "steps", step) for step in steps[-2:])
        yield from _change(before, end, f"{factor} at {px} px, from step {steps[-2]} to {steps[-1]}")


def _change(before: dict[str, np.ndarray], after: dict[str, np.ndarray], name: str) -> Iterator[Effect]:
    """Yield the change of an effect on PSNR; effects are scene → [seeds], with the same scenes and seeds in both."""
    yield from effects_of_table(
        {scene: after[scene] - before[scene] for scene in before},
        name=name,
        metric="psnr",
        budget="steps",
        metrics=1,
        note="change of an effect",
    )


def answer(found: list[Effect]) -> str:
    """Return which of the two it is, and which way, from the verdicts on PSNR at equal steps, scene by scene.

    One verdict is enough to say that there is an effect: all those of a factor must be one family.
    """
    here = [one for one in found if (one.metric, one.budget) == ("psnr", "steps") and one.scene != "all"]
    by_factor = {factor: [one for one in here if one.name.startswith(f"{factor} at")] for factor in (REACH, BASE)}
    told_apart = {
        factor: [one for one in some if one.verdict in ("better", "worse")] for factor, some in by_factor.items()
    }
    nothing = all(one.verdict == "equivalent" for one in by_factor[BASE])
    reach, base = (bool(told_apart[factor]) for factor in (REACH, BASE))
    changes = {factor: _direction(some, len(by_factor[factor])) for factor, some in told_apart.items()}
    if reach and nothing:
        said = (
            f"It is bandwidth: a shorter reach {changes[REACH]}, and at the same reach φ for 2 does not change it by "
            "as much as matters"
        )
    elif reach and not base:
        said = (
            f"Bandwidth, as far as it can be told: a shorter reach {changes[REACH]}; at the same reach no difference "
            "between φ and 2 is told from 0, nor is it everywhere too small to matter"
        )
    elif reach:
        said = f"Both: a shorter reach {changes[REACH]}, and φ for 2 at the same reach {changes[BASE]}"
    elif base:
        said = f"The base: φ for 2 at the same reach {changes[BASE]}; how far the frequencies reach is not told to"
    elif nothing and all(one.verdict == "equivalent" for one in by_factor[REACH]):
        said = "Neither: at these resolutions neither reach nor base changes PSNR by as much as matters"
    else:
        said = "Not settled: neither reach nor base is told from 0 on any scene at any resolution"
    family = max(one.family for one in here)
    return f"{said}. A case is a scene at a resolution; the {family} cases of a factor are looked at together."


def _direction(found: list[Effect], cases: int) -> str:
    """Return which way, in how many of all cases and by how much the effects go that differ from 0."""
    ways = []
    for verb, verdict in (("raises", "better"), ("lowers", "worse")):
        values = sorted(one.difference for one in found if one.verdict == verdict and one.difference is not None)
        if values:
            ends = dict.fromkeys(amount(value, "psnr") for value in (values[0], values[-1]))
            ways.append(f"{verb} PSNR in {len(values)} of {cases} cases ({' to '.join(ends)})")
    return " and ".join(ways)


def _at(px: int, parts: list[Effect], duels: list[Effect]) -> Iterator[str]:
    """Yield one resolution in figures: reach, base, and φ against the others that reach as far."""
    reach, base = (_by_scene(_chosen(parts, f"{factor} at {px} px")) for factor in (REACH, BASE))
    yield f"At {px} px a shorter reach changes PSNR by {reach}; φ for 2 at the same reach by {base}."
    others = listed(
        f"against {against} {_by_scene(_chosen(duels, f'{method} at {px} px', against))}"
        for method, against in DECISIVE
    )
    yield f"φ with ten bands at {px} px, {others}."


def _chosen(found: list[Effect], name: str, against: str = "") -> list[Effect]:
    """Return the effects on PSNR at equal steps, scene by scene."""
    return [
        one
        for one in found
        if (one.name, one.against, one.metric, one.budget) == (name, against, "psnr", "steps") and one.scene != "all"
    ]


def _by_scene(found: list[Effect], gain: bool = True) -> str:
    return listed(f"{told(one, gain)} on {one.scene}" for one in found)


def _changes(moved: list[Effect], ripened: list[Effect]) -> Iterator[str]:
    """Yield how reach and base change with resolution and with training time."""
    found = [*moved, *ripened]
    for name in dict.fromkeys(one.name for one in found):
        yield f"{name}: the effect moves by {_by_scene(_chosen(found, name), gain=False)}."


def _seen(trained: dict[int, StudyRun]) -> str:
    """Return how far training went, in the only unit that is comparable between resolutions."""
    shares = []
    for px, one in trained.items():
        steps = max(cell.steps for cell in one.cells)
        shares.append(f"{steps * one.plan.train.rays / (one.plan.views.train * px * px):.2g} at {px} px")
    return f"Rays of training for each pixel of the training views: {listed(shares)}."


def _without_a_score(trained: dict[int, StudyRun]) -> Iterator[str]:
    for px, one in trained.items():
        lost = [cell for cell in one.cells if cell.status != "done"]
        if lost:
            names = listed(f"{cell.method} on {cell.scene}, seed {cell.seed} ({cell.reason})" for cell in lost)
            yield f"At {px} px these have no score, and their pairs are not judged: {names}."


def _table(trained: StudyRun, px: int) -> Table:
    """Return each ladder in figures, and its scores."""
    cells, bands_of_2 = trained.cells, trained.plan.train.network.position_bands
    _, scenes, _ = keyed(cells)
    rows: list[list[str | float | None]] = []
    for method in LADDERS:
        parts = CATALOG[method].parts
        assert parts is not None
        base, bands = BASES[parts.encoding].base, encoding_bands(parts.encoding, bands_of_2)
        rows.append(
            [
                method,
                f"{base:.4g}",
                str(bands),
                f"{base ** (bands - 1):.4g}",
                *(spread(scores_of(cells, scene, method, metric)) for scene in scenes for metric in METRICS),
            ]
        )
    labels = {"psnr": "PSNR, dB", "ssim": "SSIM"}
    return Table(
        f"ladders_{px}",
        0,
        f"Frequency ladders at {px} px, equal steps: mean ± sd over seeds",
        ["method", "base", "bands", "highest", *(f"{scene}: {labels[one]}" for scene in scenes for one in METRICS)],
        rows,
    )


def _lines(cells: dict[int, list[CellRecord]]) -> Iterator[Series]:
    """Yield differences from NeRF, and reach and base, over resolution and over training steps; one panel per scene.

    With two scenes, an interval over both tells the eye nothing; it is listed among the effects.
    """
    ladders = {method: (duel(method, "nerf"), (method,)) for method in LADDERS if method != "nerf"}
    factors = {factor: (LADDER_DESIGN, (factor,)) for factor in (REACH, BASE)}
    scenes = keyed(cells[min(cells)])[1]
    for what, lines in (("Difference from NeRF", ladders), ("Reach and base", factors)):
        for scene in scenes:
            here = {px: [cell for cell in some if cell.scene == scene] for px, some in cells.items()}
            for name, (design, term) in lines.items():
                yield _line(
                    {float(px): contrast_tables(design, term, some, "psnr", "steps") for px, some in here.items()},
                    f"{what} over resolution, {scene}",
                    name,
                    "pixels along a side",
                )
            for px, some in here.items():
                for name, (design, term) in lines.items():
                    yield _line(
                        {
                            float(at): contrast_tables(design, term, some, "psnr", "steps", at)
                            for at in common_steps(some)
                        },
                        f"{what} along training, {scene} at {px} px",
                        name,
                        "training step",
                    )


def _line(tables: dict[float, dict[str, np.ndarray]], panel: str, name: str, x_label: str) -> Series:
    return line(tables, "psnr", panel=panel, name=name, x_label=x_label, y_label="difference of PSNR, dB")
