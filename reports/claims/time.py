"""Table 3: how soon a score is reached.

The harness judges that as a survival problem (`harness.records.targets`): a run that never reaches the target is
censored, not dropped. A saving is judged like a gain: *reproduced* only at the paper's scale and its 30 dB, elsewhere
*seen* or not. If censoring may hide a larger or smaller saving, that side of its interval is open.
"""

import math

from harness.records.claims import Pair, Statement
from harness.records.targets import TargetComparison, TargetsRecord
from reports.claims.ledger import LEAST_PAIRS, Bench, Finding, judge_gain
from reports.claims.scores import NEEDS_RUN
from reports.data.selection import behind_saving
from reports.data.wording import UNTESTED, count, counted, number

WHAT = {"steps": "training steps", "seconds": "training seconds"}
MARGIN = 5.0
NEEDS_TARGETS = "need a record of when a score was reached: run again with --resume"
NEEDS_MACHINE = "need the paper’s machine"
NEEDS_SCENES = "need to know of which scenes they are: in Table 2 NeRF never reaches 30 dB on three of eight"


def saving(bench: Bench, entry: Statement) -> Finding:
    method, against, axis = (entry.of[name] for name in ("method", "against", "axis"))
    targets = bench.targets
    how = f"{WHAT[axis]} until mean test PSNR reaches the target, paired by scene and seed; censored if it never does"
    if targets is None:
        return Finding(UNTESTED, how, note=NEEDS_TARGETS)
    row = targets.comparison("all", method, against, axis) if targets.target is not None else None
    started = {cell.method for cell in bench.records.cells if cell.status != "not_available"}
    if row is None or not {method, against} <= started or entry.printed is None:
        return Finding(UNTESTED, how, note=NEEDS_RUN.format(methods=f"{method} and {against}"))
    at_scale = bench.file.scale is None or (targets.target == bench.file.target and bench.at_scale("all"))
    verdict = judge_gain(entry.printed, MARGIN, reachable(row), at_scale, entry.bound)
    note = _note(row, targets, bench.file.names)
    return Finding(verdict, how, row.saving, _on_them(row), note=note, runs=behind_saving(row))


def reachable(row: TargetComparison) -> Pair | None:
    """Return the interval, open on each side to which censored times may move the saving; None for too few pairs."""
    pair = _on_them(row)
    if pair is None or row.pairs < LEAST_PAIRS:
        return None
    larger, smaller = _sides(row)
    return (-math.inf if smaller else pair[0], math.inf if larger else pair[1])


def _on_them(row: TargetComparison) -> Pair | None:
    about = row.on_these_scenes
    return (about.simultaneous or about.interval) if about else None


def _sides(row: TargetComparison) -> tuple[bool, bool]:
    """Return whether the true saving may be larger, and whether it may be smaller."""
    # larger: a run of the rival never reached the target, or one of the method had it by the first checkpoint
    return bool(row.never[1] or row.earlier[0]), bool(row.never[0] or row.earlier[1])


def _note(row: TargetComparison, targets: TargetsRecord, names: dict[str, str]) -> str:
    parts, (method, against) = [], (names.get(name, name) for name in (row.method, row.against))
    if row.pairs:
        ours, theirs = (count(row.pairs - never) for never in row.never)
        parts.append(
            f"{number(targets.target, 1)} dB was reached by {theirs} of {counted(row.pairs, f'{against} run')} and "
            f"{ours} of {counted(row.pairs, f'{method} run')} in the {WHAT[row.axis]} watched"
        )
    for name, earlier in zip((method, against), row.earlier, strict=True):
        if earlier:
            parts.append(f"{earlier} of {counted(row.pairs, 'run')} of {name} had reached it by the first checkpoint")
    if row.saving is not None:
        parts.append(bound(row))
    if row.unpaired:
        parts.append(f"{counted(row.unpaired, 'pair')} could not be judged")
    return "; ".join(filter(None, parts))


def bound(row: TargetComparison) -> str:
    larger, smaller = _sides(row)
    if larger and smaller:
        return "the saving covers only the time watched"
    return "the true saving is larger" if larger else "the true saving is smaller" if smaller else ""


def time_to_target(bench: Bench, entry: Statement) -> Finding:
    """Leave printed steps or hours untested: no run here is comparable with them."""
    return Finding(UNTESTED, "no run is asked for it", note=NEEDS_MACHINE if entry.unit == "h" else NEEDS_SCENES)
