"""What each of Q-NeRF's three parts does: the full 2³ factorial and Table 4, under both readings of the amplifier."""

from collections.abc import Iterator
from itertools import pairwise, product

import numpy as np

from harness.records.cells import CellRecord
from harness.records.study import Effect, Table
from harness.studies.evidence.contrasts import (
    Design,
    amount,
    common_steps,
    contrast_effects,
    contrast_tables,
    effects,
    line,
    listed,
    said,
    short,
    told,
)
from harness.studies.evidence.evidence_context import READINGS, EvidenceContext, Finding
from harness.verdicts.comparisons import Budget, keyed
from harness.verdicts.paper import TABLE4

PARTS = {"φ encoding": "phi_encoding", "amplifier": "amplifier", "φ skip": "phi_skip"}
"""Part → its name in the names of combinations; the amplifier's depends on the reading."""
TABLE4_SCENE = "lego"
METRICS = ("psnr", "ssim")
BUDGETS: tuple[Budget, ...] = ("steps", "seconds")


def factorial(situation: EvidenceContext) -> Iterator[Finding]:
    """Yield main effects, interactions and Table 4's cumulative rows, for each reading."""
    cells = situation.trained("factorial").cells
    found = {reading: contrast_effects(design_of(reading), cells, f"({reading})") for reading in READINGS}
    yield answer(found)
    for reading in READINGS:
        yield from _in_figures(found[reading], reading)
    for reading in READINGS:
        yield _cumulative_sentence(cells, reading)
    yield from _limits(cells)
    yield _convention()
    for reading in READINGS:
        yield from found[reading]
    for method, against in pairs():
        yield from effects(cells, method, against, METRICS, BUDGETS)
    for reading in READINGS:
        yield table4(cells, reading)
    yield combinations_table(cells)
    for reading in READINGS:
        yield from _along_training(cells, reading)


def design_of(reading: str) -> Design:
    """Return which combination belongs to which corner; raises `KeyError` for a reading that `READINGS` does not
    have.
    """
    amplifier, whole = READINGS[reading]
    words = [amplifier if part == "amplifier" else part for part in PARTS.values()]
    methods = {}
    for corner in product((False, True), repeat=3):
        chosen = [word for word, on in zip(words, corner, strict=True) if on]
        methods[corner] = whole if all(corner) else "_".join(["nerf", *chosen])
    return Design(tuple(PARTS), methods)


def cumulative(reading: str) -> list[str]:
    """Return the methods of Table 4's rows: nerf, + φ encoding, + amplifier, + φ skip."""
    methods = design_of(reading).methods
    return [methods[tuple(place < count for place in range(3))] for count in range(4)]


def pairs() -> list[tuple[str, str]]:
    """Return each row of Table 4 against the row above and against the first one, then each part alone against nerf."""
    found = []
    for reading in READINGS:
        rows = cumulative(reading)
        found += [(row, above) for above, row in pairwise(rows)] + [(row, rows[0]) for row in rows[1:]]
    for reading in READINGS:
        methods = design_of(reading).methods
        found += [(methods[corner], methods[False, False, False]) for corner in methods if sum(corner) == 1]
    return list(dict.fromkeys(found))


def answer(found: dict[str, list[Effect]]) -> str:
    """Answer from reading → its effects what each part does to PSNR at equal steps over all scenes, and what that may
    be explained by, in one sentence.
    """
    said_of = []
    for reading, some in found.items():
        rows = _by_term(some, "all", "psnr", "steps")
        parts = listed(f"{part} {amount(rows[(part,)].difference, 'psnr')} ({said(rows[(part,)])})" for part in PARTS)
        said_of.append(f"with the amplifier of {reading} {parts}")
    return (
        f"What each part changes at equal steps over all scenes: {'; '.join(said_of)}; what the φ encoding changes "
        "need not be φ's doing, as with as many bands it reaches less far than 2^k (the study of bandwidth tells the "
        "two apart)."
    )


def _in_figures(found: list[Effect], reading: str) -> Iterator[str]:
    """Yield what the parts do over all scenes, alone and together."""
    by_budget = {budget: _by_term(found, "all", "psnr", budget) for budget in BUDGETS}
    main, time = (
        listed(f"{part} {told(rows[(part,)])}" for part in PARTS) for rows in (by_budget["steps"], by_budget["seconds"])
    )
    yield f"At equal steps over all scenes ({reading}): {main}."
    yield f"At equal training time ({reading}): {time}."
    together = {term: one for term, one in by_budget["steps"].items() if len(term) > 1}
    settled = {term: one for term, one in together.items() if one.verdict in ("better", "worse")}
    if settled:
        terms = listed(f"{' × '.join(term)} {told(one, gain=False)}" for term, one in settled.items())
        yield f"Parts that act otherwise together than alone ({reading}): {terms}."
    else:
        largest = max(together.items(), key=lambda item: abs(item[1].difference or 0.0))
        yield (
            f"No interaction is told from 0 over all scenes ({reading}); the largest is {' × '.join(largest[0])}, "
            f"{told(largest[1], gain=False)}."
        )


def _by_term(found: list[Effect], scene: str, metric: str, budget: Budget) -> dict[tuple[str, ...], Effect]:
    rows = [one for one in found if (one.scene, one.metric, one.budget) == (scene, metric, budget)]
    return {tuple(one.name.rsplit(" (", 1)[0].split(" × ")): one for one in rows}


