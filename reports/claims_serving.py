"""§8: retrieval from the cache, its key, and attention as priority, as measured on the run's trained methods."""

from harness.serving_record import CacheRecord, Latency, PhiCheck
from reports.evidence_view import plain
from reports.judging import judge_difference
from reports.ledger import UNTESTED, Bench, Claim, Finding, Pair, Printed, Verdict
from reports.serving_load import is_quick
from reports.serving_races import ORDERS, SHARE, Race, earlier, first, races
from reports.wording import NARROW, counted, listed, significant

COMMAND = "python -m harness serving OUT"
MEMORY, DISK = ("level 0", "level 1"), ("level 2",)
PLACES = {"level 0": "memory (level 0)", "level 1": "memory (level 1)", "level 2": "disk"}
LEAST_SCENES = 3
"""On fewer nothing is settled."""


def retrieval(bench: Bench, entry: Printed) -> Finding:
    """“Instant” has no number: our bar is the record's, and the spread of the calls is judged by it."""
    record = bench.serving.cache if bench.serving else None
    if record is None:
        return _untested(bench, "time of rendering a view against that of having it from the cache")
    how = (
        f"rendering a view of {record.width} × {record.height} px takes as many times as long as a hit; “instant” is "
        f"our bar: {plain(record.target_memory)}× in memory, {plain(record.target_disk)}× on disk"
    )
    memory, disk = (
        [one for one in record.latencies if one.source in sources and one.ratio is not None]
        for sources in (MEMORY, DISK)
    )
    if _quick(bench) or not memory + disk:
        return _untested(bench, how)
    verdict = both(record)
    shown = memory or disk
    notes = [f"from disk {_range(disk)}" if memory and disk else f"not measured {'on disk' if memory else 'in memory'}"]
    notes += [
        f"{words}: {listed(names)}"
        for failing, words in (("does not hold", "missed"), ("inconclusive", "its spread reaches across the bar"))
        if (names := [f"{PLACES[one.source]}, {one.method} on {one.scene}"
                      for one in memory + disk if judge_hit(one, record) == failing])
    ]  # fmt: skip
    pairs = [one.ratio_spread for one in shown if one.ratio_spread]
    interval = (min(low for low, _ in pairs), max(high for _, high in pairs)) if pairs else None
    return Finding(verdict, how, _ends(shown), interval, note="; ".join(notes))


def both(record: CacheRecord) -> Verdict:
    """*Does not hold* where the hits of a scene and method miss a target, *holds* where all of both kinds reach it."""
    found = [judge_hit(one, record) for one in record.latencies if one.source in MEMORY + DISK]
    sources = {one.source for one in record.latencies}
    if "does not hold" in found:
        return "does not hold"
    complete = sources & set(MEMORY) and sources & set(DISK)
    return "holds" if complete and all(one == "holds" for one in found) else "inconclusive"


def judge_hit(one: Latency, record: CacheRecord) -> Verdict:
    """By its spread, where there is one: it may lie above the target, below, or across."""
    target = record.target_disk if one.source in DISK else record.target_memory
    return judge_difference(target, 0.0, one.ratio_spread)


def pose_key(bench: Bench, entry: Printed) -> Finding:
    """The hash of the pose alone, as in Listing 5: whether it would have returned a picture of something else."""
    how = "the same poses asked for again after something else had changed; a key of the pose alone finds the old view"
    found = bench.serving.cache.confusions if bench.serving and bench.serving.cache else []
    views, stale = sum(one.views for one in found), sum(one.stale for one in found)
    if _quick(bench) or not views:
        return _untested(bench, how)
    missed = sum(one.missed for one in found)
    key = f"our key is new for {'all' if missed == views else missed} of them"
    note = f"stale of {counted(views, 'view')}; {key}"
    return Finding("does not hold" if stale else "holds", how, stale, note=note)


