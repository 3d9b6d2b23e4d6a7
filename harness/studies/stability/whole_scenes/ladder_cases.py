"""L1 and N1: the rung of each ladder at which a method breaks; and what scenes do not need, trained with and without.

A method breaks if it has no scores (diverged, failed), or explains less than half of the variance of what there is to
see. If the appearance of a surface is what is hard, that is measured within its silhouette, which any method finds; if
the shape is, on complete views. Being below a copy of the nearest training view is reported, and is no break by itself:
a fog ball looks the same from every side, and its copies are perfect.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from harness.execution.ground_truth import read_views
from harness.plan.needed import needs_of
from harness.plan.profiles import Plan, planned
from harness.plan.schedule import Budget
from harness.records.cells import CellRecord
from harness.records.study import Check, Series, Status, Table, check
from harness.studies.choices.omissions import Omission
from harness.studies.stability.stability_context import Finding, StabilityContext, whose
from harness.studies.stability.whole_scenes.scene_truth import (
    SceneRun,
    colour_variance,
    explained_share,
    mse_over_tests,
    share_of_looks,
    trained,
)
from scenes.catalog.ladders.ladders import LADDERS, Ladder
from scenes.modelling.needs import PARTS, Needs, left_out
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet

CASE = "L1"
ITEM = 9
PROFILE = "ladder"
ENOUGH = 0.5
"""The share of the variance below which a method counts as broken."""
LOOKS = ("frequency", "dynamic_range")
"""The ladders whose difficulty lies within the silhouette."""


LEAST_RUNGS = {"frequency": 1, "thinness": 2, "density": 5, "dynamic_range": 1, "scale": 5}
"""The rungs that ours must climb: every rung of the control, and of the fog, where they explain 0.97 and more;
measured: 1, 5, 5, 5 and 5, of which thinness and dynamic range explain little more than half.
"""


@dataclass(frozen=True)
class RungScore:
    """The performance of a method on one rung."""

    share: float | None
    """The share of the variance that it explains; None if it has no scores."""
    broken: str
    """The reason why it counts as broken there; empty if it does not."""
    note: str = ""


def ladders(situation: StabilityContext) -> Iterator[Finding]:
    """L1: train every rung, then judge by the test views alone."""
    names = [scene for ladder in LADDERS.values() for scene in ladder.scenes]
    found = trained(situation, PROFILE, names, situation.out / "ladders")
    rows: list[list[str | float | None]] = []
    for ladder in LADDERS.values():
        sets = [read_views(found.folder(scene), situation.plan(PROFILE).views, situation.scratch)
                for scene in ladder.scenes]  # fmt: skip
        yield _line(ladder, "the ground truth's own noise allows", list(ladder.values), [ceiling(one) for one in sets])
        standings: dict[str, list[RungScore]] = {}
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


def standing(found: SceneRun, cell: CellRecord, views: ViewSet, looks: bool) -> RungScore:
    """Score a method; `looks` does so within the silhouette, on the pictures that the record keeps, else on all test
    views.
    """
    if cell.status != "done":
        return RungScore(None, f"{cell.status}: {cell.reason}")
    share = share_of_looks(found, cell, views) if looks else share_of_views(cell, views)
    if share is None:
        return RungScore(None, "its record keeps nothing to judge by")
    psnr, floor = cell.scores.get("psnr"), cell.scores.get("psnr_floor")
    below = psnr is not None and floor is not None and psnr < floor
    note = f"{psnr:.1f} dB, a copy of the nearest training view {floor:.1f} dB" if below else ""
    return RungScore(share, f"explains {share:.0%}" if share < ENOUGH else "", note)


def share_of_views(cell: CellRecord, views: ViewSet) -> float | None:
    mse = mse_over_tests(cell)
    pixels = np.concatenate([over_white(rgba).reshape(-1, 3) for rgba in views.test.rgba])
    return None if mse is None else explained_share(mse, colour_variance(pixels))


def ceiling(views: ViewSet) -> float:
    """Return what is left of 1 when the rendering noise of complete views is subtracted."""
    pixels = np.concatenate([over_white(rgba).reshape(-1, 3) for rgba in views.test.rgba])
    noise = 0.0 if views.test.noise_mse is None else float(np.mean(views.test.noise_mse))
    return explained_share(noise, colour_variance(pixels))


def worst(of_seeds: list[RungScore]) -> RungScore:
    """Return the seed that does worst: no score before any, then the smallest share."""
    return min(of_seeds, key=lambda one: (one.share is not None, one.share or 0.0))


def rungs_climbed(standings: list[RungScore]) -> int:
    """Count the rungs before the first on which it breaks."""
    return next((place for place, one in enumerate(standings) if one.broken), len(standings))


def _line(ladder: Ladder, name: str, x: list[float], explained: list[float]) -> Series:
    """Return the unexplained share, on a logarithmic axis: a picture may be wrong by far more than there is to see."""
    order = np.argsort(x)  # the ladder of scales goes both ways
    label, y = "share of variance not explained", [1.0 - share for share in explained]
    return Series(
        f"{ladder.name}: {ladder.title}", ITEM, name, ladder.unit, label, [x[i] for i in order], [y[i] for i in order],
        log_x=True, log_y=True,
    )  # fmt: skip


def _breaks(ladder: Ladder, standings: dict[str, list[RungScore]]) -> Iterator[Series]:
    """Yield a mark on every line where it first breaks, rung by rung: what breaks on one rung shares its x."""
    for rung, x in enumerate(ladder.values):
        first = [climbed[rung].share for climbed in standings.values() if rungs_climbed(climbed) == rung]
        shares = [share for share in first if share is not None]
        if shares:
            yield _line(ladder, f"first rung that breaks: {rung + 1}", [x] * len(shares), shares)


def _row(ladder: Ladder, method: str, climbed: list[RungScore]) -> list[str | float | None]:
    count = rungs_climbed(climbed)
    where = f"{count + 1}: {ladder.values[count]:g} {ladder.unit}" if count < len(climbed) else "none"
    why = climbed[count].broken if count < len(climbed) else ""
    notes = (f"rung {place + 1}: {one.note}" for place, one in enumerate(climbed) if one.note)
    return [ladder.name, method, where, why, *(one.share for one in climbed), "; ".join(notes)]


def _outcome(ladder: Ladder, found: SceneRun, method: str, climbed: list[RungScore]) -> Check:
    what = f"{ladder.name}: rungs climbed of {len(climbed)}"
    first = found.cells[ladder.scenes[0], method][0]
    if first.status == "not_available":
        return Check(what, None, why=first.reason or "", subject=method, owner=whose(method), status="not_available")
    count = rungs_climbed(climbed)
    why = f"at {ladder.values[count]:g} {ladder.unit} it {climbed[count].broken}" if count < len(climbed) else ""
    least = float(LEAST_RUNGS[ladder.name])
    return check(what, float(count), low=least, why=why, subject=method, owner=whose(method))


SCENES = ("materials", "tiny")
"""The scenes: mirroring (the controls are tried on it), and Lambertian, which needs no view direction."""
FOG = "fog_dense"
STEPS, SEEDS = 300, (0, 1, 2)
FOG_VIEWS, FOG_PIXELS, FOG_SPP = 3, 24, 16
CHAPTER = 13
COLUMNS = ["left out", "because", "concerns", "seconds saved", "of", "change", "95 %", "bound", "unit", "verdict"]
NOTHING_TO_TRY = "nothing to try: no method has it"


def omissions(situation: StabilityContext) -> Iterator[Finding]:
    """N1: small cells, three seeds, every omission that concerns model, sampling or rendering."""
    from harness.execution.ground_truth import read_views
    from harness.execution.run import view_set_folders
    from harness.studies.choices.verification import compared_integrators, omission_of_integrators, verified

    plan = _plan(situation)
    folders = view_set_folders(plan, situation.view_sets, situation.show)
    found, controls = verified(
        plan, folders, situation.scratch, situation.workers, situation.show.line, controls=not situation.quick
    )
    for name in dict.fromkeys(one.name for one in found):
        yield _worst([one for one in found if one.name == name])
    for one in controls:
        if one.name == "high_bands":
            yield _control(one)
    fog = omission_of_integrators(compared_integrators(FOG, FOG_PIXELS, FOG_VIEWS, FOG_SPP), FOG_PIXELS**2)
    yield _control(replace(fog, what=f"volumetric integrator on {FOG}"))
    for scene, folder in folders.items():
        needs = needs_of(read_views(folder, plan.views, situation.scratch))
        yield _table(scene, needs, [one for one in found if one.scene == scene])
    yield Table(
        "left-out-controls",
        CHAPTER,
        "Controls: what is needed, left out all the same",
        ["scene", *COLUMNS],
        [[one.scene, *_omission_row(one, "needed: left out to see what that costs")] for one in [*controls, fog]],
    )


def _plan(situation: StabilityContext) -> Plan:
    """Return a plan with views of the smoke profile, trained as the reduced profile trains.

    In the smoke profile's own steps skipping empty space does cost more than its bound: 0.34 dB after 120 steps on
    `tiny`, whether or not the grid is used for rendering. It prunes what has hardly been learnt; with the reduced
    profile's grid, which waits for step 100, 0.09 dB after 300.
    """
    plan = situation.plan("smoke", list(SCENES))
    method = "nerf" if "nerf" in plan.methods else plan.methods[0]
    if situation.quick:
        return replace(plan, methods=(method,), seeds=(0,))
    train = planned("reduced", precision="float32").train
    return replace(plan, methods=(method,), seeds=SEEDS, budget=Budget(STEPS, None), train=train)


def _worst(found: list[Omission]) -> Check:
    """Return the worst of one part over scenes: what costs more than its bound fails; what is not settled is no pass,
    nor a failure.
    """
    costly = [one for one in found if one.verdict == "costs more"]
    open_ = [one for one in found if one.verdict != "within its bound" or one.difference is None]
    unmeasured = any(one.difference is None for one in open_)
    status: Status = "fail" if costly else "not_available" if unmeasured else "inconclusive" if open_ else "pass"
    among = costly or open_ or found
    measured = [one for one in among if one.difference is not None]
    worst = max(measured or among, key=lambda one: _cost(one) or 0.0)
    why = [f"costs more on {' '.join(one.scene for one in costly)}"] if costly else []
    why += [_not_settled(one) for one in open_ if one not in costly]
    seconds = [one.seconds_saved for one in found if one.seconds_saved is not None]
    why += [f"shown: {worst.scene}"] if measured else []
    why += [f"{sum(seconds):.1f} s saved ({found[0].clock}) on {len(seconds)} scenes"] if seconds else []
    return Check(
        "test PSNR lost by leaving it out" if worst.unit == "dB" else "change of a colour",
        _cost(worst),
        high=worst.bound,
        unit=worst.unit,
        why="; ".join(why),
        subject=worst.title,
        status=status,
    )


def _not_settled(one: Omission) -> str:
    if one.difference is None:
        return f"{one.scene}: no measurement: {_uncounted(one)}"
    if one.interval is None:
        return f"{one.scene}: inconclusive: no interval from {_counted(one)}"
    low, high = (one.interval[0], one.interval[1]) if one.unit != "dB" else (-one.interval[1], -one.interval[0])
    return f"{one.scene}: inconclusive: interval [{low:+.2g}, {high:+.2g}] {one.unit} over {_counted(one)}"


def _counted(one: Omission) -> str:
    return f"{one.pairs} {'seed' if one.pairs == 1 else 'seeds'}"


def _uncounted(one: Omission) -> str:
    """Return why there is no difference."""
    return f"{one.diverged} of {one.pairs + one.diverged} pairs of cells have no score, as one of them diverged"


def _control(one: Omission) -> Check:
    cost, subject, what = _cost(one), f"control: {one.title}", "what leaving out something needed costs"
    if cost is None:
        why = f"no measurement: {_uncounted(one)}"
        return Check(what, None, low=one.bound, unit=one.unit, why=why, subject=subject, status="not_available")
    return check(what, cost, low=one.bound, unit=one.unit, why="else nothing could fail here", subject=subject)


def _cost(one: Omission) -> float | None:
    """Return how much worse it became; None if nothing was measured."""
    if one.difference is None:
        return None
    return -one.difference if one.unit == "dB" else abs(one.difference)


def _table(scene: str, needs: Needs, found: list[Omission]) -> Table:
    by_name = {one.name: one for one in found}
    rows = []
    for row in left_out(needs):
        one = by_name.get(row["name"])
        if one is not None:
            rows.append(_omission_row(one, row["reason"]))
        else:
            empty = [None, None, None, None, row["bound"], row["unit"], NOTHING_TO_TRY]
            rows.append([row["what"], row["reason"], row["concerns"], *empty])
    return Table(f"left-out-{scene}", CHAPTER, f"{scene}: left out", COLUMNS, rows)


def _omission_row(one: Omission, because: str) -> list[str | float | None]:
    between = None if one.interval is None else f"{one.interval[0]:+.3g} … {one.interval[1]:+.3g}"
    return [
        one.title, because, PARTS[one.name].concerns, one.seconds_saved, one.clock, one.difference, between, one.bound,
        one.unit, one.verdict,
    ]  # fmt: skip