def _cumulative_sentence(cells: list[CellRecord], reading: str) -> str:
    """Return Table 4's rows beside what is printed."""
    rows = cumulative(reading)
    steps = {row: _on_scene(cells, row, above, TABLE4_SCENE) for above, row in pairwise(rows)}
    values = [amount(mean_of(scores_of(cells, TABLE4_SCENE, row, "psnr")), "psnr", sign=False) for row in rows]
    printed = [float(str(row["psnr"])) for row in TABLE4]
    steps_said = listed(
        f"{part} {told(one)} where {amount(after - before, 'psnr')} is printed"
        for part, one, (before, after) in zip(PARTS, steps.values(), pairwise(printed), strict=True)
    )
    return (
        f"Table 4 on {TABLE4_SCENE} ({reading}) reads {' → '.join(values)} where "
        f"{' → '.join(amount(one, 'psnr', sign=False) for one in printed)} is printed; each part on top of those "
        f"before it: {steps_said}."
    )


def _on_scene(cells: list[CellRecord], method: str, against: str, scene: str) -> Effect:
    return next(one for one in effects(cells, method, against, METRICS, ("steps",)) if one.scene == scene)


def _limits(cells: list[CellRecord]) -> Iterator[str]:
    """Yield what bounds an effect or may explain it, and what was excluded."""
    for reading in READINGS:
        amplified = [design_of(reading).methods[corner] for corner in product((False, True), repeat=3) if corner[1]]
        fields = [cell.properties for cell in cells if cell.method in amplified and cell.status == "done"]
        if fields:
            density, opacity = (
                max(float(one[what] or 0.0) for one in fields) for what in ("largest_density", "opacity_unit_slab")
            )
            yield (
                f"The densest point in any of {len(fields)} fields with the amplifier of {reading} has a density of "
                f"{density:.3g} per half of the box: a solid of that thickness hides at most {100 * opacity:.3g} % of "
                "what is behind it."
            )
    lost = [cell for cell in cells if cell.status != "done"]
    if lost:
        names = listed(f"{cell.method} on {cell.scene}, seed {cell.seed} ({cell.reason})" for cell in lost)
        yield f"{len(lost)} of {len(cells)} cells have no score, and their pairs are not judged: {names}."


def _convention() -> str:
    return (
        "A main effect is the mean of with less without over all settings of the other two parts; an interaction is "
        "half the difference between a part's effect with and without the other. At equal training time all eight "
        "combinations of a scene and a seed are read at the time that the quickest of them took."
    )


def table4(cells: list[CellRecord], reading: str) -> Table:
    """Return the cumulative rows on lego beside the printed ones."""
    rows: list[list[str | float | None]] = []
    methods = cumulative(reading)
    for place, (method, printed) in enumerate(zip(methods, TABLE4, strict=True)):
        row: list[str | float | None] = [str(printed["configuration"]), method]
        for metric in METRICS:
            step = None
            if place:
                found = effects(cells, method, methods[place - 1], METRICS, ("steps",))
                step = next(one for one in found if (one.scene, one.metric) == (TABLE4_SCENE, metric))
            before = TABLE4[place - 1][metric] if place else None
            row += [
                spread(scores_of(cells, TABLE4_SCENE, method, metric)),
                str(printed[metric]),
                short(step) if step else "",
                amount(_number(printed[metric]) - _number(before), metric) if before is not None else "",
            ]
        rows.append(row)
    return Table(
        f"table4_{reading}",
        0,
        f"Table 4 on {TABLE4_SCENE}, amplifier of {reading}: mean ± sd over seeds, and what each row adds",
        [
            "configuration",
            "method",
            *("PSNR, dB", "printed", "step", "printed"),
            *("SSIM", "printed", "step", "printed"),
        ],
        rows,
    )


def combinations_table(cells: list[CellRecord]) -> Table:
    """Return PSNR and SSIM of every corner of both designs, scene by scene."""
    _, scenes, _ = keyed(cells)
    methods = dict.fromkeys(name for reading in READINGS for name in design_of(reading).methods.values())
    labels = {"psnr": "PSNR, dB", "ssim": "SSIM"}
    return Table(
        "combinations",
        0,
        "Every combination at equal steps: mean ± sd over seeds",
        ["method", *(f"{scene}: {labels[metric]}" for scene in scenes for metric in METRICS)],
        [
            [method, *(spread(scores_of(cells, scene, method, metric)) for scene in scenes for metric in METRICS)]
            for method in methods
        ],
    )


def _along_training(cells: list[CellRecord], reading: str) -> Iterator[Finding]:
    """Yield the main effects at every checkpoint."""
    design = design_of(reading)
    here = [cell for cell in cells if cell.method in design.methods.values()]
    for part in PARTS:
        yield line(
            {float(at): contrast_tables(design, (part,), here, "psnr", "steps", at) for at in common_steps(here)},
            "psnr",
            panel=f"Main effects over all scenes, amplifier of {reading}",
            name=part,
            x_label="training step",
            y_label="difference of PSNR, dB",
        )


def scores_of(cells: list[CellRecord], scene: str, method: str, metric: str) -> list[float | None]:
    """Return the scores of every seed, at the end; None for a cell that did not end well."""
    return [cell.scores.get(metric) for cell in cells if (cell.scene, cell.method) == (scene, method)]


def mean_of(scores: list[float | None]) -> float | None:
    there = [score for score in scores if score is not None]
    return float(np.mean(there)) if there else None


def spread(scores: list[float | None]) -> str:
    """Return `24.10 ± 0.05` with the standard deviation over seeds, and the number of seeds if some are missing."""
    there = [score for score in scores if score is not None]
    if not there:
        return "no seed ended well"
    digits = 2 if max(map(abs, there)) > 1 else 3
    text = f"{np.mean(there):.{digits}f}"
    text += f" ± {np.std(there, ddof=1):.{digits}f}" if len(there) > 1 else ""
    return text if len(there) == len(scores) else f"{text} ({len(there)} of {len(scores)} seeds)"


def _number(value: object) -> float:
    return float(str(value))
