"""Cells whose scores are made from known effects, and a context that hands them to a study."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from harness.execution.progress import Progress
from harness.plan.run_plan import Machine
from harness.records.cells import CellRecord, LeftOut, SceneRecord
from harness.records.study import Check, Effect, Series, Table
from harness.studies.evidence.contrasts import Design, Term, chosen, signs
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.trained_context import StudyRun
from tests.harness.cells import cell, checkpoint, diverged

STEPS = (10, 100, 500)
Truth = dict[Term, float]


def score(design: Design, corner: int, truth: Truth, mean: float = 24.0) -> float:
    """Half of every effect, up or down, for the corner at that place."""
    return mean + sum(float(signs(design, term)[corner]) * size / 2 for term, size in truth.items())


def planted(
    design: Design,
    truth: Truth,
    scenes: tuple[str, ...] = ("lego", "ficus", "hotdog"),
    seeds: int = 3,
    noise: float = 0.0,
    seconds: Callable[[str], float] = lambda method: 10.0,
    ripeness: Callable[[int], float] = lambda step: 1.0,
) -> list[CellRecord]:
    """Every corner on every scene with every seed. Seeds and scenes have different levels, which pairing removes.

    `ripeness` is the share of the truth that is present at a step.
    """
    draw = np.random.default_rng(11)
    cells = []
    corners = enumerate(design.methods.values())
    for (place, scene), seed, (corner, method) in product(enumerate(scenes), range(seeds), corners):
        own = float(draw.normal(0.0, noise)) if noise else 0.0
        curve = []
        for step in STEPS:
            part = {term: size * ripeness(step) for term, size in truth.items()}
            psnr = score(design, corner, part, 20.0 + place + 0.3 * seed + np.log10(step)) + own
            curve.append(checkpoint(step, seconds(method) * step / STEPS[-1], psnr, ssim=0.8 + psnr / 1000))
        cells.append(cell(scene, method, seed, curve, scores={"psnr": curve[-1].psnr, "ssim": curve[-1].ssim}))
    return cells


def with_diverged(cells: list[CellRecord], *keys: tuple[str, str, int]) -> list[CellRecord]:
    """`cells`, of which those of `keys` (scene, method, seed) diverged."""
    return [diverged(*key) if (key := (cell.scene, cell.method, cell.seed)) in keys else cell for cell in cells]


@dataclass(frozen=True)
class Planted(EvidenceContext):
    """Hands out cells instead of training them."""

    cells: dict[str, list[CellRecord]]
    pixels: dict[str, int]
    without: tuple[str, ...]
    """The scenes that need no view direction."""

    def trained(self, name: str) -> StudyRun:
        cells, px = self.cells[name], self.pixels.get(name, 100)
        box = [[0.0] * 3, [1.0] * 3]
        row = LeftOut("view direction", "every surface is Lambertian", None, None, None, "view_direction")
        scenes = [
            SceneRecord(
                scene, scene, "", px, px, {"train": 60}, 1.0, 2.0, box, None, None, {},
                [row] if scene in self.without else [],
            )
            for scene in dict.fromkeys(cell.scene for cell in cells)
        ]  # fmt: skip
        return StudyRun(self.plan(name), scenes, cells)


def context_of(
    cells: dict[str, list[CellRecord]], pixels: dict[str, int] | None = None, without: tuple[str, ...] = ()
) -> Planted:
    here, machine = Path(), Machine("cpu", 1, 1)
    return Planted(here, here, here, False, Progress(), machine, True, cells, pixels or {}, without)


def sentences(findings: Iterable[Any]) -> list[str]:
    return [finding for finding in findings if isinstance(finding, str)]


def checks(findings: Iterable[Any]) -> list[Check]:
    return [finding for finding in findings if isinstance(finding, Check)]


def effects(findings: Iterable[Any]) -> list[Effect]:
    return [finding for finding in findings if isinstance(finding, Effect)]


def effect(findings: Iterable[Any], name: str, against: str = "", scene: str = "all", **facts: str) -> Effect:
    """The only effect of that name, on PSNR at equal steps unless `facts` name something else."""
    (only,) = chosen(effects(findings), name=name, against=against, scene=scene, **facts)
    return only


def lines(findings: Iterable[Any]) -> dict[tuple[str, str], Series]:
    return {(line.panel, line.name): line for line in findings if isinstance(line, Series)}


def table(findings: Iterable[Any], name: str) -> Table:
    return next(finding for finding in findings if isinstance(finding, Table) and finding.id == name)
