"""Claims of §8 on the run's trained methods: retrieval from the cache, its key, and attention as priority."""

from harness.records.claims import Pair, Statement
from harness.records.study import Check
from reports.claims.ledger import Bench, Finding
from reports.data.wording import UNTESTED, Verdict, count, listed, significant

COMMAND = "python -m harness study serving OUT"
MISSED: Verdict = "not seen at this scale"


def retrieval(bench: Bench, entry: Statement) -> Finding:
    """Judge retrieval. “Instant” has no number: the spread of repeated calls is compared with the record's limit."""
    hits = _checks(bench, "hit.")
    memory, disk = ([hit for hit in hits if hit.id.startswith(f"hit.{place}.")] for place in ("memory", "disk"))
    judged, shown = memory + disk, memory or disk
    bars = [
        f"{count(round(some[0].limit or 0.0))}× {where}"
        for some, where in ((memory, "in memory"), (disk, "on disk"))
        if some
    ]
    how = (
        "time of rendering a view divided by the time of a hit, for a method whose training has ended (weights hashed "
        f"once); the threshold for “instant” is ours: {', '.join(bars)}"
    )
    if not bars:
        return _untested(bench, "time of rendering a view divided by the time of reading it from the cache")
    verdict: Verdict = "inconclusive"
    if any(hit.status == "fail" for hit in judged):
        verdict = MISSED
    elif memory and disk and all(hit.status == "pass" for hit in judged):
        verdict = "seen"
    notes = [] if memory and disk else [f"not measured {'on disk' if memory else 'in memory'}"]
    others = [hit for hit in hits if hit not in shown]
    for words in dict.fromkeys(hit.what for hit in others):
        ends = _ends([hit for hit in others if hit.what == words])
        notes.append(f"{words}: {listed([f'{significant(end)}×' for end in dict.fromkeys(ends)], 'to')}")
    for status, words in (("fail", "missed"), ("inconclusive", "its spread includes the threshold")):
        names = [f"{hit.subject} ({hit.what})" for hit in judged if hit.status == status]
        notes += [f"{words}: {listed(names)}"] if names else []
    spreads = [hit.spread for hit in shown if hit.spread]
    interval = min(low for low, _ in spreads), max(high for _, high in spreads)
    low, high = _ends(shown)
    return Finding(verdict, how, low if low == high else (low, high), interval, note="; ".join(notes))


def pose_key(bench: Bench, entry: Statement) -> Finding:
    """Judge a key that hashes only the pose, as in Listing 5: which kinds of change it misses."""
    how = (
        "kinds of change after which a key that hashes only the pose returns a wrong picture, when the same views are "
        "requested again"
    )
    stale, ours = _check(bench, "key.pose"), _check(bench, "key.ours")
    if stale is None:
        return _untested(bench, how)
    note = stale.why + (f"; our key is new for {significant(ours.value)} % of the views" if ours is not None else "")
    return Finding("not reproduced" if stale.value else "reproduced", how, round(stale.value or 0.0), note=note)


def attended_first(bench: Bench, entry: Statement) -> Finding:
    """Judge whether attended regions are useful earlier; overlapping repeats decide nothing."""
    how = (
        "seconds until the error in the most attended quarter has fallen to a tenth of the coarse frame’s, compared "
        "with raster order; earlier means earlier in all repeats"
    )
    attended, sooner = _check(bench, "earlier.attended"), _check(bench, "sooner.attended")
    if attended is None:
        return _untested(bench, how)
    notes = [f"earlier in {count(round(attended.value or 0.0))} {attended.why}"]
    if whole := _check(bench, "earlier.whole"):
        notes.append(f"over the whole picture earlier in {count(round(whole.value or 0.0))} of {whole.repeats}")
    verdicts: dict[str, Verdict] = {"pass": "seen", "fail": MISSED}
    verdict = verdicts.get(attended.status, "inconclusive")
    return Finding(verdict, how, sooner.spread if sooner else None, note="; ".join(notes))


def factor_of_priorities(bench: Bench, entry: Statement) -> Finding:
    """Judge the factor φ of the priorities: in which attention maps it changes anything."""
    how = "orders and allocations of attention maps, with the factor φ and without it"
    changed = _check(bench, "phi.changed")
    if changed is None:
        return _untested(bench, how)
    verdict: Verdict = "reproduced" if changed.value else "not reproduced"
    return Finding(verdict, how, round(changed.value or 0.0), note=f"changed, {changed.why}")


def _checks(bench: Bench, prefix: str) -> list[Check]:
    if bench.serving is None or bench.serving.is_quick:
        return []
    return [check for _, check in bench.serving.checks() if check.id.startswith(prefix) and check.value is not None]


def _check(bench: Bench, id: str) -> Check | None:
    return next((check for check in _checks(bench, id) if check.id == id), None)


def _untested(bench: Bench, how: str) -> Finding:
    quick = bench.serving is not None and bench.serving.is_quick
    return Finding(UNTESTED, how, note=f"need `{COMMAND}`{' without --quick' if quick else ''}")


def _ends(checks: list[Check]) -> Pair:
    values = [check.value or 0.0 for check in checks]
    return min(values), max(values)
