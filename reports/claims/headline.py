"""The result as sentences: against the baseline *and* against the bandwidth control, by steps and by time.

The verdicts are those of the run's comparisons; this module only words them. `nerf_matched` is the same network as
`nerf` with a bandwidth that reaches as far as φ: its gain is the effect of only the bandwidth.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from harness.records.cells import Comparison
from harness.records.claims import STATED
from harness.records.verdict import phrase_with
from harness.verdicts.changes import Condition, change
from harness.verdicts.failures import is_lost
from harness.verdicts.headline_family import is_headline
from harness.verdicts.last_doubling import STILL_RISING, last_doublings
from reports.claims.claim_list import claims, tally
from reports.claims.table import LOOKS, link_of, measured_entry, printed_text
from reports.data.load import Records
from reports.data.outcome import (
    Outcome,
    change_in_words,
    clause,
    clauses,
    doubts,
    is_on_few_scenes,
    none_shown,
    size_words,
)
from reports.data.scale import value_at
from reports.data.table import average_of, cells_frame, shared_scenes
from reports.data.wording import BUDGETS, UNTESTED, counted, interval, listed, number, signed

ANSWERS = {"holds": "Yes", "fails": "No", "": "Open", "muted": "Not tested"}
"""The tone of a claim's verdict → the answer to whether it holds."""
FURTHER = 2
SEARCHED = {"encoding", "density_scale", "start"}
"""The settings in which a control of bandwidth may differ from the baseline."""


@dataclass(frozen=True)
class Duel:
    method: str
    against: str
    steps: Comparison | None
    time: Comparison | None
    """At equal core seconds, or training seconds in a run that did not count them."""


@dataclass(frozen=True)
class Headline:
    answer: str
    but: list[str]
    """What qualifies the answer: unfinished training, lost runs."""
    sentences: list[str]

    @property
    def title(self) -> str:
        return "; ".join([self.answer, *self.but])


def duels(records: Records) -> list[Duel]:
    return [
        Duel(method, rival, *(records.comparison("all", method, rival, budget=budget) for budget in records.budgets))
        for method in records.contenders
        for rival in records.rivals
        if method != rival
    ]


def headline(records: Records) -> Headline:
    """Answer the claims that the user states, if there are any; else compare the first two contenders."""
    fought = duels(records)
    sentences: list[str] = []
    but: list[str] = []
    if records.contenders:
        method = records.contenders[0]
        answer, but = _outcome(records, method, fought)
        sentences += [_means(records), _others(records, fought), _bandwidth(records, method)]
        sentences += from_steps_to_time(records, method)
        sentences += [words for duel in fought for row in (duel.steps, duel.time) for words in doubts(row)]
    else:
        answer = f"Only {records.baseline} was run: there is nothing to compare it with"
    if stated := _stated(records):
        sentences = [f"{'; '.join([answer, *but])}.", *sentences]
        answer, but = stated
    return Headline(answer, but, [sentence for sentence in sentences if sentence])


def _stated(records: Records) -> tuple[str, list[str]] | None:
    """State whether the claims of `--claim` hold: that of a single claim with its figures and what qualifies it."""
    files = [file for file in records.run.claims or [] if file.id == STATED]
    judged = [claim for claim in claims(records) if claim.file == STATED] if files else []
    if not judged:
        return None
    if len(judged) > 1:
        each = [f"{many} {'is' if many == 1 else 'are'} {verdict}" for verdict, many in tally(judged)]
        return f"Of {len(judged)} stated claims, {listed(each)}", []
    (claim,), (about,) = judged, (entry.of for entry in files[0].claims)
    names = [about[role] for role in ("method", "against") if role in about]
    figures = measured_entry(claim)
    known = f"{claim.statement} {link_of(claim)} {figures.text} {figures.small}".rstrip()
    if claim.measured is None:
        known = f"this would {claim.note}" if claim.verdict == UNTESTED else claim.note
    words = f"{ANSWERS[LOOKS[claim.verdict][1]]}: {known}; claimed: {printed_text(claim)}"
    more = [rising(row.gain for row in last_doublings(records.cells, names)), *(_lost(records, name) for name in names)]
    return words, [each for each in more if each]


def title_of(
    judged: Sequence[Outcome], method: str, baseline: str, control: str | None, how: str, more: Iterable[str] = ()
) -> str:
    """Return the answer of `answer_of`, and what qualifies it."""
    return "; ".join(filter(None, [answer_of(judged, method, baseline, control, how), *more]))


def answer_of(judged: Sequence[Outcome], method: str, baseline: str, control: str | None, how: str) -> str:
    """State the differences of `method` and, behind them, those of others; then `how` they were compared.
    `control` is the baseline with the bandwidth of `method`, if it was run.
    """
    first = {outcome.against: outcome for outcome in judged if outcome.method == method}
    if baseline in first:
        start = _of_first(first[baseline], first.get(control or ""), control)
    else:
        start = f"No comparison of {method} with {baseline} could be made"
    others = [outcome for outcome in judged if outcome.method != method]
    if baseline in first and is_on_few_scenes(first[baseline]):
        words = clauses([first[baseline], *others])
    else:
        words = (none_shown(judged) if baseline in first else "") or "; ".join(filter(None, [start, clauses(others)]))
    words = words if words.startswith(method) else words[0].upper() + words[1:]
    return f"{words} ({how})" if how else words


