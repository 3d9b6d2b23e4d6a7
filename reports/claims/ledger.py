"""The printed numbers as a run record keeps them, and their verdicts: pure functions of figures and intervals.

`RunRecord.paper` holds the paper's tables and, under `ledger`, every printed number of it. A gain is a level. At the
paper's scale it is *reproduced* where the interval of what was measured lies above 0 and within `margin` of what is
printed, and *not reproduced* where it lies outside. At another scale it can only be *seen*, where the interval lies
above 0 and reaches to within `margin` of what is printed, or *not seen at this scale*, where it does not reach there.
All else is *inconclusive*. A printed sum is judged by the figures that it is made of.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

from harness.records.json_record import REMEDY, DamagedRecord, as_promised
from harness.records.metric_table import METRICS
from harness.records.study import Studies
from harness.records.targets import TargetsRecord
from harness.verdicts.paper import Number, Pair, Printed
from harness.verdicts.statistics import POWER, critical
from reports.data.load import Records
from reports.data.scale import is_paper_scale
from reports.data.selection import Selection
from reports.data.wording import UNTESTED, Verdict, counted

OWN_FIGURES = "the paper’s own figures"


@dataclass(frozen=True)
class Bench:
    """The material that claims are judged by."""

    records: Records
    evidence: Studies | None
    targets: TargetsRecord | None
    serving: Studies | None = None

    @property
    def paper(self) -> dict[str, Any]:
        return self.records.run.paper

    def at_paper_scale(self, scene: str) -> bool:
        """Return whether a measurement on a scene, or over `all`, is comparable with the paper's own numbers."""
        return is_paper_scale(self.records, scene)

    def row(self, table: str, name: str) -> dict[str, Any]:
        """Return a row of one of the paper's tables; empty if the record has none."""
        return (self.paper.get(table) or {}).get(name) or {}

    def scenes_of_table2(self) -> dict[str, dict[str, float]]:
        """Map scene → row, without the average."""
        table = self.paper.get("table2") or {}
        return {scene: row for scene, row in table.items() if scene not in ("average", "all")}


@dataclass(frozen=True)
class Finding:
    """A judge's finding on a printed number."""

    verdict: Verdict
    how: str
    """The way it is measured here."""
    measured: Number | Pair | None = None
    """The measurement, a range as a pair: from the worst to the best scene."""
    interval: Pair | None = None
    """The 95 % interval, and the one that the verdict is taken from if there is one."""
    scale: str = ""
    """The scale if it is not that of the run."""
    note: str = ""
    """The qualification of the verdict; for an untested statement, what it needs."""
    runs: Selection | None = None
    """The runs of this report that `measured` is taken from; None if it has another subject, or there is none."""


@dataclass(frozen=True, kw_only=True)
class Claim(Finding):
    """A printed number with its finding."""

    id: str
    source: str
    """The places of the paper that state it."""
    statement: str
    printed: Number | Pair | None
    kind: str
    """The kind of statement: a key of `reports.claims.claim_list.KINDS`."""
    unit: str
    digits: int
    """The decimals of the printed number."""


def claim_of(entry: Printed, finding: Finding, kind: str, here: str) -> Claim:
    """Return the claim; `here` is the scale of the run."""
    shown = {"scale": finding.scale or here, "runs": finding.runs if finding.verdict != UNTESTED else None}
    return Claim(
        id=entry.id,
        source=", ".join(entry.where),
        statement=entry.statement,
        printed=entry.printed,
        kind=kind,
        unit=entry.unit,
        digits=entry.digits,
        **{**vars(finding), **shown},
    )


def entries(paper: dict[str, Any]) -> list[Printed]:
    """Return a record's ledger, in the paper's order; raises `DamagedRecord` unless it is as the harness writes it."""
    try:
        return as_promised(paper.get("ledger") or [], list[Printed])
    except ValueError as error:
        raise DamagedRecord(f"run.json: the paper's ledger is not readable ({error}); {REMEDY}") from error


MARGINS = {name: metric.smallest_of_interest for name, metric in METRICS.items()}
"""The margins within which a level must lie."""
LEAST_PAIRS = 3
"""The least pairs for a verdict: two seeds give none."""
MOST_SEEDS = 1000


def half_unit(printed: Number, unit: str = "") -> float:
    """Return half of the last printed digit, the most that rounding removed. 1.4 → 0.05, 257 → 0.5, 67 000 → 500.

    dB and hours are printed with one decimal, also if it is 0.
    """
    if unit in ("dB", "h"):
        return 0.05
    if isinstance(printed, int) or float(printed).is_integer():
        digits = str(abs(int(printed)))
        zeros = len(digits) - len(digits.rstrip("0")) if digits != "0" else 0
        return 0.5 * 10**zeros
    decimals = len(repr(float(printed)).split(".")[1])
    return 0.5 * 10**-decimals


def judge_gain(printed: float, margin: float, measured: Pair | None, at_paper_scale: bool) -> Verdict:
    """Compare a printed gain with the interval of the measured one; without an interval nothing is settled."""
    if measured is None:
        return "inconclusive"
    level = _within(max(0.0, printed - margin), printed + margin, measured)
    if level == "not reproduced":
        return level if at_paper_scale else "not seen at this scale"
    if measured[0] <= 0:
        return "inconclusive"
    return level if at_paper_scale else "seen"


def judge_level(printed: float, margin: float, measured: Pair | None) -> Verdict:
    """Compare a printed level, at the paper's scale alone: within `margin` of it, outside, or neither."""
    return "inconclusive" if measured is None else _within(printed - margin, printed + margin, measured)


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
    """Return how many seeds per scene would show a true gain that is just the printed one, in 80 % of repetitions.

    `deviation` is that of a paired difference about its scene's mean. The interval on `scenes` fixed scenes, one of
    `family`, must then fit into ± `margin`. None if a thousand would not do.
    """
    off_centre = NormalDist().inv_cdf((1 + POWER) / 2)
    for seeds in range(LEAST_PAIRS, MOST_SEEDS):
        reach = critical(scenes * (seeds - 1), family) + off_centre
        if reach * deviation / math.sqrt(scenes * seeds) <= margin:
            return seeds
    return None


def judge_figures(printed: float, rounding: float, computed: float, reachable: Pair) -> Verdict:
    """Compare a printed result with the one that the printed figures give: `computed` from them as they stand,
    `reachable` from all that rounds to them.

    *reproduced* if `computed` rounds to the printed result, *not reproduced* if nothing reachable does, and
    *inconclusive* if only the rounding of the figures could explain it.
    """
    slack = 1e-9 * max(1.0, abs(printed))  # decimals are no binary fractions
    if abs(computed - printed) <= rounding + slack:
        return "reproduced"
    missed = reachable[1] < printed - rounding - slack or reachable[0] > printed + rounding + slack
    return "not reproduced" if missed else "inconclusive"


def by_cause(claims: list[Claim]) -> list[tuple[str, list[Claim]]]:
    """Gather untested claims by what they need: `4 claims need …`, most first."""
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
    """Return the sentences of the run, then the needs of the untested claims."""
    return [*of_run, *(sentence for sentence, _ in by_cause(claims))]


def in_short(sentences: list[str]) -> str:
    """Return the number of things, and the first of them, which weighs most; nothing if all was tested."""
    if not sentences:
        return ""
    first = sentences[0].split(": ")[0].rstrip(".")
    first = f"the {first.removeprefix('The ')}" if first.startswith("The ") else first
    return f"{counted(len(sentences), 'thing')}{', among them ' if len(sentences) > 1 else ': '}{first}"
