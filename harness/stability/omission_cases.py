"""Case N1: what scenes do not need, trained with it and without; and something needed left out, which must cost."""

from collections.abc import Iterator
from dataclasses import replace

from harness.chart_record import Table
from harness.needed import needs_of
from harness.omissions import Omission
from harness.plan import Plan, planned
from harness.schedule import Budget
from harness.stability.situation import Finding, Situation
from harness.stability_record import Outcome, Status, judged
from scenes.needs import PARTS, Needs, left_out

SCENES = ("materials", "tiny")
"""Mirroring (the controls are tried on it), and Lambertian: that needs no view direction."""
FOG = "fog_dense"
STEPS, SEEDS = 300, (0, 1, 2)
FOG_VIEWS, FOG_PIXELS, FOG_SPP = 3, 24, 16
CHAPTER = 13
COLUMNS = ["left out", "because", "concerns", "seconds saved", "of", "change", "95 %", "bound", "unit", "verdict"]
NOTHING_TO_TRY = "nothing to try: no method has it"


def omissions(situation: Situation) -> Iterator[Finding]:
    """Small cells, three seeds, every omission that concerns model, sampling or rendering."""
    from harness.ground_truth import read_views
    from harness.runner import view_set_folders
    from harness.verification import compared_integrators, omission_of_integrators, verified

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
        [[one.scene, *_row(one, "needed: left out to see what that costs")] for one in [*controls, fog]],
    )


def _plan(situation: Situation) -> Plan:
    """Views of the smoke profile, trained as the reduced profile trains.

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


def _worst(found: list[Omission]) -> Outcome:
    """Of one part over scenes: what costs more than its bound fails; what is not settled is no pass, nor a failure."""
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
    return Outcome(
        "N1",
        worst.title,
        "ours",
        status,
        _cost(worst),
        worst.bound,
        unit=worst.unit,
        what="test PSNR lost by leaving it out" if worst.unit == "dB" else "change of a colour",
        why="; ".join(why),
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
    """Why there is no difference."""
    return f"{one.diverged} of {one.pairs + one.diverged} pairs of cells have no score, as one of them diverged"


def _control(one: Omission) -> Outcome:
    cost, subject, what = _cost(one), f"control: {one.title}", "what leaving out something needed costs"
    if cost is None:
        why = f"no measurement: {_uncounted(one)}"
        return Outcome("N1", subject, "ours", "not_available", None, one.bound, "at_least", one.unit, what, why)
    return judged(
        "N1", subject, "ours", cost, one.bound, unit=one.unit, sense="at_least", what=what,
        why="else nothing could fail here",
    )  # fmt: skip


def _cost(one: Omission) -> float | None:
    """How much worse it became; None where nothing was measured."""
    if one.difference is None:
        return None
    return -one.difference if one.unit == "dB" else abs(one.difference)


def _table(scene: str, needs: Needs, found: list[Omission]) -> Table:
    by_name = {one.name: one for one in found}
    rows = []
    for row in left_out(needs):
        one = by_name.get(row["name"])
        if one is not None:
            rows.append(_row(one, row["reason"]))
        else:
            empty = [None, None, None, None, row["bound"], row["unit"], NOTHING_TO_TRY]
            rows.append([row["what"], row["reason"], row["concerns"], *empty])
    return Table(f"left-out-{scene}", CHAPTER, f"{scene}: left out", COLUMNS, rows)


def _row(one: Omission, because: str) -> list[str | float | None]:
    between = None if one.interval is None else f"{one.interval[0]:+.3g} … {one.interval[1]:+.3g}"
    return [
        one.title, because, PARTS[one.name].concerns, one.seconds_saved, one.clock, one.difference, between, one.bound,
        one.unit, one.verdict,
    ]  # fmt: skip