def _of_first(vs_baseline: Outcome, vs_control: Outcome | None, control: str | None) -> str:
    """State the difference from the baseline, and how much of it bandwidth explains."""
    difference = clause(vs_baseline)
    if control == vs_baseline.method and vs_baseline.verdict.sign == "above 0":
        return f"{difference}: bandwidth, and constants of its own, make this difference"
    if vs_control is None:
        return difference
    same = f"{vs_control.against}, which has the same bandwidth,"
    if vs_control.verdict.sign == "open":
        return f"{clauses([vs_baseline, vs_control])}: {same} may do as well"
    if vs_control.verdict.sign == "above 0":
        return f"{difference}; over {same} {vs_control.method} gains {vs_control.size}{size_words(vs_control.verdict)}"
    return f"{difference}; {same} scores {vs_control.size} more{size_words(vs_control.verdict)}"


def outcome_of(records: Records, row: Comparison | None) -> Outcome | None:
    if row is None or row.difference is None:
        return None
    of_scenes = (records.comparison(scene, row.method, row.against, budget=row.budget) for scene in records.scenes)
    by_scene = tuple(each.difference for each in of_scenes if each is not None and each.difference is not None)
    return Outcome(row.method, row.against, (row.difference,), row.verdict, by_scene)


def _outcome(records: Records, method: str, fought: list[Duel]) -> tuple[str, list[str]]:
    """State the differences of `method`, and what qualifies them: those of the second contender, unless one clause says
    all, unfinished training and lost runs.
    """
    baseline, control = records.baseline, control_of(records, method)
    cells = [cell for cell in records.cells if cell.method == method]
    if cells and all(cell.status == "not_available" for cell in cells):
        return f"{method} was not available: nothing can be said of it", []
    if cells and all(map(is_lost, cells)):
        return f"{method} diverged, failed or collapsed in every run: nothing can be said of its quality", []
    two = records.contenders[:2]
    judged = [each for duel in fought if duel.method in two and (each := outcome_of(records, duel.steps))]
    losses = [words for name in (method, baseline) if (words := _lost(records, name))]
    compared = any((each.method, each.against) == (method, baseline) for each in judged)
    if losses and not compared:
        return f"{' and '.join(losses)}: {method} and {baseline} cannot be compared", []
    how, more = ["at equal steps"] * any(duel.time for duel in fought), losses
    if compared:
        like = any(duel.steps and duel.steps.scenes_like_these for duel in fought)
        if not all(map(is_on_few_scenes, judged)):
            how.append("on scenes like these" if like else "on these scenes")
        more = [rising(row.gain for row in last_doublings(records.cells, [method, baseline])), *losses]
    others = [] if none_shown(judged) else [each for each in judged if each.method != method]
    own = [each for each in judged if each not in others]
    more = [clauses(others), *more]
    return answer_of(own, method, baseline, control, ", ".join(how)), [words for words in more if words]


def rising(gains: Iterable[float | None]) -> str:
    """State the largest gain of the last doubling of the steps, if it shows that training was not finished."""
    gain = max((gain for gain in gains if gain is not None), default=0.0)
    return f"training was not finished (twice the steps brought {number(gain, 1)} dB)" if gain >= STILL_RISING else ""


def _lost(records: Records, method: str) -> str:
    cells = [cell for cell in records.cells if cell.method == method]
    lost = sum(map(is_lost, cells))
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
    survivors = f" Lost runs are not in these means: {listed(losses)}." if losses else ""
    return f"Mean test PSNR {where}: {listed(scored)}.{survivors}"


def _others(records: Records, fought: list[Duel]) -> str:
    further = records.contenders[2 : 2 + FURTHER]
    outcomes = [outcome_of(records, duel.steps) for duel in fought if duel.method in further]
    words = clauses([outcome for outcome in outcomes if outcome])
    return f"At equal steps, {words}." if words else ""


def control_of(records: Records, method: str) -> str | None:
    """Return the run's control if it differs from the baseline only in its encoding and in constants that are searched
    for each method, and if `method` has the encoding whose bandwidth it matches; older records do not say.
    """
    baseline, control = records.baseline, records.control
    own = [value_at(records.run.settings, "train", "own", str(name)) for name in (baseline, control, method)]
    if control is None or not isinstance(own[0], dict):
        return control
    first, second, tested = (each if isinstance(each, dict) else {} for each in own)
    unlike = {name for name in first | second if first.get(name) != second.get(name)}
    return control if unlike <= SEARCHED and str(tested.get("encoding")).startswith("phi") else None


def _bandwidth(records: Records, method: str) -> str:
    baseline, control = records.baseline, control_of(records, method)
    if control is None:
        encodings = [value_at(records.run.settings, "train", "own", name, "encoding") for name in (baseline, method)]
        if None in encodings or encodings[0] == encodings[1]:
            return ""
        return f"No method with the bandwidth of {method} was run, so a difference may be only an effect of bandwidth."
    why = (
        f"{control} is {baseline} with its encoding cut down to the frequencies that the φ encoding reaches, and "
        "constants of its own. Its gain comes from bandwidth and constants, not from the parts of the new method"
    )
    row = records.comparison("all", control, baseline)
    if row is None or row.difference is None:
        return f"{why}."
    known = f"{signed(row.difference)} dB {interval(row.simultaneous)}".rstrip()
    return f"{why}: here {known} ({phrase_with(row.verdict, row.simultaneous)})."


def from_steps_to_time(records: Records, method: str) -> list[str]:
    """State how each difference changes from equal steps to equal time; all pairs of the headline are one family."""
    steps, time = records.budgets
    pairs = [(duel.method, duel.against) for duel in duels(records) if duel.method == method]
    before, after = Condition(records.cells, steps), Condition(records.cells, time)
    family = sum(is_headline(row.scene, row.metric, row.budget, (steps,)) for row in records.comparisons)
    changes = [change(*pair, before, after, family=max(family, len(pairs))) for pair in pairs]
    stated = [change_in_words(known) for known in changes if known is not None]
    return [f"From equal steps to {BUDGETS[time]}: {'; '.join(stated)}."] if stated else []
