"""Scores of programs that nobody here wrote, on views of this project, beside the best of ours at the same time."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.records.study import Table
from harness.studies.framework import Found, Rows
from harness.studies.frontier.frontier_context import Frontier, FrontierContext

FILE = Path(__file__).with_name("peers.csv")
"""The measured points; another program is another row."""


@dataclass(frozen=True)
class Point:
    program: str
    protocol: str
    scene: str
    resolution: int
    core_seconds: float
    psnr: float


def read_points(file: Path = FILE) -> list[Point]:
    with file.open(encoding="utf-8", newline="") as rows:
        return [
            Point(
                row["program"],
                row["protocol"],
                row["scene"],
                int(row["resolution"]),
                float(row["core_seconds"]),
                float(row["psnr"]),
            )
            for row in csv.DictReader(rows)
        ]


def peers(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    amount = frontier.amount
    points = [p for p in read_points() if p.resolution == amount.resolution and p.scene in amount.scenes]
    rows: Rows = []
    for point in points:
        budget, family, psnr = best_within(frontier, point)
        rows.append(
            [
                point.program,
                point.scene,
                f"{point.core_seconds:g}",
                f"{point.psnr:.1f}",
                "" if family is None else f"{family}, {psnr:.1f} dB in {budget:g} core s",
                point.protocol,
            ]
        )
    if not rows:
        yield "No program of others was measured on these scenes at this size."
        return
    programs = ", ".join(dict.fromkeys(point.program for point in points))
    ahead = sum(psnr > point.psnr for point in points for _, family, psnr in [best_within(frontier, point)] if family)
    yield f"{programs}: at {ahead} of {len(points)} points a family of ours scores higher in no more core seconds."
    columns = ["program", "scene", "core s", "PSNR, dB", "the best of ours in no more time", "protocol"]
    yield Table("peers", 0, "Programs of others on a processor", columns, rows)


def best_within(frontier: Frontier, point: Point) -> tuple[float, str | None, float]:
    """Return the budget, the family and the score of the best of ours within the seconds of a point; None for the
    family if no budget is as short.
    """
    place = frontier.amount.scenes.index(point.scene)
    found = [
        (float(score), budget, family)
        for budget in frontier.budgets
        for family in frontier.trained
        if budget <= point.core_seconds and not np.isnan(score := frontier.table(budget, (family,))[0][place])
    ]
    if not found:
        return 0.0, None, -np.inf
    score, budget, family = max(found)
    return budget, family, score
