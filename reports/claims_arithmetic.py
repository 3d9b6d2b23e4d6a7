"""The paper's own figures put to the test with nothing but themselves: sums, means, ratios, cross-references."""

import math
from collections.abc import Callable

from reports.judging import half_unit, judge_figures
from reports.ledger import OWN_FIGURES, UNTESTED, Bench, Finding, Printed, Verdict
from reports.wording import listed, number

PHI = (1 + math.sqrt(5)) / 2
DEPTH = 8
"""Layers of the density MLP (Table 1)."""
BANDS = 10
"""Of a position (Table 1)."""
TABLES = 4
COMPONENTS = ("density_net", "density_head", "colour_net")
DIGIT_DB = 0.05
"""What rounding may have taken from a printed score."""


def _computed(entry: Printed, how: str, value: float, slack: float = 0.0, note: str = "") -> Finding:
    """A result against `value`, which the rounding of what it is made of may move by `slack`."""
    if not isinstance(entry.printed, int | float):
        return _absent(how)
    verdict = judge_figures(entry.printed, half_unit(entry.printed, entry.unit), value, (value - slack, value + slack))
    return Finding(verdict, how, value, None, OWN_FIGURES, note)


def _absent(how: str) -> Finding:
    return Finding(UNTESTED, how, scale=OWN_FIGURES, note="this run’s record does not hold the table")


def _agrees(right: bool) -> Verdict:
    return "holds" if right else "does not hold"


def listing_1(bench: Bench, entry: Printed) -> Finding:
    """Eq. 3 against the code that is printed beside it."""
    how = "exponents of Listing 1’s freq_bands, which run from 0 to L − 1"
    note = "Listing 1 is used; it also keeps the raw coordinate, which Eq. 3 does not"
    return Finding(_agrees(entry.printed == BANDS - 1), how, BANDS - 1, None, OWN_FIGURES, note)


def skip_layer(bench: Bench, entry: Printed) -> Finding:
    """Eq. 5."""
    layer = math.floor(PHI * DEPTH / 2)
    return Finding(_agrees(entry.printed == layer), "⌊φ·8/2⌋", layer, None, OWN_FIGURES)


def sum_of_weights(bench: Bench, entry: Printed) -> Finding:
    how = "density MLP + density head + colour MLP, as Table 1 prints them"
    printed = bench.paper.get("table1") or {}
    parts: list[int] = [printed[name] for name in COMPONENTS if name in printed]
    if len(parts) < len(COMPONENTS):
        return _absent(how)
    return _computed(entry, how, sum(parts), sum(half_unit(part) for part in parts))


def differences_of_rows(bench: Bench, entry: Printed) -> Finding:
    """Δ = Q-NeRF − NeRF, the average's row included; each to within what rounding three figures may do."""
    how = "Q-NeRF less NeRF against Δ, row by row"
    rows = {name: row for name, row in (bench.paper.get("table2") or {}).items() if "delta" in row}
    if not rows:
        return _absent(how)
    wrong = [name for name, row in rows.items() if abs(row["qnerf"] - row["nerf"] - row["delta"]) > DIGIT_DB + 1e-9]
    note = f"not {listed(wrong)}" if wrong else ""
    return Finding(
        _agrees(not wrong and len(rows) == entry.printed), how, len(rows) - len(wrong), None, OWN_FIGURES, note
    )


def mean_of_rows(bench: Bench, entry: Printed) -> Finding:
    column = entry.of["column"]
    how = "mean of the column’s eight rows"
    rows = bench.scenes_of_table2().values()
    values = [row[column] for row in rows if column in row]
    if not values or len(values) < len(rows):
        return _absent(how)
    return _computed(entry, how, sum(values) / len(values), DIGIT_DB)


def range_of_rows(bench: Bench, entry: Printed) -> Finding:
    how = "smallest and largest Δ of Table 2"
    values = [row["delta"] for row in bench.scenes_of_table2().values() if "delta" in row]
    if not values or not isinstance(entry.printed, tuple):
        return _absent(how)
    ends = (min(values), max(values))
    return Finding(_agrees(ends == entry.printed), how, ends, None, OWN_FIGURES)


def scenes_of_rows(bench: Bench, entry: Printed) -> Finding:
    many = len(bench.scenes_of_table2())
    how = "rows of Table 2 without the average"
    return Finding(_agrees(many == entry.printed), how, many, None, OWN_FIGURES) if many else _absent(how)


def source_of_baseline(bench: Bench, entry: Printed) -> Finding:
    """Whether the baseline was measured, or taken over: equal figures suggest, but do not prove."""
    how = "scenes whose printed NeRF score is the original NeRF paper’s, rounded (Mildenhall et al. 2020)"
    original, rows = bench.paper.get("original_nerf") or {}, bench.scenes_of_table2()
    known = [scene for scene in rows if scene in original]
    if not known:
        return _absent(how)
    unknown = [scene for scene in rows if scene not in original]
    without = f" (without {listed(unknown)}, of which no original score is recorded)" if unknown else ""
    same = [scene for scene in known if abs(original[scene] - rows[scene]["nerf"]) <= DIGIT_DB + 1e-9]
    note = (
        f"equal in {len(same)} of {len(known)} scenes{without}; the original trained with 4096 rays a step for "
        "100 000 to 300 000 steps. Scores of a training of its own would differ in some last digit, as seeds differ by "
        "more; figures alone do not prove where they come from"
    )
    return Finding("inconclusive", how, len(same), None, OWN_FIGURES, note)


def ratio_of_times(bench: Bench, entry: Printed) -> Finding:
    """1 − Q-NeRF / NeRF in per cent, with what the rounding of both may do."""
    row = bench.row("table3", entry.of["row"])
    how = "1 − Q-NeRF / NeRF of the row"
    if not row or not isinstance(entry.printed, int | float):
        return _absent(how)
    hours = entry.of["row"].startswith("hours")
    half = half_unit(row["nerf"], "h") if hours else 500.0  # printed in thousands
    value = 100 * (1 - row["qnerf"] / row["nerf"])
    reachable = tuple(100 * (1 - (row["qnerf"] + side * half) / (row["nerf"] - side * half)) for side in (1, -1))
    verdict = judge_figures(entry.printed, half_unit(entry.printed), value, (reachable[0], reachable[1]))
    note = f"as a ratio of speeds {number(100 * (row['nerf'] / row['qnerf'] - 1), 0)} %"
    if verdict == "inconclusive":
        room = " to ".join(number(end, 1) for end in reachable)
        note = f"the rounding of the hours leaves {room} % open, and so room for the printed figure; {note}"
    return Finding(verdict, how, value, None, OWN_FIGURES, note)


def _same(how: str, value: Callable[[Bench, str], float | None]) -> Callable[[Bench, Printed], Finding]:
    """A figure that stands in two places."""

    def judge(bench: Bench, entry: Printed) -> Finding:
        other = value(bench, entry.of["method"])
        return (
            _absent(how) if other is None else Finding(_agrees(other == entry.printed), how, other, None, OWN_FIGURES)
        )

    return judge


final_is_average = _same("Table 2’s average", lambda bench, method: bench.row("table2", "average").get(method))
row_of_table2 = _same("Table 2’s row lego", lambda bench, method: bench.row("table2", "lego").get(method))


def number_of_a_table(bench: Bench, entry: Printed) -> Finding:
    note = "the ablation is Table 4; there is no Table 7"
    return Finding(
        _agrees(entry.printed == TABLES), "the table that holds the ablation", TABLES, None, OWN_FIGURES, note
    )
