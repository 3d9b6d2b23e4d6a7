"""The result in plain words: against the baseline *and* against the bandwidth control, by steps and by time.

The verdicts are those of the run's comparisons; this module only finds the words. A gain over `nerf` that is gone
against `nerf_matched` (the same network with a bandwidth that reaches as far as φ) is called no more than the effect of
bandwidth alone.
"""

from dataclasses import dataclass

from harness.records.cells import Comparison
from harness.verdicts.comparisons import baseline_of
from harness.verdicts.last_doubling import STILL_RISING, last_doublings
from reports.data.load import Records
from reports.data.table import average_of, cells_frame, shared_scenes
from reports.data.wording import BUDGETS, counted, interval, listed, number, signed

BASELINE = "nerf"
CONTROL = "nerf_matched"
FAVOURITE = "qnerf"
LOST = ("diverged", "error")
TABULATED = tuple((budget, BUDGETS[budget]) for budget in ("steps", "seconds"))
"""The budgets that differences stand at in tables, beside each other; those of the others are rows of their own."""


@dataclass(frozen=True)
class Roles:
    """The roles of the methods in the comparison."""

    baseline: str
    control: str | None
    contenders: list[str]
    """The tested methods, the one of the headline first."""


@dataclass(frozen=True)
class Duel:
    """One contender against one rival, at equal steps and at equal time."""

    method: str
    against: str
    steps: Comparison | None
    seconds: Comparison | None


@dataclass(frozen=True)
class Headline:
    title: str
    sentences: list[str]
    duels: list[Duel]


def roles(records: Records) -> Roles:
    methods = records.methods
    baseline = baseline_of(methods)
    control = CONTROL if CONTROL in methods and baseline != CONTROL else None
    others = [method for method in methods if method not in (baseline, control)]
    others.sort(key=lambda method: method != FAVOURITE)
    return Roles(baseline, control, others or [method for method in (control,) if method])


def duels(records: Records, scene: str = "all") -> list[Duel]:
    """Return every contender against the baseline and against the control."""
    cast = roles(records)
    return [
        Duel(method, rival, *(records.comparison(scene, method, rival, budget=budget) for budget, _ in TABULATED))
        for method in cast.contenders
        for rival in (cast.baseline, cast.control)
        if rival is not None and method != rival
    ]


def headline(records: Records) -> Headline:
    cast, fought = roles(records), duels(records)
    if not cast.contenders:
        return Headline(f"Only {cast.baseline} was run: there is nothing to compare it with", [], [])
    method = cast.contenders[0]
    title = _title(records, cast, method, [duel for duel in fought if duel.method == method])
    sentences = [_means(records), _bandwidth(records, cast), *disagreements(records, method)]
    return Headline(title, [sentence for sentence in sentences if sentence], fought)


def title_of(method: str, baseline: str, control: str | None, vs_baseline: str | None, vs_control: str | None) -> str:
    """Return the one line that a reader takes home, from the two verdicts at equal steps."""
    if vs_baseline is None:
        return f"No comparison of {method} with {baseline} could be made"
    if vs_baseline == "better":
        if control == method:
            return f"{method} scores above {baseline}: bandwidth alone makes this difference"
        if control is None or vs_control is None:
            return f"{method} scores above {baseline}, but without a bandwidth control beside it this says little"
        gain = f"The gain of {method} over {baseline}"
        return {
            "better": f"{method} scores above both {baseline} and {control}",
            "equivalent": f"{gain} is no more than bandwidth alone brings: {control} does as well",
            "worse": f"{gain} is no more than bandwidth alone brings: {control} does better still",
            "inconclusive": f"{gain} is not shown to be more than bandwidth alone brings: {control} may do as well",
        }[vs_control]
    alone, both = {
        "worse": (f"{method} scores below {baseline}", f"{method} scores below both {baseline} and {control}"),
        "equivalent": (
            f"{method} and {baseline} score the same within the margin",
            f"{method} scores the same as {baseline} and {control}, within the margin",
        ),
        "inconclusive": (
            f"This run cannot tell {method} from {baseline}",
            f"This run cannot tell {method} from {baseline} or {control}",
        ),
    }[vs_baseline]
    if control is None or vs_control is None or control == method:
        return alone
    beside = {
        "better": f"{method} scores above {control}",
        "worse": f"{method} scores below {control}",
        "equivalent": f"{method} is level with {control}",
        "inconclusive": f"against {control} nothing is settled",
    }[vs_control]
    return both if vs_control == vs_baseline else f"{alone}; {beside}"


