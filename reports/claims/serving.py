"""§8: retrieval from the cache, its key, and attention as priority, as measured on the run's trained methods."""

from harness.records.serving_record import Confusion, Latency, Measure, PhiCheck
from reports.claims.ledger import Bench, Finding, Pair, Printed
from reports.data.serving_load import DISK, HASHED, MEMORY, MISSED, both, is_quick, judge_hit
from reports.data.wording import NARROW, UNTESTED, Verdict, bare, counted, listed, significant
from reports.studies.serving_said import SHARE, TIMED, Race, earlier, races

COMMAND = "python -m harness study serving OUT"
LEAST_SCENES = 3
"""The fewest scenes that settle anything."""
ELSEWHERE: dict[Measure, str] = {"hardest": "where the coarse frame is most wrong", "whole": "over the whole picture"}
LEAST_VISIBLE = 0.5 / 255
"""The least visible RMSE of display colour: half a step of 8 bits."""
NEEDS_SERVING = f"need `{COMMAND}`"
NEEDS_LONGER = f"need `{COMMAND}` without --quick"


def retrieval(bench: Bench, entry: Printed) -> Finding:
    """Judge retrieval. “Instant” has no number: our threshold is the record's, and the spread of repeated calls is
    compared with it.
    """
    record = bench.serving.cache if bench.serving else None
    if record is None:
        return _untested(bench, "time of rendering a view against that of having it from the cache")
    how = (
        f"rendering a view of {record.width} × {record.height} px takes as many times as long as a hit, of a method "
        "that is no longer trained (weights hashed once); “instant” is our bar: "
        f"{bare(record.target_memory)}× in memory, {bare(record.target_disk)}× on disk"
    )
    memory, disk, hashed = (
        [one for one in record.latencies if one.source in sources and one.ratio is not None]
        for sources in (MEMORY, DISK, HASHED)
    )
    if _quick(bench) or not memory + disk:
        return _untested(bench, how)
    verdict = both(record)
    shown = memory or disk
    notes = [] if memory and disk else [f"not measured {'on disk' if memory else 'in memory'}"]
    others = [*(disk if memory else []), *hashed]
    notes += [
        f"from {words}: {_range(some)}"
        for source, words in TIMED.items()
        if (some := [one for one in others if one.source == source])
    ]
    notes += [
        f"{words}: {listed(names)}"
        for failing, words in ((MISSED, "missed"), ("inconclusive", "its spread reaches across the bar"))
        if (names := [f"{one.method} on {one.scene} ({TIMED[one.source]})"
                      for one in memory + disk if judge_hit(one, record) == failing])
    ]  # fmt: skip
    pairs = [one.ratio_spread for one in shown if one.ratio_spread]
    interval = (min(low for low, _ in pairs), max(high for _, high in pairs)) if pairs else None
    return Finding(verdict, how, _ends(shown), interval, note="; ".join(notes))


def pose_key(bench: Bench, entry: Printed) -> Finding:
    """Judge the hash of the pose alone, as in Listing 5: what else may change without its noticing."""
    how = (
        "kinds of change after which a key of the pose alone returns another picture than is asked for, where the same "
        "views are asked for again"
    )
    found = bench.serving.cache.confusions if bench.serving and bench.serving.cache else []
    looked, stale = [one for one in found if one.views], [one for one in found if one.stale]
    if _quick(bench) or not looked:
        return _untested(bench, how)
    views, missed = sum(one.views for one in looked), sum(one.missed for one in looked)
    notes = [f"of {counted(len(looked), 'kind')} of change", *_errors(stale)]
    notes.append(f"our key is new for {'all' if missed == views else f'{missed} of'} {counted(views, 'view')}")
    return Finding("not reproduced" if stale else "reproduced", how, len(stale), note="; ".join(notes))


def _errors(stale: list[Confusion]) -> list[str]:
    """State the errors, and how many of them nobody could see."""
    if not stale:
        return []
    worst = max(stale, key=lambda one: one.rmse)
    hidden = [one.changed for one in stale if one.rmse <= LEAST_VISIBLE]
    seen = "all" if not hidden else f"{len(stale) - len(hidden)} of them"
    unseen = f", but not {listed(hidden)}" if hidden else ""
    return [
        f"off by up to {significant(worst.rmse)} ({worst.changed}; RMSE of display colour)",
        f"{seen} visible in 8 bits (RMSE above 1/510){unseen}",
    ]


