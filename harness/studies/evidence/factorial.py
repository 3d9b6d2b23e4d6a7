"""What each of Q-NeRF's three parts does: the full 2³ factorial and Table 4, under both readings of the amplifier."""

from collections.abc import Iterator
from itertools import pairwise, product

from harness.records.cells import CellRecord
from harness.records.study import Effect, Table
from harness.studies.evidence.contrasts import (
    BUDGETS,
    METRICS,
    Design,
    Term,
    along_training,
    amount,
    contrast_effects,
    effects,
    in_brief,
    in_words,
    listed,
    mean_of,
    score_table,
    scores_of,
    spread,
    verdict_in_words,
    without_a_score,
)
from harness.studies.evidence.evidence_context import READINGS, EvidenceContext
from harness.studies.framework import Found
from harness.verdicts.comparisons import Budget
from harness.verdicts.paper import TABLE4

PARTS = {"φ encoding": "phi_encoding", "amplifier": "amplifier", "φ skip": "phi_skip"}
"""Part → its name in the names of combinations; the amplifier's depends on the reading."""
TABLE4_SCENE = "lego"


def factorial(context: EvidenceContext) -> Iterator[Found]:
    """Yield main effects, interactions and Table 4's cumulative rows, for each reading."""
    cells = context.trained("factorial").cells
    by_reading = {reading: contrast_effects(design_of(reading), cells, f"({reading})") for reading in READINGS}
    yield answer(by_reading)
    for reading, of_reading in by_reading.items():
        yield from _in_figures(of_reading, reading)
    for reading in READINGS:
        yield _table4_in_words(cells, reading)
    for reading in READINGS:
        yield from _densest(cells, reading)
    if lost := without_a_score(cells):
        yield f"{len(lost)} of {len(cells)} cells have no score, and their pairs are not judged: {listed(lost)}."
    yield (
        "A main effect is the mean of with less without over all settings of the other two parts; an interaction is "
        "half the difference between a part's effect with and without the other. At equal training time all eight "
        "combinations of a scene and a seed are read at the time that the quickest of them took."
    )
    for of_reading in by_reading.values():
        yield from of_reading
    for method, against in pairs():
        yield from effects(cells, method, against)
    for reading in READINGS:
        yield table4(cells, reading)
    columns, rows = score_table(cells, (name for reading in READINGS for name in design_of(reading).methods.values()))
    yield Table(
        "combinations", 0, "Every combination at equal steps: mean ± sd over seeds", ["method", *columns],
        [[method, *scores] for method, scores in rows.items()],
    )  # fmt: skip
    for reading in READINGS:
        design = design_of(reading)
        here = [cell for cell in cells if cell.method in design.methods.values()]
        for part in PARTS:
            yield along_training(
                design, (part,), here, f"Main effects over all scenes, amplifier of {reading}", name=part
            )


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
    chosen = []
    for reading in READINGS:
        rows = cumulative(reading)
        chosen += [(row, above) for above, row in pairwise(rows)] + [(row, rows[0]) for row in rows[1:]]
    for reading in READINGS:
        methods = design_of(reading).methods
        chosen += [(methods[corner], methods[False, False, False]) for corner in methods if sum(corner) == 1]
    return list(dict.fromkeys(chosen))


def answer(by_reading: dict[str, list[Effect]]) -> str:
    """Answer from reading → its effects what each part does to PSNR at equal steps over all scenes, and what that may
    be explained by, in one sentence.
    """
    clauses = []
    for reading, of_reading in by_reading.items():
        rows = _by_term(of_reading, "steps")
        main = [(part, rows[(part,)]) for part in PARTS]
        parts = listed(f"{part} {amount(one.difference, 'psnr')} ({verdict_in_words(one)})" for part, one in main)
        clauses.append(f"with the amplifier of {reading} {parts}")
    return (
        f"What each part changes at equal steps over all scenes: {'; '.join(clauses)}; what the φ encoding changes "
        "need not be φ's doing, as with as many bands it reaches less far than 2^k (the study of bandwidth tells the "
        "two apart)."
    )


