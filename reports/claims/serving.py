"""§8: retrieval from the cache, its key, and attention as priority, as measured on the run's trained methods."""

from harness.records.study import Check
from reports.claims.ledger import Bench, Finding, Pair, Printed
from reports.data.wording import UNTESTED, Verdict, count, listed, significant

COMMAND = "python -m harness study serving OUT"
MISSED: Verdict = "not seen at this scale"


def retrieval(bench: Bench, entry: Printed) -> Finding:
    """Judge retrieval. “Instant” has no number: our threshold is the record's, and the spread of repeated calls is
    compared with it.
    """
    hits = _checks(bench, "hit.")
    memory, disk = ([one for one in hits if one.id.startswith(f"hit.{place}.")] for place in ("memory", "disk"))
    bars = [
        f"{count(round(some[0].limit or 0.0))}× {where}"
        for some, where in ((memory, "in memory"), (disk, "on disk"))
        if some
    ]
    how = (
        "rendering a view takes as many times as long as a hit, of a method that is no longer trained (weights hashed "
        f"once); “instant” is our bar: {', '.join(bars)}"
    )
    if not bars:
        return _untested(bench, "time of rendering a view against that of having it from the cache")
    verdict: Verdict = "inconclusive"
    if any(one.status == "fail" for one in memory + disk):
        verdict = MISSED
    elif memory and disk and all(one.status == "pass" for one in memory + disk):
        verdict = "seen"
    shown = memory or disk
    notes = [] if memory and disk else [f"not measured {'on disk' if memory else 'in memory'}"]
    others = [one for one in hits if one not in shown]
    for words in dict.fromkeys(one.what for one in others):
        ends = _ends([one for one in others if one.what == words])
        notes.append(f"{words}: {listed([f'{significant(end)}×' for end in dict.fromkeys(ends)], 'to')}")
    for status, words in (("fail", "missed"), ("inconclusive", "its spread reaches across the bar")):
        names = [f"{one.subject} ({one.what})" for one in memory + disk if one.status == status]
        notes += [f"{words}: {listed(names)}"] if names else []
    spreads = [one.spread for one in shown if one.spread]
    interval = min(low for low, _ in spreads), max(high for _, high in spreads)
    low, high = _ends(shown)
    return Finding(verdict, how, low if low == high else (low, high), interval, note="; ".join(notes))


def pose_key(bench: Bench, entry: Printed) -> Finding:
    """Judge the hash of the pose alone, as in Listing 5: what else may change without its noticing."""
    how = (
        "kinds of change after which a key of the pose alone returns another picture than is asked for, where the same "
        "views are asked for again"
    )
    stale, ours = _check(bench, "key.pose"), _check(bench, "key.ours")
    if stale is None:
        return _untested(bench, how)
    verdict: Verdict = "not reproduced" if stale.value else "reproduced"
    note = stale.why + (f"; our key is new for {significant(ours.value)} % of the views" if ours is not None else "")
    return Finding(verdict, how, round(stale.value or 0.0), note=note)


def attended_first(bench: Bench, entry: Printed) -> Finding:
    """Judge whether attended regions are useful earlier: on every scene, on some, or on none. Overlapping repeats
    decide nothing.
    """
    how = (
        "seconds until the error in the most attended quarter has fallen to a tenth of the coarse frame’s, against "
        "raster order; earlier is what is so in all repeats"
    )
    found = _check(bench, "earlier.attended")
    if found is None:
        return _untested(bench, how)
    verdicts: dict[str, Verdict] = {"pass": "seen", "fail": MISSED}
    sooner = _check(bench, "sooner.attended")
    elsewhere = [
        f"{words} earlier in {count(round(one.value or 0.0))} of {one.repeats}"
        for id, words in (("hardest", "where the coarse frame is most wrong"), ("whole", "over the whole picture"))
        if (one := _check(bench, f"earlier.{id}"))
    ]
    note = "; ".join([f"earlier in {count(round(found.value or 0.0))} {found.why}", *elsewhere])
    verdict = verdicts.get(found.status, "inconclusive")
    return Finding(verdict, how, sooner.spread if sooner else None, note=note)


def factor_of_priorities(bench: Bench, entry: Printed) -> Finding:
    """Judge the factor φ: priorities sum to φ where shares sum to 1; in what maps that changes an order or an
    allocation.
    """
    how = "orders and allocations of attention maps, with the factor φ and without it"
    changed = _check(bench, "phi.changed")
    if changed is None:
        return _untested(bench, how)
    verdict: Verdict = "reproduced" if changed.value else "not reproduced"
    return Finding(verdict, how, round(changed.value or 0.0), note=f"changed, {changed.why}")


def _checks(bench: Bench, prefix: str) -> list[Check]:
    """Return the figures whose id begins so, if they were measured and mean anything."""
    if bench.serving is None or bench.serving.is_quick:
        return []
    return [one for _, one in bench.serving.checks() if one.id.startswith(prefix) and one.value is not None]


def _check(bench: Bench, id: str) -> Check | None:
    return next((one for one in _checks(bench, id) if one.id == id), None)


def _untested(bench: Bench, how: str) -> Finding:
    quick = bench.serving is not None and bench.serving.is_quick
    return Finding(UNTESTED, how, note=f"need `{COMMAND}`{' without --quick' if quick else ''}")


def _ends(checks: list[Check]) -> Pair:
    """Return the range from the worst to the best."""
    values = [one.value or 0.0 for one in checks]
    return min(values), max(values)