def attended_first(bench: Bench, entry: Printed) -> Finding:
    """Judge whether attended regions are useful earlier: on every scene, on some, or on none. Overlapping repeats
    decide nothing.
    """
    how = (
        f"seconds until the attended error has fallen to {100 * SHARE:.0f}{NARROW}% of the coarse frame’s, against "
        "raster order; earlier is what is so in all repeats"
    )
    record = bench.serving.attention if bench.serving else None
    found = [one for one in races(record) if _both_timed(one)] if record else []
    if _quick(bench) or not found:
        return _untested(bench, how)
    scenes = list(dict.fromkeys(one.scene for one in found))
    won = [scene for scene in scenes if all(_ahead(one) for one in found if one.scene == scene)]
    ahead, open_ = sum(map(_ahead, found)), sum(map(_undecided, found))
    verdict: Verdict = "inconclusive"
    if len(scenes) >= LEAST_SCENES and len(won) == len(scenes):
        verdict = "seen"
    elif len(scenes) >= LEAST_SCENES and not ahead and not open_:
        verdict = MISSED
    pairs = [(one.to("attended")["attention"], one.to("attended")["raster"]) for one in found]
    factors = [theirs.seconds / mine.seconds for mine, theirs in pairs if mine and theirs and mine.seconds]
    notes = [
        f"earlier in {ahead} of {counted(len(found), 'case')}, in all of them on {len(won)} of "
        f"{counted(len(scenes), 'scene')}",
        f"undecided, as repeats overlap, in {open_}" if open_ else "",
        "the map that orders regions says which are attended: earlier by construction, but for the map’s own time",
        *(f"{words} {_earliest(found, measure)}" for measure, words in ELSEWHERE.items()),
    ]
    ends = (min(factors), max(factors)) if factors else None
    return Finding(verdict, how, ends, note="; ".join(filter(None, notes)))


def _both_timed(one: Race, measure: Measure = "attended") -> bool:
    return {"attention", "raster"} <= set(one.to(measure))


def _ahead(one: Race, measure: Measure = "attended") -> bool:
    return earlier(one.to(measure), "attention", "raster")


def _undecided(one: Race) -> bool:
    """Return whether both get there, and neither before the other in all repeats."""
    times = one.to("attended")
    there = times["attention"] is not None and times["raster"] is not None
    return there and not _ahead(one) and not earlier(times, "raster", "attention")


def _earliest(found: list[Race], measure: Measure) -> str:
    """State in how many races attention is earlier, if attention has not chosen what is measured."""
    known = [one for one in found if _both_timed(one, measure)]
    return f"earlier in {sum(_ahead(one, measure) for one in known)} of {len(known)}"


def factor_of_priorities(bench: Bench, entry: Printed) -> Finding:
    """Judge the factor φ: priorities sum to φ where shares sum to 1; in what maps that changes an order or an
    allocation.
    """
    how = "orders and allocations of attention maps, with the factor φ and without it"
    phi: PhiCheck | None = bench.serving.attention.phi if bench.serving and bench.serving.attention else None
    if _quick(bench) or phi is None or not phi.maps:
        return _untested(bench, how)
    changed = max(phi.orders_changed, phi.allocations_changed)
    note = (
        f"changed, of {counted(phi.maps, 'map')}; the priorities sum to "
        f"{significant(phi.sum_of_priorities, 4)}, not to 1: they are no probabilities"
    )
    return Finding("reproduced" if changed else "not reproduced", how, changed, note=note)


def _untested(bench: Bench, how: str) -> Finding:
    return Finding(UNTESTED, how, note=NEEDS_LONGER if _quick(bench) else NEEDS_SERVING)


def _quick(bench: Bench) -> bool:
    return bool(bench.serving and is_quick(bench.serving))


def _ends(found: list[Latency]) -> float | Pair | None:
    """Return one figure, or the range from the worst to the best."""
    ratios = [one.ratio for one in found if one.ratio is not None]
    return (min(ratios), max(ratios)) if len(ratios) > 1 else ratios[0] if ratios else None


def _range(found: list[Latency]) -> str:
    ends = _ends(found)
    return listed(list(map(_times, ends)), "to") if isinstance(ends, tuple) else _times(ends or 0.0)


def _times(factor: float) -> str:
    return f"{significant(factor)}×"