def attended_first(bench: Bench, entry: Printed) -> Finding:
    """Useful earlier where it matters: on every scene, on some, or on none."""
    how = (
        f"seconds until the attended error has fallen to {100 * SHARE:.0f}{NARROW}% of the coarse frame’s, against "
        "raster order"
    )
    record = bench.serving.attention if bench.serving else None
    found = [one for one in races(record) if {"attention", "raster"} <= set(one.attended)] if record else []
    if _quick(bench) or not found:
        return _untested(bench, how)
    scenes = list(dict.fromkeys(one.scene for one in found))
    won = [scene for scene in scenes if all(_ahead(one) for one in found if one.scene == scene)]
    verdict: Verdict = "inconclusive"
    if len(scenes) >= LEAST_SCENES and len(won) == len(scenes):
        verdict = "holds"
    elif len(scenes) >= LEAST_SCENES and not any(map(_ahead, found)):
        verdict = "does not hold"
    factors = [
        raster / mine for one in found if (mine := one.attended["attention"]) and (raster := one.attended["raster"])
    ]
    notes = [
        f"earlier in {sum(map(_ahead, found))} of {counted(len(found), 'case')}, in all of them on {len(won)} of "
        f"{counted(len(scenes), 'scene')}",
        _whole(found),
    ]
    ends = (min(factors), max(factors)) if factors else None
    return Finding(verdict, how, ends, note="; ".join(filter(None, notes)))


def _ahead(one: Race) -> bool:
    return earlier(one.attended, "attention", "raster")


def _whole(found: list[Race]) -> str:
    """What the rest of the picture pays."""
    known = [one for one in found if set(ORDERS) <= set(one.whole)]
    ahead = sum(first(one.whole) == "attention" for one in known)
    return f"over the whole picture first of all orders in {ahead} of {len(known)}" if known else ""


def factor_of_priorities(bench: Bench, entry: Printed) -> Finding:
    """Priorities sum to φ where shares sum to 1; in what maps that changes an order or an allocation."""
    how = "orders and allocations of attention maps, with the factor φ and without it"
    phi: PhiCheck | None = bench.serving.attention.phi if bench.serving and bench.serving.attention else None
    if _quick(bench) or phi is None or not phi.maps:
        return _untested(bench, how)
    changed = max(phi.orders_changed, phi.allocations_changed)
    note = (
        f"changed, of {counted(phi.maps, 'map')}; the priorities sum to {significant(phi.sum_of_priorities, 4)}, not "
        "to 1: they are no probabilities"
    )
    return Finding("holds" if changed else "does not hold", how, changed, note=note)


def untested(found: list[Claim]) -> list[str]:
    """What the ledger has left untested of §8, in a sentence; none where nothing was."""
    mine = [claim for claim in found if claim.kind == "serving"]
    missing = sum(claim.verdict == UNTESTED for claim in mine)
    if not missing:
        return []
    return [
        f"View cache and attention-prioritised rendering (§8): {missing} of {counted(len(mine), 'statement')}; "
        f"`{COMMAND}` measures them on a finished run."
    ]


def _untested(bench: Bench, how: str) -> Finding:
    quick = "measured too quickly to be judged" if _quick(bench) else "not measured"
    return Finding(UNTESTED, how, note=f"{quick}: `{COMMAND}` does")


def _quick(bench: Bench) -> bool:
    return bool(bench.serving and is_quick(bench.serving))


def _ends(found: list[Latency]) -> float | Pair | None:
    """One figure, or from the worst to the best."""
    ratios = [one.ratio for one in found if one.ratio is not None]
    return (min(ratios), max(ratios)) if len(ratios) > 1 else ratios[0] if ratios else None


def _range(found: list[Latency]) -> str:
    ends = _ends(found)
    return listed(list(map(_times, ends)), "to") if isinstance(ends, tuple) else _times(ends or 0.0)


def _times(factor: float) -> str:
    return f"{significant(factor)}×"
