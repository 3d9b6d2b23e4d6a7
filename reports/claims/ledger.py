"""The verdicts on claims: pure functions of figures and intervals.

At the claim's scale a gain is *reproduced* if the interval of the measurement lies above 0 and within `margin` of the
printed number, and *not reproduced* if it lies outside. At another scale it can only be *seen*, if the interval lies
above 0 and meets that region, or *not seen at this scale*, if it does not meet it. A claim without a scale is about any
run. A bound has no margin. All else is *inconclusive*. A printed sum is judged by the figures that it is made of.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist

from harness.records.claims import Bound, ClaimFile, Number, Pair, Statement
from harness.records.metric_table import METRICS
from harness.records.study import Studies
from harness.records.targets import TargetsRecord
from harness.verdicts.statistics import POWER, critical
from reports.data.load import Records
from reports.data.scale import is_at_scale
from reports.data.selection import Selection
from reports.data.wording import UNTESTED, Verdict, counted

OWN_FIGURES = "only the printed figures"


@dataclass(frozen=True)
class Bench:
    records: Records
    file: ClaimFile
    evidence: Studies | None
    targets: TargetsRecord | None
    serving: Studies | None = None

    def at_scale(self, scene: str) -> bool:
        return is_at_scale(self.records, self.file, scene)


@dataclass(frozen=True)
class Finding:
    verdict: Verdict
    how: str
    measured: Number | Pair | None = None
    """The measurement, a range as a pair: from the worst to the best scene."""
    interval: Pair | None = None
    """The interval that the verdict is taken from, or else the 95 % interval."""
    scale: str = ""
    """The scale if it is not that of the run."""
    note: str = ""
    """The qualification of the verdict; for an untested statement, what it needs."""
    runs: Selection | None = None
    """The runs of this report that `measured` is taken from; None if it is not a score of trained runs."""


@dataclass(frozen=True, kw_only=True)
class Claim(Finding):
    id: str
    file: str
    source: str
    statement: str
    printed: Number | Pair | None
    kind: str
    """The kind of statement: a key of `reports.claims.claim_list.KINDS`."""
    unit: str
    digits: int
    bound: Bound = ""


def claim_of(file: ClaimFile, entry: Statement, finding: Finding, kind: str, here: str) -> Claim:
    """Return the claim; `here` is the scale of the run."""
    shown = {"scale": finding.scale or here, "runs": finding.runs if finding.verdict != UNTESTED else None}
    return Claim(
        id=entry.id,
        file=file.id,
        source=", ".join(entry.where),
        statement=entry.statement,
        printed=entry.printed,
        kind=kind,
        unit=entry.unit,
        digits=entry.digits,
        bound=entry.bound,
        **{**vars(finding), **shown},
    )


MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
LEAST_PAIRS = 3
"""The minimum number of pairs for a verdict: two seeds give none."""
MOST_SEEDS = 1000


def half_unit(printed: Number, unit: str = "") -> float:
    """Return half of the last printed digit, the maximum error by rounding: 1.4 → 0.05, 257 → 0.5, 67 000 → 500."""
    if unit in ("dB", "h"):  # printed with one decimal, even if it is 0
        return 0.05
    if unit == "%" and float(printed).is_integer():  # 20 % is not 2 · 10 %
        return 0.5
    if isinstance(printed, int) or float(printed).is_integer():
        digits = str(abs(int(printed)))
        zeros = len(digits) - len(digits.rstrip("0")) if digits != "0" else 0
        return float(0.5 * 10**zeros)
    decimals = len(repr(float(printed)).split(".")[1])
    return float(0.5 * 10**-decimals)


def judge_gain(
    printed: Number | Pair,
    margin: float,
    measured: Pair | None,
    at_scale: bool,
    bound: Bound = "",
) -> Verdict:
    """Compare a printed difference with the measured interval; without an interval nothing is settled.

    The margin applies to numbers, not to bounds. What is claimed to lie on one side of 0 has to be shown on that side.
    """
    if measured is None:
        return "inconclusive"
    least, most = ends(printed)
    rises, falls = least > 0 and bound != "at most", most < 0 and bound != "at least"
    low = max(0.0, least - margin) if rises else least - margin
    high = min(0.0, most + margin) if falls else most + margin
    level = judge_bound(least, bound, measured) if bound else _within(low, high, measured)
    if level == "not reproduced":
        return level if at_scale else "not seen at this scale"
    if (rises and measured[0] <= 0) or (falls and measured[1] >= 0):
        return "inconclusive"
    if at_scale:
        return level
    return "seen" if rises or falls or level == "reproduced" else "inconclusive"


def judge_bound(printed: float, bound: Bound, measured: Pair) -> Verdict:
    """Compare a bound with an interval: on the claimed side of it, on the other, or neither."""
    return _within(*((printed, math.inf) if bound == "at least" else (-math.inf, printed)), measured)


def judge_level(printed: Number | Pair, margin: float, measured: Pair | None, bound: Bound = "") -> Verdict:
    """Compare a printed level with an interval at its own scale: within `margin` of it, outside, or neither."""
    if measured is None:
        return "inconclusive"
    least, most = ends(printed)
    return judge_bound(least, bound, measured) if bound else _within(least - margin, most + margin, measured)


def ends(printed: Number | Pair) -> Pair:
    return printed if isinstance(printed, tuple) else (printed, printed)


def _within(least: float, most: float, measured: Pair) -> Verdict:
    low, high = measured
    if high < least or low > most:
        return "not reproduced"
    return "reproduced" if least <= low and high <= most else "inconclusive"


def judge_all(parts: Iterable[Verdict]) -> Verdict:
    """Judge a statement about each of several things: refuted by one, reproduced by all."""
    verdicts = set(parts)
    if "not reproduced" in verdicts:
        return "not reproduced"
    return "reproduced" if verdicts == {"reproduced"} else "inconclusive"


def seeds_that_settle(deviation: float, scenes: int, margin: float, family: int = 1) -> int | None:
    """Return how many seeds per scene would show a true gain equal to the printed one, in 80 % of repetitions.

    `deviation` is the standard deviation of a paired difference about its scene's mean. The interval on `scenes` fixed
    scenes, one of `family`, must fit into ± `margin`. None if even `MOST_SEEDS` are too few.
    """
    off_centre = NormalDist().inv_cdf((1 + POWER) / 2)
    for seeds in range(LEAST_PAIRS, MOST_SEEDS):
        reach = critical(scenes * (seeds - 1), family) + off_centre
        if reach * deviation / math.sqrt(scenes * seeds) <= margin:
            return seeds
    return None


def judge_figures(printed: float, rounding: float, computed: float, reachable: Pair) -> Verdict:
    """Compare a printed result with what the printed figures give: `computed` is the result of the figures as printed,
    `reachable` the range of results of all figures that round to them.

    *reproduced* if `computed` rounds to the printed result, *not reproduced* if nothing reachable does, and
    *inconclusive* if only the rounding of the figures could explain it.
    """
    slack = 1e-9 * max(1.0, abs(printed))  # decimals are not binary fractions
    if abs(computed - printed) <= rounding + slack:
        return "reproduced"
    missed = reachable[1] < printed - rounding - slack or reachable[0] > printed + rounding + slack
    return "not reproduced" if missed else "inconclusive"


def by_cause(claims: list[Claim]) -> list[tuple[str, list[Claim]]]:
    """Gather untested claims by what they need, the largest group first: `4 claims need …`."""
    missing: dict[str, list[Claim]] = {}
    for claim in claims:
        if claim.verdict == UNTESTED:
            missing.setdefault(claim.note, []).append(claim)
    gathered = []
    for cause, some in sorted(missing.items(), key=lambda item: -len(item[1])):
        if len(some) == 1:  # a cause begins with its verb in the plural
            cause = cause.replace("need ", "needs ", 1).replace("are settings", "is a setting", 1)
        gathered.append((f"{counted(len(some), 'claim')} {cause}.", some))
    return gathered


def not_tested(of_run: list[str], claims: list[Claim]) -> list[str]:
    return [*of_run, *(sentence for sentence, _ in by_cause(claims))]


def in_short(sentences: list[str]) -> str:
    """Return the number of sentences and the first, which is the most important; nothing if all was tested."""
    if not sentences:
        return ""
    first = sentences[0].split(": ")[0].rstrip(".")
    first = f"the {first.removeprefix('The ')}" if first.startswith("The ") else first
    return f"{counted(len(sentences), 'thing')}{', among them ' if len(sentences) > 1 else ': '}{first}"
