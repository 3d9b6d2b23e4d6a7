"""Scores of programs that nobody here wrote, on views of this project, next to the best of ours at the same time."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from harness.records.study import Table
from harness.studies.evidence.contrasts import listed
from harness.studies.framework import Found, Rows
from harness.studies.frontier.frontier_context import Amount, Frontier, FrontierContext

FILE = Path(__file__).with_name("peers.csv")
"""The measured points; another program is another row."""


@dataclass(frozen=True)
class Point:
    program: str
    variant: str
    """How the program was used."""
    protocol: str
    scene: str
    resolution: int
    core_seconds: float
    psnr: float

    @property
    def name(self) -> str:
        return f"{self.program}, {self.variant}"


def read_points(file: Path = FILE) -> list[Point]:
    with file.open(encoding="utf-8", newline="") as rows:
        return msgspec.convert(list(csv.DictReader(rows)), list[Point], strict=False)


def points_of(amount: Amount) -> list[Point]:
    """Return the points on scenes of these trainings, of pictures of their size."""
    return [each for each in read_points() if each.resolution == amount.resolution and each.scene in amount.scenes]


def peers(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    points = points_of(frontier.amount)
    if not points:
        yield "No other program was measured on these scenes at this size."
        return
    rows: Rows = []
    ahead = 0
    for point in points:
        words = ""
        if (ours := best_within(frontier, point)) is not None:
            score, budget, family = ours
            ahead += score > point.psnr
            words = f"{score:.1f} dB in {budget:g} core s, {family}"
        rows.append([point.name, point.scene, f"{point.core_seconds:g}", f"{point.psnr:.1f}", words, point.protocol])
    programs = listed(dict.fromkeys(point.program for point in points))
    yield f"{programs}: at {ahead} of {len(points)} points a family of ours scores higher in no more core seconds."
    columns = ["program", "scene", "core s", "PSNR, dB", "the best of ours in no more time", "protocol"]
    yield Table("peers", 0, "Other programs on a processor", columns, rows)


def best_within(frontier: Frontier, point: Point) -> tuple[float, float, str] | None:
    """Return score, budget and family of the best of ours within the seconds of a point; None without such a budget."""
    place = frontier.amount.scenes.index(point.scene)
    found = [
        (float(score), budget, family)
        for budget in frontier.budgets
        for family in frontier.trained
        if budget <= point.core_seconds and not np.isnan(score := frontier.table(budget, (family,))[0][place])
    ]
    return max(found, default=None)
