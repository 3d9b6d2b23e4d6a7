"""What each of Q-NeRF's three parts does: the full 2³ factorial and Table 4, under both readings of the amplifier."""

from collections.abc import Iterator
from itertools import chain, pairwise, product

from harness.records.cells import CellRecord
from harness.records.study import Effect, Table
from harness.studies.evidence.contrasts import (
    METRICS,
    Design,
    along_training,
    amount,
    chosen,
    contrast_effects,
    effects,
    in_brief,
    in_words,
    listed,
    score_table,
    spread_of,
    without_a_score,
)
from harness.studies.evidence.evidence_context import READINGS, EvidenceContext
from harness.studies.framework import Found, Rows
from harness.verdicts.claim_files import known_claims

PARTS = {"φ encoding": "phi_encoding", "amplifier": "amplifier", "φ skip": "phi_skip"}
"""Part → its word in the name of a combination; the amplifier's depends on the reading."""
TABLE4_SCENE = "lego"


def factorial(context: EvidenceContext) -> Iterator[Found]:
    cells = context.trained("factorial").cells
    designs = {reading: design_of(reading) for reading in READINGS}
    by_reading = {reading: contrast_effects(design, cells, f"({reading})") for reading, design in designs.items()}
    compared = [effect for pair in pairs() for effect in effects(cells, *pair)]
    yield _answer(by_reading, cells)
    for reading, of_reading in by_reading.items():
        yield from _in_figures(of_reading, reading)
    for reading, design in designs.items():
        yield from _densest(cells, design, reading)
    yield from without_a_score(cells)
    yield (
        "A main effect is the score with a part less the score without it, averaged over all settings of the other two "
        "parts; an interaction is half the difference between a part's effect with and without the other. At equal "
        "training time all eight combinations of a scene and a seed are compared at the time that the quickest took."
    )
    yield from chain(*by_reading.values(), compared)
    yield from (ablation(cells, compared, reading) for reading in READINGS)
    every = [name for design in designs.values() for name in design.methods.values()]
    yield score_table("combinations", "Every combination at equal steps: mean ± sd over seeds", cells, every)
    for reading, design in designs.items():
        here = [cell for cell in cells if cell.method in design.methods.values()]
        panel = f"Main effects over all scenes, amplifier of {reading}"
        yield from (along_training(design, (part,), here, panel, name=part) for part in PARTS)


def design_of(reading: str) -> Design:
    amplifier, complete = READINGS[reading]
    words = [amplifier if part == "amplifier" else part for part in PARTS.values()]
    methods = {}
    for corner in product((False, True), repeat=3):
        parts = [word for word, on in zip(words, corner, strict=True) if on]
        methods[corner] = complete if all(corner) else "_".join(["nerf", *parts])
    return Design(tuple(PARTS), methods)


def cumulative(reading: str) -> list[str]:
    """Return the methods of Table 4's rows: nerf, + φ encoding, + amplifier, + φ skip."""
    methods = design_of(reading).methods
    return [methods[tuple(place < count for place in range(3))] for count in range(4)]


def pairs() -> list[tuple[str, str]]:
    """Return each row of Table 4 against the row above and the first row, then each single part against nerf."""
    compared = []
    for reading in READINGS:
        rows = cumulative(reading)
        compared += [(row, above) for above, row in pairwise(rows)] + [(row, rows[0]) for row in rows[1:]]
    for reading in READINGS:
        methods = design_of(reading).methods
        compared += [(methods[corner], methods[False, False, False]) for corner in methods if sum(corner) == 1]
    return list(dict.fromkeys(compared))


def _answer(by_reading: dict[str, list[Effect]], cells: list[CellRecord]) -> str:
    clauses, scenes, seeds = [], dict.fromkeys(cell.scene for cell in cells), {cell.seed for cell in cells}
    scale = f"{listed(scenes)}, {len(seeds)} seeds, at most {max(cell.steps for cell in cells)} steps"
    for reading, of_reading in by_reading.items():
        main = zip(PARTS, chosen(of_reading, scene="all", note=""), strict=True)
        parts = listed(f"{part} {amount(effect.difference, 'psnr')} ({effect.verdict.phrase})" for part, effect in main)
        clauses.append(f"with the amplifier of {reading} {parts}")
    return (
        f"What each part changes at equal steps over all scenes ({scale}): {'; '.join(clauses)}; what the φ encoding "
        "changes need not be φ's doing, as with as many bands it reaches less far than 2^k (the study of bandwidth "
        "separates the two)."
    )


def _in_figures(of_reading: list[Effect], reading: str) -> Iterator[str]:
    for budget, start in (("steps", "At equal steps over all scenes"), ("seconds", "At equal training time")):
        main = zip(PARTS, chosen(of_reading, scene="all", note="", budget=budget), strict=True)
        yield f"{start} ({reading}): {listed(f'{part} {in_words(effect)}' for part, effect in main)}."

    def clause(effect: Effect) -> str:
        return f"{effect.name.removesuffix(f' ({reading})')} {in_words(effect)}"

    together = chosen(of_reading, scene="all", note="interaction")
    if signed := [effect for effect in together if effect.verdict.sign != "open"]:
        yield f"Parts that act differently together than alone ({reading}): {listed(map(clause, signed))}."
    else:
        largest = clause(max(together, key=lambda effect: abs(effect.difference or 0.0)))
        yield f"No interaction is distinguished from 0 over all scenes ({reading}); the largest is {largest}."


def _densest(cells: list[CellRecord], design: Design, reading: str) -> Iterator[str]:
    amplified = [method for corner, method in design.methods.items() if corner[1]]
    fields = [cell.properties for cell in cells if cell.method in amplified and cell.status == "done"]
    if fields:
        density, opacity = (
            max(float(field[what] or 0.0) for field in fields) for what in ("largest_density", "opacity_unit_slab")
        )
        yield (
            f"The densest point in any of {len(fields)} fields with the amplifier of {reading} has a density of "
            f"{density:.3g} per half of the box: a solid of that thickness hides at most {100 * opacity:.3g} % of "
            "what is behind it."
        )


def ablation(cells: list[CellRecord], compared: list[Effect], reading: str) -> Table:
    """Return the cumulative rows on lego with the printed scores, and what each row adds to the row above it."""
    rows: Rows = []
    methods, (paper,) = cumulative(reading), [file for file in known_claims() if file.id == "qnerf"]
    ablation = paper.tables["ablation"]
    for place, (method, printed) in enumerate(zip(methods, ablation, strict=True)):
        row: list[str | float | None] = [str(printed["configuration"]), method]
        for metric in METRICS:
            score, step, jump = str(printed["scores"][metric]), "", ""
            if place > 0:
                facts = {"against": methods[place - 1], "scene": TABLE4_SCENE, "metric": metric}
                step = in_brief(*chosen(compared, name=method, **facts))
                jump = amount(float(score) - float(str(ablation[place - 1]["scores"][metric])), metric)
            row += [spread_of(cells, TABLE4_SCENE, method, metric), score, step, jump]
        rows.append(row)
    columns = ["configuration", "method"]
    for label in ("PSNR, dB", "SSIM"):
        columns += [label, "printed", "step", "printed"]
    title = f"Table 4 on {TABLE4_SCENE}, amplifier of {reading}: mean ± sd over seeds, and what each row adds"
    return Table(f"table4_{reading}", 0, title, columns, rows)
