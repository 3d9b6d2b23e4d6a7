"""The result in plain words: against the baseline *and* against the bandwidth control, by steps and by time.

The verdicts are those of the run's comparisons; this module only finds the words. `nerf_matched` is the same network as
`nerf` with a bandwidth that reaches as far as φ: what it gains, bandwidth alone brings.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from harness.records.cells import Budget, Comparison
from harness.records.verdict import phrase_with
from harness.verdicts.changes import Situation, change
from harness.verdicts.headline_family import headline_budgets
from harness.verdicts.last_doubling import STILL_RISING, last_doublings
from reports.data.load import Records
from reports.data.outcome import Outcome, change_in_words, clause, clauses, doubts, on_few_scenes, size_words
from reports.data.scale import value_at
from reports.data.table import average_of, cells_frame, shared_scenes
from reports.data.wording import BUDGETS, counted, interval, listed, number, signed

LOST = ("diverged", "error")
FURTHER = 2


@dataclass(frozen=True)
class Duel:
    """One contender against one rival, at equal steps and at equal time."""

    method: str
    against: str
    steps: Comparison | None
    time: Comparison | None
    """At equal core seconds, or training seconds where no others were counted."""


@dataclass(frozen=True)
class Headline:
    title: str
    sentences: list[str]
    duels: list[Duel]


def tabulated(records: Records) -> list[tuple[Budget, str]]:
    """Return the budgets of the headline with their words: equal steps, and equal core seconds if they were counted."""
    known: list[Budget] = [row.budget for row in records.comparisons]
    return [(budget, BUDGETS[budget]) for budget in headline_budgets(known)]


def duels(records: Records, scene: str = "all") -> list[Duel]:
    budgets = [budget for budget, _ in tabulated(records)]
    return [
        Duel(method, rival, *(records.comparison(scene, method, rival, budget=budget) for budget in budgets))
        for method in records.contenders
        for rival in records.rivals
        if method != rival
    ]


def headline(records: Records) -> Headline:
    if not records.contenders:
        return Headline(f"Only {records.baseline} was run: there is nothing to compare it with", [], [])
    method, fought = records.contenders[0], duels(records)
    title = _title(records, method, [duel for duel in fought if duel.method == method])
    sentences = [_means(records), _others(records, method, fought), _bandwidth(records, method)]
    sentences += from_steps_to_time(records, method)
    sentences += [words for duel in fought for row in (duel.steps, duel.time) for words in doubts(row)]
    return Headline(title, [sentence for sentence in sentences if sentence], fought)


def title_of(vs_baseline: Outcome | None, vs_control: Outcome | None, control: str | None = None) -> str:
    """Return the line that a reader takes home: sign and size of the difference from the baseline at equal steps, and
    how much of it the bandwidth alone explains. `control` is the method with the bandwidth of φ alone, if it was run.
    """
    if vs_baseline is None:
        return ""
    told = clause(vs_baseline)
    if control == vs_baseline.method and vs_baseline.verdict.sign == "above 0":
        return f"{told}: bandwidth alone makes this difference"
    if vs_control is None or (vs_baseline.verdict.sign == "open" and on_few_scenes(vs_baseline)):
        return told
    same = f"{vs_control.against}, which has the same bandwidth,"
    if vs_control.verdict.sign == "open":
        return f"{clauses([vs_baseline, vs_control])}: {same} may do as well"
    if vs_control.verdict.sign == "above 0":
        return f"{told}; over {same} {vs_control.method} gains {vs_control.size}{size_words(vs_control.verdict)}"
    return f"{told}; {same} scores {vs_control.size} more{size_words(vs_control.verdict)}"


def outcome_of(records: Records, row: Comparison | None) -> Outcome | None:
    if row is None or row.difference is None:
        return None
    of_scenes = (records.comparison(scene, row.method, row.against, budget=row.budget) for scene in records.scenes)
    by_scene = tuple(each.difference for each in of_scenes if each is not None and each.difference is not None)
    return Outcome(row.method, row.against, (row.difference,), row.verdict, by_scene)


def _title(records: Records, method: str, fought: list[Duel]) -> str:
    baseline, control = records.baseline, records.control
    cells = [cell for cell in records.cells if cell.method == method]
    lost = sum(cell.status in LOST for cell in cells)
    if cells and all(cell.status == "not_available" for cell in cells):
        return f"{method} was not available: nothing can be said of it"
    if cells and lost == len(cells):
        return f"{method} did not finish a single run: nothing can be said of its quality"
    found = {duel.against: outcome for duel in fought if (outcome := outcome_of(records, duel.steps))}
    losses = [words for name in (method, baseline) if (words := _lost(records, name))]
    if losses and baseline not in found:
        return f"{' and '.join(losses)}: {method} and {baseline} cannot be compared"
    title = title_of(found.get(baseline), found.get(control or ""), control)
    title = title or f"No comparison of {method} with {baseline} could be made"
    how = ["at equal steps"] if any(duel.time for duel in fought) else []
    if found:  # the question that they answer (`reports.claims.estimands`)
        like = any(duel.steps and duel.steps.scenes_like_these for duel in fought)
        how.append("on scenes like these" if like else "on these scenes")
    gains = (row.gain for row in last_doublings(records.cells, [method, baseline]))
    unfinished = [rising(gains)] if found else []
    title = title if title.startswith(method) else title[0].upper() + title[1:]
    return "; ".join(filter(None, [f"{title} ({', '.join(how)})" if how else title, *unfinished, *losses]))


def rising(gains: Iterable[float | None]) -> str:
    """State what the last doubling of the steps brought at most, if training was not finished by then."""
    gain = max((gain for gain in gains if gain is not None), default=0.0)
    return f"training was not finished (twice the steps brought {number(gain, 1)} dB)" if gain >= STILL_RISING else ""


def _lost(records: Records, method: str) -> str:
    cells = [cell for cell in records.cells if cell.method == method]
    lost = sum(cell.status in LOST for cell in cells)
    return f"{method} lost {lost} of its {counted(len(cells), 'run')}" if lost else ""


def _means(records: Records) -> str:
    frame = cells_frame(records)
    scenes = shared_scenes(frame, "psnr")
    if not scenes:
        return ""
    means = {method: average_of(frame, method, "psnr", scenes).mean for method in records.methods}
    scored = [f"{method} {number(mean)} dB" for method, mean in means.items() if mean is not None]
    where = f"over {counted(len(scenes), 'scene')}" if len(scenes) > 1 else f"on {scenes[0]}"
    losses = [words for method in records.methods if (words := _lost(records, method))]
    survivors = f" This is of the runs that finished: {listed(losses)}." if losses else ""
    return f"Mean test PSNR {where}: {listed(scored)}.{survivors}"


def _others(records: Records, method: str, fought: list[Duel]) -> str:
    further = [name for name in dict.fromkeys(duel.method for duel in fought) if name != method][:FURTHER]
    found = [outcome_of(records, duel.steps) for duel in fought if duel.method in further]
    told = clauses([outcome for outcome in found if outcome])
    return f"At equal steps, {told}." if told else ""


def _bandwidth(records: Records, method: str) -> str:
    """Explain the control and its own gain: the size of the bandwidth effect."""
    baseline, control = records.baseline, records.control
    if control is None:
        encodings = [value_at(records.run.settings, "train", "own", name, "encoding") for name in (baseline, method)]
        if None in encodings or encodings[0] == encodings[1]:
            return ""
        return f"No method with the bandwidth of {method} was run, so a difference may be only an effect of bandwidth."
    why = (
        f"{control} is {baseline} with nothing changed but its encoding, cut down to "
        f"the frequencies that the φ encoding reaches. "
        f"Its own gain comes from bandwidth, not from the parts of the new method"
    )
    row = records.comparison("all", control, baseline)
    if row is None or row.difference is None:
        return f"{why}."
    known = f"{signed(row.difference)} dB {interval(row.simultaneous)}".rstrip()
    return f"{why}: here {known} ({phrase_with(row.verdict, row.simultaneous)})."


def from_steps_to_time(records: Records, method: str) -> list[str]:
    """State by how much each difference of `method` changes from equal steps to equal time, judged as a change."""
    (steps, _), (time, words) = tabulated(records)
    pairs = [(duel.method, duel.against) for duel in duels(records) if duel.method == method]
    told = []
    for pair in pairs:
        found = change(*pair, Situation(records.cells, steps), Situation(records.cells, time), family=len(pairs))
        if found is not None:
            told.append(change_in_words(found))
    return [f"From equal steps to {words}: {'; '.join(told)}."] if told else []
