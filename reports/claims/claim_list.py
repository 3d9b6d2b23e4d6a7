"""The claims ledger: every claimed number with this run's measurement and a verdict. None passes silently.

Statements about the same comparison share an entry; our interpretations of the paper are a separate kind.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

from harness.records.claims import QUANTITIES, Statement
from reports.claims import arithmetic, scores, serving
from reports.claims import time as times
from reports.claims.ledger import Bench, Claim, Finding, claim_of
from reports.data.load import Records
from reports.data.scale import in_a_line
from reports.data.studies_load import NO_SHELVES, ShelfRecords
from reports.data.wording import UNTESTED, VERDICTS, Verdict, number, signed

KINDS = {
    "gains": "Gains, speed, ablation",
    "levels": "Absolute scores and times",
    "figures": "Weights and its own arithmetic",
    "serving": "View cache and attention",
    "others": "Settings and code",
    "readings": "Our readings of the paper, which it does not print",
}

Judge = Callable[[Bench, Statement], Finding]

RULES: dict[str, tuple[str, Judge]] = {
    "gain": ("gains", scores.gain),
    "each gain": ("gains", scores.each_row),
    "each level": ("levels", scores.each_row),
    "saving": ("gains", times.saving),
    "derived saving": ("readings", times.saving),
    "added part": ("gains", scores.added_part),
    "score": ("levels", scores.score),
    "time to target": ("levels", times.time_to_target),
    "weights": ("figures", arithmetic.weights),
    **{rule: ("figures", arithmetic.own_figures) for rule in arithmetic.FIGURES},
    "source of the baseline": ("readings", arithmetic.own_figures),
    "retrieval": ("serving", serving.retrieval),
    "pose key": ("readings", serving.pose_key),
    "attended first": ("serving", serving.attended_first),
    "factor of priorities": ("readings", serving.factor_of_priorities),
    "setting": ("others", arithmetic.run_setting),
    "lines": ("others", arithmetic.lines),
    "their code": ("others", arithmetic.their_code),
}


def claims(records: Records, shelves: ShelfRecords = NO_SHELVES) -> list[Claim]:
    here = in_a_line(records)
    benches = [
        Bench(records, file, shelves.evidence, records.targets, shelves.serving) for file in records.run.claims or []
    ]
    return [_claim(bench, entry, here) for bench in benches for entry in bench.file.claims]


def _claim(bench: Bench, entry: Statement, here: str) -> Claim:
    if entry.quantity not in RULES or not set(QUANTITIES[entry.quantity]) <= entry.of.keys():
        note = f"need a version of the report that tests {entry.quantity!r}"
        return claim_of(bench.file, entry, Finding(UNTESTED, "", note=note), "others", here)
    kind, judge = RULES[entry.quantity]
    finding = judge(bench, entry)
    if entry.leaves_open and finding.verdict != UNTESTED:
        low, high = (number(end, 1) if entry.unit == "%" else signed(end, entry.digits) for end in entry.leaves_open)
        derived = f"what is printed are rounded totals: this step is between {low} and {high} {entry.unit}".strip()
        finding = replace(finding, note="; ".join(filter(None, [finding.note, derived])))
    return claim_of(bench.file, entry, finding, kind, here)


def tally(judged: list[Claim]) -> list[tuple[Verdict, int]]:
    many = Counter(claim.verdict for claim in judged)
    return [(verdict, many[verdict]) for verdict in VERDICTS if many[verdict]]
