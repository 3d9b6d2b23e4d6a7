"""The difference between two methods as a clause, its change between two situations, and doubts about its mean."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from harness.records.cells import Comparison
from harness.records.metric_table import METRICS, PRIMARY, metric_of
from harness.records.verdict import OPEN, Verdict, common
from harness.verdicts.changes import Change
from reports.data.wording import interval, listed, number, signed

FEW_SCENES = 3
MARGIN = f"{METRICS[PRIMARY].smallest_of_interest:g} dB"
NUMBERS = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight", 9: "nine"}


@dataclass(frozen=True)
class Outcome:
    """The difference in PSNR `method` − `against` over all scenes, in one run or in several of one plan."""

    method: str
    against: str
    differences: tuple[float, ...]
    """One per run, dB."""
    verdict: Verdict
    """What all runs share."""
    by_scene: tuple[float, ...] = ()
    """The mean difference on each scene, dB."""

    @property
    def size(self) -> str:
        """Format `0.14 dB`, or `0.12 to 0.14 dB (three runs)`, without sign."""
        ends = sorted({number(abs(value)) for value in self.differences}, key=float)
        more = f" ({counted_runs(len(self.differences))})" if len(self.differences) > 1 else ""
        return f"{' to '.join(dict.fromkeys([ends[0], ends[-1]]))} dB{more}"


def counted_runs(many: int) -> str:
    return f"{NUMBERS.get(many, str(many))} run{'' if many == 1 else 's'}"


def between_runs(differences: Sequence[float]) -> str:
    """Format `+0.12 to +0.14 dB`, or `+0.12 dB` if all round to the same."""
    return f"{' to '.join(dict.fromkeys(signed(value) for value in (min(differences), max(differences))))} dB"


def in_runs(differences: Sequence[float]) -> str:
    """Format `+0.14 dB`, or `+0.12 to +0.14 dB in three runs`."""
    many = len(differences)
    return between_runs(differences) + (f" in {counted_runs(many)}" if many > 1 else "")


def shared(differences: Sequence[float], verdicts: Sequence[Verdict]) -> str:
    """State what runs of one plan share: `+0.12 to +0.14 dB in three runs: above 0, size open`."""
    return f"{in_runs(differences)}: {common(verdicts).phrase}"


def clause(outcome: Outcome) -> str:
    """Return `qnerf gains 0.14 dB over nerf, less than the 0.2 dB that matter`."""
    if is_on_few_scenes(outcome):
        return f"{_measured(outcome)}; {_too_few(outcome)}"
    if outcome.verdict.sign == "open":
        return _open(outcome)
    verb = "gains {} over" if outcome.verdict.sign == "above 0" else "loses {} to"
    return f"{outcome.method} {verb.format(outcome.size)} {outcome.against}{size_words(outcome.verdict)}"


def clauses(outcomes: Sequence[Outcome]) -> str:
    """Return the clauses of several differences; that the scenes are few comes once, after what was measured."""
    if words := none_shown(outcomes):
        return words
    few = [outcome for outcome in outcomes if is_on_few_scenes(outcome)]
    known = [clause(outcome) for outcome in outcomes if outcome not in few]
    return "; ".join([*known, *map(_measured, few), *dict.fromkeys(map(_too_few, few))])


def none_shown(outcomes: Sequence[Outcome]) -> str:
    """Return `neither qnerf nor other is shown to differ from nerf or …` if nothing is known of any of these pairs."""
    if len(outcomes) < 2 or any(outcome.verdict != OPEN or is_on_few_scenes(outcome) for outcome in outcomes):
        return ""
    methods = list(dict.fromkeys(outcome.method for outcome in outcomes))
    rivals = list(dict.fromkeys(outcome.against for outcome in outcomes))
    if len(outcomes) < len(methods) * len(rivals):
        return ""
    who = f"neither {listed(methods, 'nor')} is" if len(methods) > 1 else f"{methods[0]} is not"
    sizes = between_runs([difference for outcome in outcomes for difference in outcome.differences])
    differ = f"{who} shown to differ from {listed(rivals, 'or')} ({sizes})"
    return f"{differ}, and differences of {MARGIN} or more are not excluded"


def size_words(verdict: Verdict) -> str:
    return {
        "matters": f", more than the {MARGIN} that matter",
        "smaller than matters": f", less than the {MARGIN} that matter",
        "open": " (size open)",
    }[verdict.size]


def _open(outcome: Outcome) -> str:
    start = f"the sign of {outcome.method} − {outcome.against} is open ({in_runs(outcome.differences)})"
    if outcome.verdict.size == "smaller than matters":
        return f"{start}, its size below the {MARGIN} that matter"
    return f"{start}, and so is whether it reaches the {MARGIN} that matter"


def is_on_few_scenes(outcome: Outcome) -> bool:
    """Return whether the sign is open in a run of so few scenes that it had to be."""
    single = len(outcome.differences) == 1
    return outcome.verdict.sign == "open" and single and 1 < len(outcome.by_scene) <= FEW_SCENES


def _measured(outcome: Outcome) -> str:
    """Return `planes is 3.10 dB above nerf on both scenes`."""
    many = len(outcome.by_scene)
    (difference,) = outcome.differences
    if all(value * difference > 0 for value in outcome.by_scene):
        way = "above" if difference > 0 else "below"
        where = "both scenes" if many == 2 else f"all {NUMBERS[many]} scenes"
        return f"{outcome.method} is {number(abs(difference))} dB {way} {outcome.against} on {where}"
    each = listed([signed(value) for value in outcome.by_scene])
    return f"{outcome.method} − {outcome.against} is {each} dB on the {NUMBERS[many]} scenes"


def _too_few(outcome: Outcome) -> str:
    return f"{NUMBERS[len(outcome.by_scene)]} scenes are too few to predict others"


def change_in_words(change: Change) -> str:
    """Format `qnerf − nerf changes by −0.35 dB [−0.61, −0.09], on 8 of 8 scenes in that direction: below 0, size open`.

    The interval is that of the verdict: on scenes like these if several were tried.
    """
    size, chosen = change.judgement.difference or 0.0, change.judgement.chosen
    many = len(change.by_scene)
    same = sum(moved * size > 0 for moved in change.by_scene.values())
    where = f", on {same} of {many} scenes in that direction" if many > 1 else ""
    figures = f"{signed(size)} dB {interval(chosen.simultaneous)}".rstrip()
    return f"{change.method} − {change.against} changes by {figures}{where}: {chosen.verdict.phrase}"


def robust_differs(row: Comparison) -> bool:
    """Return whether the mean lies outside the robust interval, or without one off its estimate by what matters."""
    if row.robust is None or row.difference is None:
        return False
    if row.robust.interval is None:
        return abs(row.robust.difference - row.difference) > metric_of(row.metric).smallest_of_interest
    return not row.robust.interval[0] <= row.difference <= row.robust.interval[1]


def robust_in_words(row: Comparison) -> str:
    """Format `robust: +0.12 [−0.07, +0.31]` where that disagrees with the mean; else nothing."""
    if row.robust is None or not robust_differs(row):
        return ""
    digits = metric_of(row.metric).digits_of_difference
    return f"robust: {signed(row.robust.difference, digits)} {interval(row.robust.interval, digits)}".rstrip()


def doubts(row: Comparison | None) -> Iterator[str]:
    """Yield a sentence if the robust estimate disagrees with the mean, and one if some cells are outliers."""
    if row is None:
        return
    about = metric_of(row.metric)
    pair, budget = f"{row.method} − {row.against}", row.budget.replace("_", " ")
    if words := robust_in_words(row):
        unit = f" {about.unit}" if about.unit else ""
        mean = f"{signed(row.difference, about.digits_of_difference)}{unit}"
        yield f"The mean of {pair} at equal {budget}, {mean}, is not that of most cells: {words}."
    if row.flagged:
        cells = [
            f"{cell.scene}, seed {cell.seed} ({signed(cell.difference, about.digits_of_difference)})"
            for cell in row.flagged
        ]
        usual = signed(row.flagged[0].usual, about.digits_of_difference)
        yield f"Off all others of {pair} at equal {budget}, whose median is {usual}: {'; '.join(cells)}."
