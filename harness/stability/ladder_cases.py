"""L1: scenes that get harder rung by rung, and the rung at which each method breaks.

A method breaks where it has no scores (diverged, failed), or explains less than half of the variance of what there is
to see. Where a surface's looks are what is hard, that is asked within its silhouette, which any method finds; where
the shape is, of whole views. Being below a copy of the nearest training view is said, and is no break by itself: a
fog ball looks the same from every side, and its copies are perfect.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.chart_record import Series, Table
from harness.ground_truth import read_views
from harness.records import CellRecord
from harness.stability.looks import share_of_looks
from harness.stability.scene_findings import mse_over_tests
from harness.stability.scene_truth import colour_variance, explained_share
from harness.stability.situation import Finding, Situation, whose
from harness.stability.trained_scenes import Trained, trained
from harness.stability_record import Outcome, judged
from scenes.ladders import LADDERS, Ladder
from scenes.pixels import over_white
from scenes.view_set import ViewSet

CASE = "L1"
ITEM = 9
PROFILE = "ladder"
ENOUGH = 0.5
"""Share of the variance below which a method counts as broken."""
LOOKS = ("frequency", "dynamic_range")
"""Ladders whose difficulty lies within the silhouette."""


LEAST_RUNGS = {"frequency": 1, "thinness": 2, "density": 5, "dynamic_range": 1, "scale": 5}
"""What ours must climb: every rung of the control, and of the fog, where they explain 0.97 and more; measured: 1, 5,
5, 5 and 5, of which thinness and dynamic range explain little more than half."""


@dataclass(frozen=True)
class Standing:
    """How a method does on one rung."""

    share: float | None
    """Of the variance that it explains; None where it has no scores."""
    broken: str
    """Why it counts as broken there; empty where it does not."""
    note: str = ""


def ladders(situation: Situation) -> Iterator[Finding]:
    """Trains every rung, then judges by the test views alone."""
    names = [scene for ladder in LADDERS.values() for scene in ladder.scenes]
    found = trained(situation, PROFILE, names, situation.out / "ladders")
    rows: list[list[str | float | None]] = []
    for ladder in LADDERS.values():
        sets = [read_views(found.folder(scene), situation.plan(PROFILE).views, situation.scratch)
                for scene in ladder.scenes]  # fmt: skip
        yield _line(ladder, "the ground truth's own noise allows", list(ladder.values), [ceiling(one) for one in sets])
        standings: dict[str, list[Standing]] = {}
        for method in found.methods:
            climbed = [
                worst([standing(found, cell, views, ladder.name in LOOKS) for cell in found.cells[scene, method]])
                for scene, views in zip(ladder.scenes, sets, strict=True)
            ]
            seen = [(x, one.share) for x, one in zip(ladder.values, climbed, strict=True) if one.share is not None]
            if seen:
                yield _line(ladder, method, [x for x, _ in seen], [share for _, share in seen])
            rows.append(_row(ladder, method, climbed))
            yield _outcome(ladder, found, method, climbed)
            standings[method] = climbed
        yield _line(ladder, "half explained", list(ladder.values), [ENOUGH] * len(ladder.values))
        yield from _breaks(ladder, standings)
    rungs = max(len(ladder.values) for ladder in LADDERS.values())
    columns = ["ladder", "method", "breaks on", "why", *(f"rung {i + 1}" for i in range(rungs)), "to know"]
    title = f"The first rung on which a method explains less than {ENOUGH:.0%} of the variance of what there is to see"
    yield Table("ladders", ITEM, title, columns, rows)


def standing(found: Trained, cell: CellRecord, views: ViewSet, looks: bool) -> Standing:
    """`looks`: asked within the silhouette, of the pictures that the record keeps; else of all test views."""
    if cell.status != "done":
        return Standing(None, f"{cell.status}: {cell.reason}")
    share = share_of_looks(found, cell, views) if looks else share_of_views(cell, views)
    if share is None:
        return Standing(None, "its record keeps nothing to judge by")
    psnr, floor = cell.scores.get("psnr"), cell.scores.get("psnr_floor")
    below = psnr is not None and floor is not None and psnr < floor
    note = f"{psnr:.1f} dB, a copy of the nearest training view {floor:.1f} dB" if below else ""
    return Standing(share, f"explains {share:.0%}" if share < ENOUGH else "", note)


def share_of_views(cell: CellRecord, views: ViewSet) -> float | None:
    mse = mse_over_tests(cell)
    pixels = np.concatenate([over_white(rgba).reshape(-1, 3) for rgba in views.test.rgba])
    return None if mse is None else explained_share(mse, colour_variance(pixels))


def ceiling(views: ViewSet) -> float:
    """What is left of 1 when the rendering noise of whole views is taken off."""
    pixels = np.concatenate([over_white(rgba).reshape(-1, 3) for rgba in views.test.rgba])
    noise = 0.0 if views.test.noise_mse is None else float(np.mean(views.test.noise_mse))
    return explained_share(noise, colour_variance(pixels))


def worst(of_seeds: list[Standing]) -> Standing:
    """Of several seeds the one that does worst: no score before any, then the smallest share."""
    return min(of_seeds, key=lambda one: (one.share is not None, one.share or 0.0))


def rungs_climbed(standings: list[Standing]) -> int:
    """How many rungs come before the first on which it breaks."""
    return next((place for place, one in enumerate(standings) if one.broken), len(standings))


def _line(ladder: Ladder, name: str, x: list[float], explained: list[float]) -> Series:
    """What is not explained, on a logarithmic axis: a picture may be wrong by far more than there is to see."""
    order = np.argsort(x)  # the ladder of scales goes both ways
    label, y = "share of variance not explained", [1.0 - share for share in explained]
    return Series(
        f"{ladder.name}: {ladder.title}", ITEM, name, ladder.unit, label, [x[i] for i in order], [y[i] for i in order],
        log_x=True, log_y=True,
    )  # fmt: skip


def _breaks(ladder: Ladder, standings: dict[str, list[Standing]]) -> Iterator[Series]:
    """A mark on every line where it first breaks, rung by rung: what breaks on one rung shares its x."""
    for rung, x in enumerate(ladder.values):
        first = [climbed[rung].share for climbed in standings.values() if rungs_climbed(climbed) == rung]
        shares = [share for share in first if share is not None]
        if shares:
            yield _line(ladder, f"first rung that breaks: {rung + 1}", [x] * len(shares), shares)


def _row(ladder: Ladder, method: str, climbed: list[Standing]) -> list[str | float | None]:
    count = rungs_climbed(climbed)
    where = f"{count + 1}: {ladder.values[count]:g} {ladder.unit}" if count < len(climbed) else "none"
    why = climbed[count].broken if count < len(climbed) else ""
    notes = (f"rung {place + 1}: {one.note}" for place, one in enumerate(climbed) if one.note)
    return [ladder.name, method, where, why, *(one.share for one in climbed), "; ".join(notes)]


def _outcome(ladder: Ladder, found: Trained, method: str, climbed: list[Standing]) -> Outcome:
    what = f"{ladder.name}: rungs climbed of {len(climbed)}"
    first = found.cells[ladder.scenes[0], method][0]
    if first.status == "not_available":
        return Outcome(CASE, method, whose(method), "not_available", what=what, why=first.reason or "")
    count = rungs_climbed(climbed)
    why = f"at {ladder.values[count]:g} {ladder.unit} it {climbed[count].broken}" if count < len(climbed) else ""
    least = float(LEAST_RUNGS[ladder.name])
    return judged(CASE, method, whose(method), float(count), least, sense="at_least", what=what, why=why)
