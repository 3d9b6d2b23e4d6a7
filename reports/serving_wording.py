"""Figures of serving in words: short times, bytes, and whether targets are met."""

from collections.abc import Sequence

from harness.serving_record import Measure, Way
from reports.wording import Verdict, counted, listed, number, significant

SOURCES = {
    "render": "rendered",
    "level 2": "disk (level 2)",
    "level 1": "memory (level 1)",
    "level 0": "memory (level 0)",
}
"""From the slowest to the fastest."""
TIMED = {
    "render": "rendered",
    "level 2 cold": "disk, file not in the system’s memory",
    "level 2": "disk, file in the system’s memory",
    "level 0 hashed": "memory (level 0), weights hashed at the call",
    "level 1": "memory (level 1)",
    "level 0": "memory (level 0)",
}
"""What was timed, in the same order."""
MAPS = {
    "point": "a point of interest",
    "mask": "a user’s mask",
    "gradients": "gradients of the coarse frame",
    "error": "estimated error",
    "foveal": "falling off as in an eye",
}
"""Attention maps; others are called as the record calls them."""
ORDERS = {"attention": "by attention", "raster": "in raster order", "spread": "spread", "plain": "plain"}
MEASURES: dict[Measure, str] = {
    "whole": "the whole picture",
    "hardest": "the quarter of the regions in which the coarse frame is most wrong",
    "attended": "the quarter of the regions that is attended most",
}
WAYS: dict[Way, str] = {
    "evaluations": "by attention, as many evaluations",
    "samples": "by attention, as many samples",
    "even": "the same for each ray",
}
OUTCOMES: dict[Verdict, str] = {"seen": "met", "not seen at this scale": "missed", "inconclusive": "open"}


def brief(seconds: float) -> str:
    """18.3 µs, 45.2 ms, 1.20 s."""
    for size, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= size:
            return f"{significant(seconds / size)} {unit}"
    return "0 s" if seconds == 0 else f"{significant(seconds * 1e6)} µs"


def bytes_said(many: int) -> str:
    """160 kB, 1.05 MB: powers of a thousand."""
    for size, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if many >= size:
            return f"{significant(many / size)} {unit}"
    return counted(many, "byte")


def times(ratios: Sequence[float]) -> str:
    """2 100 times, 2 100 to 3 900 times."""
    low, high = significant(min(ratios)), significant(max(ratios))
    return f"{low} times" if low == high else f"{low} to {high} times"


def outcome(verdicts: Sequence[Verdict]) -> str:
    """`met`, `missed`, `met in 4 of 6 cases, missed in 1, open in 1: its spread reaches across`."""
    kinds = [one for one in OUTCOMES if one in verdicts]
    across = ": the spread reaches across" if "inconclusive" in kinds else ""
    if len(kinds) == 1:
        return f"{OUTCOMES[kinds[0]]}{across}"
    parts = [f"{OUTCOMES[kind]} in {sum(one == kind for one in verdicts)}" for kind in kinds]
    parts[0] += f" of {len(verdicts)} cases"
    return f"{', '.join(parts)}{across}"


def factor(ratios: Sequence[float]) -> str:
    """Geometric mean and range: `0.61 times (0.41 to 0.92)`."""
    from statistics import geometric_mean

    middle = number(geometric_mean(ratios))
    low, high = number(min(ratios)), number(max(ratios))
    return f"{middle} times" if low == high else f"{middle} times ({low} to {high})"


def of_cases(names: Sequence[tuple[str, str]]) -> str:
    """Scene and map, gathered by scene: `lego (point, foveal) and ship (mask)`."""
    scenes = dict.fromkeys(scene for scene, _ in names)
    gathered = [
        f"{scene} ({', '.join(dict.fromkeys(kind for one, kind in names if one == scene))})" for scene in scenes
    ]
    return listed(gathered)
