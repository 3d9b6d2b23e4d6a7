"""Objections to the comparison: each is a pair of methods, trained on all eight scenes and judged like the headline."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean

from baselines.catalog import CATALOG
from harness.records.cells import CellRecord
from harness.records.study import Effect, Table
from harness.studies.evidence.contrasts import amount, chosen, effects, in_words, number, score_table, without_a_score
from harness.studies.evidence.evidence_context import OBJECTED, WITHOUT_SILHOUETTES, EvidenceContext
from harness.studies.framework import Found, Rows
from harness.studies.trained_context import StudyRun


@dataclass(frozen=True)
class Objection:
    words: str
    method: str
    against: str
    training: str = "objections"


OBJECTIONS = (
    Objection("Both start with a shift", "qnerf_shifted", "nerf"),
    Objection("Both start as printed", "qnerf", "nerf_no_shift"),
    Objection("NeRF encodes as its released code does", "qnerf", "nerf_released"),
    Objection("The released encoding against the normalised one", "nerf_released", "nerf"),
    Objection("Both are rendered by Listing 4", "qnerf_listing4", "nerf_listing4"),
    Objection("Eq. 4 acts on density itself", "qnerf_theorem", "nerf"),
    Objection("Trained without its amplifier", "qnerf_repaired", "nerf_phi_encoding_phi_skip"),
    Objection("Without silhouettes", "qnerf", "nerf", "no_silhouettes"),
    Objection("Without silhouettes", "qnerf", "nerf_matched", "no_silhouettes"),
    Objection("Without silhouettes", "qnerf_repaired", "nerf", "no_silhouettes"),
)


def objections(context: EvidenceContext) -> Iterator[Found]:
    runs = {name: context.trained(name) for name in dict.fromkeys(each.training for each in OBJECTIONS)}
    cells = runs["objections"].cells
    yield amplifier_after_training(cells)
    every: list[Effect] = []
    for each in OBJECTIONS:
        where = "" if each.training == "objections" else "without silhouettes"
        own = effects(runs[each.training].cells, each.method, each.against, where, together=len(OBJECTIONS))
        every += own
        for effect in chosen(own, scene="all"):
            yield f"{each.words}: {each.method} − {each.against} is {in_words(effect)} at equal steps."
    yield octaves(runs["objections"])
    for name, run in runs.items():
        yield from without_a_score(run.cells, f"{name}: ")
    yield from every
    yield taken_out(cells)
    for name, methods in (("objections", OBJECTED), ("no_silhouettes", WITHOUT_SILHOUETTES)):
        title = f"PSNR at equal steps, dB: {name}"
        yield score_table(f"{name}_scores", title, runs[name].cells, methods, ("psnr",))


def amplifier_after_training(cells: list[CellRecord]) -> str:
    """Return how near to the identity Eq. 4 is once trained, and what taking it out changes. Methods with
    the quadrature of Listing 4 are counted separately: a last interval of 1e10 hardly lets a ray learn.
    """
    printed = [cell for cell in cells if CATALOG[cell.method].settings.quadrature == "listing4"]
    usual = [cell for cell in cells if cell not in printed]
    factors, changes = values_of(usual, "alpha_phi"), values_of(usual, "psnr_without_amplifier")
    if not factors or not changes:
        return "No trained method has an amplifier."
    distance = max(abs(factor - 1.0) for factor in factors)
    mean, least, most = (number(value, "psnr") for value in (fmean(changes), min(changes), max(changes)))
    others = f" {_between('Rendered by Listing 4, α φ', of)}." if (of := values_of(printed, "alpha_phi")) else ""
    return (
        f"{_between('Trained, α φ', factors)}: Eq. 4 is the identity to within {100 * distance:.0f} %. Taking it out "
        f"after training, without training again, changes PSNR by {mean} dB on average ({least} to {most}).{others}"
    )


def _between(what: str, values: list[float]) -> str:
    return f"{what} lies between {min(values):.2f} and {max(values):.2f} ({len(values)} trainings)"


def values_of(cells: list[CellRecord], name: str) -> list[float]:
    return [value for cell in cells if isinstance(value := cell.properties.get(name), float)]


def octaves(run: StudyRun) -> str:
    """Return how much less far the released encoding reaches than the normalised one: log2(π / half extent)."""
    less = [
        math.log2(math.pi / (0.5 * max(high - low for low, high in zip(*scene.bounds, strict=True))))
        for scene in run.scenes
    ]
    return (
        f"{CATALOG['nerf_released'].title}: its highest frequency lies {min(less):.1f} to {max(less):.1f} octaves "
        "below that of nerf on these scenes, whose positions are normalised by the box and multiplied by π."
    )


def taken_out(cells: list[CellRecord]) -> Table:
    rows: Rows = []
    for method in dict.fromkeys(cell.method for cell in cells):
        for scene in dict.fromkeys(cell.scene for cell in cells):
            mine = [cell for cell in cells if (cell.method, cell.scene) == (method, scene)]
            if factors := values_of(mine, "alpha_phi"):
                changes = values_of(mine, "psnr_without_amplifier")
                rows.append([method, scene, fmean(factors), amount(fmean(changes), "psnr") if changes else None])
    return Table("taken_out", 0, "Eq. 4 taken out after training", ["method", "scene", "α φ", "change of PSNR"], rows)