def _in_figures(of_reading: list[Effect], reading: str) -> Iterator[str]:
    """Yield what the parts do over all scenes, alone and together."""
    steps, seconds = (_by_term(of_reading, budget) for budget in BUDGETS)
    main, time = (listed(f"{part} {in_words(rows[(part,)])}" for part in PARTS) for rows in (steps, seconds))
    yield f"At equal steps over all scenes ({reading}): {main}."
    yield f"At equal training time ({reading}): {time}."
    together = {" × ".join(term): effect for term, effect in steps.items() if len(term) > 1}
    settled = [
        f"{name} {in_words(effect, gain=False)}"
        for name, effect in together.items()
        if effect.verdict in ("better", "worse")
    ]
    if settled:
        yield f"Parts that act otherwise together than alone ({reading}): {listed(settled)}."
    else:
        name, effect = max(together.items(), key=lambda item: abs(item[1].difference or 0.0))
        yield (
            f"No interaction is told from 0 over all scenes ({reading}); the largest is {name}, "
            f"{in_words(effect, gain=False)}."
        )


def _by_term(of_reading: list[Effect], budget: Budget) -> dict[Term, Effect]:
    """Return the effects on PSNR over all scenes."""
    rows = [one for one in of_reading if (one.scene, one.metric, one.budget) == ("all", "psnr", budget)]
    return {tuple(one.name.rsplit(" (", 1)[0].split(" × ")): one for one in rows}


def _table4_steps(cells: list[CellRecord], reading: str, metric: str) -> list[Effect]:
    """Return each row of Table 4 against the row above it, at equal steps on its scene."""
    return [
        next(
            one
            for one in effects(cells, method, above, budgets=("steps",))
            if (one.scene, one.metric) == (TABLE4_SCENE, metric)
        )
        for above, method in pairwise(cumulative(reading))
    ]


def _table4_in_words(cells: list[CellRecord], reading: str) -> str:
    """Return Table 4's rows beside what is printed."""
    means = [mean_of(scores_of(cells, TABLE4_SCENE, row, "psnr")) for row in cumulative(reading)]
    printed = [float(str(row["psnr"])) for row in TABLE4]
    ours, theirs = (" → ".join(amount(one, "psnr", sign=False) for one in column) for column in (means, printed))
    steps = listed(
        f"{part} {in_words(effect)} where {amount(after - before, 'psnr')} is printed"
        for part, effect, (before, after) in zip(
            PARTS, _table4_steps(cells, reading, "psnr"), pairwise(printed), strict=True
        )
    )
    return (
        f"Table 4 on {TABLE4_SCENE} ({reading}) reads {ours} where {theirs} is printed; each part on top of those "
        f"before it: {steps}."
    )


def _densest(cells: list[CellRecord], reading: str) -> Iterator[str]:
    """Yield what bounds an effect or may explain it."""
    amplified = [method for corner, method in design_of(reading).methods.items() if corner[1]]
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


def table4(cells: list[CellRecord], reading: str) -> Table:
    """Return the cumulative rows on lego beside the printed ones."""
    columns = {"psnr": "PSNR, dB", "ssim": "SSIM"}
    rows: list[list[str | float | None]] = [
        [str(printed["configuration"]), method] for method, printed in zip(cumulative(reading), TABLE4, strict=True)
    ]
    for metric in METRICS:
        printed = [float(str(row[metric])) for row in TABLE4]
        steps = ["", *map(in_brief, _table4_steps(cells, reading, metric))]
        jumps = ["", *(amount(after - before, metric) for before, after in pairwise(printed))]
        for row, configuration, step, jump in zip(rows, TABLE4, steps, jumps, strict=True):
            scores = spread(scores_of(cells, TABLE4_SCENE, str(row[1]), metric))
            row += [scores, str(configuration[metric]), step, jump]
    return Table(
        f"table4_{reading}",
        0,
        f"Table 4 on {TABLE4_SCENE}, amplifier of {reading}: mean ± sd over seeds, and what each row adds",
        [
            "configuration",
            "method",
            *(one for metric in METRICS for one in (columns[metric], "printed", "step", "printed")),
        ],
        rows,
    )