def _title(records: Records, cast: Roles, method: str, fought: list[Duel]) -> str:
    cells = [cell for cell in records.cells if cell.method == method]
    lost = sum(cell.status in LOST for cell in cells)
    if cells and all(cell.status == "not_available" for cell in cells):
        return f"{method} was not available: nothing can be said of it"
    if cells and lost == len(cells):
        return f"{method} did not finish a single cell: nothing can be said of its quality"
    verdicts = {duel.against: duel.steps.verdict for duel in fought if duel.steps and duel.steps.difference is not None}
    losses = [words for name in (method, cast.baseline) if (words := _lost(records, name))]
    if losses and cast.baseline not in verdicts:
        open_ = f"against {cast.baseline} nothing is settled" if lost else f"nothing is settled about {method}"
        return f"{' and '.join(losses)}: {open_}"
    vs_baseline, vs_control = (verdicts.get(rival or "") for rival in (cast.baseline, cast.control))
    title = title_of(method, cast.baseline, cast.control, vs_baseline, vs_control)
    differs = any(duel.seconds and duel.steps and duel.seconds.verdict != duel.steps.verdict for duel in fought)
    how = ["at equal steps"] if differs else []
    if verdicts:  # the question that they answer (`reports.claims.estimands`)
        like = any(duel.steps and duel.steps.scenes_like_these for duel in fought)
        how.append("on scenes like these" if like else "on these scenes")
    rising = [_rising(records, [method, cast.baseline])] if verdicts else []
    return "; ".join(filter(None, [f"{title} ({', '.join(how)})" if how else title, *rising, *losses]))


def _rising(records: Records, methods: list[str]) -> str:
    """Return `still rising by 0.9 dB a doubling`, of the method that rises more; nothing near convergence."""
    gain = max((row.gain for row in last_doublings(records.cells, methods) if row.gain is not None), default=0.0)
    return f"still rising by {number(gain, 1)} dB a doubling" if gain >= STILL_RISING else ""


def _lost(records: Records, method: str) -> str:
    """Return `qnerf lost 1 of its 6 cells`, or nothing."""
    cells = [cell for cell in records.cells if cell.method == method]
    lost = sum(cell.status in LOST for cell in cells)
    return f"{method} lost {lost} of its {counted(len(cells), 'cell')}" if lost else ""


def _means(records: Records) -> str:
    """State the mean test PSNR of every method over the scenes that all have; of the survivors, if some are lost."""
    frame = cells_frame(records)
    scenes = shared_scenes(frame, "psnr")
    if not scenes:
        return ""
    means = {method: average_of(frame, method, "psnr", scenes).mean for method in records.methods}
    scored = [f"{method} {number(mean)} dB" for method, mean in means.items() if mean is not None]
    where = f"over {counted(len(scenes), 'scene')}" if len(scenes) > 1 else f"on {scenes[0]}"
    losses = [words for method in records.methods if (words := _lost(records, method))]
    survivors = f" This is of the cells that finished: {listed(losses)}." if losses else ""
    return f"Mean test PSNR {where}: {listed(scored)}.{survivors}"


def _bandwidth(records: Records, cast: Roles) -> str:
    """Explain the control and its own gain: the size of the bandwidth effect."""
    if cast.control is None:
        return f"{CONTROL} was not run, so a difference cannot be told from an effect of bandwidth alone."
    why = (
        f"{cast.control} is {cast.baseline} with nothing changed but its encoding, cut down to "
        f"the frequencies that the φ encoding reaches. "
        f"What it gains too is owed to bandwidth, not to the parts of the new method"
    )
    row = records.comparison("all", cast.control, cast.baseline)
    if row is None or row.difference is None:
        return f"{why}."
    return f"{why}: here {signed(row.difference)} dB {interval(row.interval)}".rstrip() + f" ({row.verdict})."


def disagreements(records: Records, method: str) -> list[str]:
    """State where the verdict at equal time differs from the one at equal steps, and where that is unknown."""
    cases, compared, skipped = [], 0, 0
    for scene in ["all", *records.scenes]:
        for duel in duels(records, scene):
            sides = [row for row in (duel.steps, duel.seconds) if row is not None]
            if duel.method != method or not sides:
                continue
            complete = sum(row.difference is not None for row in sides) == 2
            compared, skipped = compared + complete, skipped + (not complete)
            if len(sides) == 2 and sides[0].verdict != sides[1].verdict:
                where = "over all scenes" if scene == "all" else f"on {scene}"
                cases.append(f"{where} against {duel.against} ({sides[0].verdict} → {sides[1].verdict})")
    if not cases:
        where = f"wherever both could be compared ({skipped} could not)" if skipped else "everywhere"
        return [f"Equal steps and equal time lead to the same verdict on {method} {where}."] if compared else []
    if len(cases) > 5:
        cases = [*cases[:5], counted(len(cases) - 5, "more case")]
    return [f"Equal steps and equal time differ on {method} {listed(cases)}."]
