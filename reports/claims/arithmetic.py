"""Tests of the paper's own figures against each other alone: sums, means, ratios, cross-references."""

import math

from reports.claims.ledger import OWN_FIGURES, Bench, Finding, Printed, half_unit, judge_figures
from reports.data.scale import number_at
from reports.data.wording import UNTESTED, Verdict, count, listed, number

PHI = (1 + math.sqrt(5)) / 2
DEPTH = 8
"""The layers of the density MLP (Table 1)."""
BANDS = 10
"""The bands of a position (Table 1)."""
TABLES = 4
COMPONENTS = ("density_net", "density_head", "colour_net")
DIGIT_DB = 0.05
"""The most that rounding may have taken from a printed score."""


def _computed(entry: Printed, how: str, value: float, slack: float = 0.0, note: str = "") -> Finding:
    """Compare a result with `value`, which the rounding of its operands may move by `slack`."""
    if not isinstance(entry.printed, int | float):
        return _absent(how)
    verdict = judge_figures(entry.printed, half_unit(entry.printed, entry.unit), value, (value - slack, value + slack))
    return Finding(verdict, how, value, None, OWN_FIGURES, note)


def _absent(how: str) -> Finding:
    return Finding(UNTESTED, how, scale=OWN_FIGURES, note="need the paper’s tables, which this run’s record lacks")


def _agrees(right: bool) -> Verdict:
    return "reproduced" if right else "not reproduced"


def listing_1(bench: Bench, entry: Printed) -> Finding:
    """Compare Eq. 3 with the code that is printed beside it."""
    how = "exponents of Listing 1’s freq_bands, which run from 0 to L − 1"
    note = "Listing 1 is used; it also keeps the raw coordinate, which Eq. 3 does not"
    return Finding(_agrees(entry.printed == BANDS - 1), how, BANDS - 1, None, OWN_FIGURES, note)


def skip_layer(bench: Bench, entry: Printed) -> Finding:
    """Check Eq. 5."""
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
    """Check Δ = Q-NeRF − NeRF, the average's row included; each to within the rounding of three figures."""
    rows = {name: row for name, row in (bench.paper.get("table2") or {}).items() if "delta" in row}
    right = {name: abs(row["qnerf"] - row["nerf"] - row["delta"]) <= DIGIT_DB + 1e-9 for name, row in rows.items()}
    return _counted(entry, "Q-NeRF less NeRF against Δ, row by row", right)


def means_of_rows(bench: Bench, entry: Printed) -> Finding:
    """Check the row of averages, each to within the rounding of its column's figures."""
    rows, average = list(bench.scenes_of_table2().values()), bench.row("table2", "average")
    right = {}
    for column in average:
        values = [row[column] for row in rows if column in row]
        if len(values) < max(len(rows), 1):
            return _absent("mean of each column’s rows")
        mean = sum(values) / len(values)
        ends = (mean - DIGIT_DB, mean + DIGIT_DB)
        right[column] = judge_figures(average[column], half_unit(average[column], "dB"), mean, ends) == "reproduced"
    return _counted(entry, "mean of each column’s rows", right)


def _counted(entry: Printed, how: str, right: dict[str, bool]) -> Finding:
    """Judge several things: how many are as printed, and which are not."""
    if not right:
        return _absent(how)
    wrong = [name for name, one in right.items() if not one]
    verdict = _agrees(not wrong and len(right) == entry.printed)
    note = f"not {listed(wrong)}" if wrong else ""
    return Finding(verdict, how, len(right) - len(wrong), None, OWN_FIGURES, note)


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
    """Judge whether the baseline was measured, or taken over: equal figures suggest, but do not prove."""
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
    """Check 1 − Q-NeRF / NeRF in per cent, with the rounding of both."""
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


def final_is_average(bench: Bench, entry: Printed) -> Finding:
    final, average = (bench.paper.get("table3") or {}).get("final_psnr") or {}, bench.row("table2", "average")
    right = {name: average[name] == value for name, value in final.items() if name in average}
    return _counted(entry, "Table 3’s final scores against Table 2’s averages", right)


def row_of_table2(bench: Bench, entry: Printed) -> Finding:
    lego = bench.row("table2", "lego")
    ablation = {row["method"]: row["psnr"] for row in bench.paper.get("table4") or []}
    right = {name: lego[name] == value for name, value in ablation.items() if name in lego}
    return _counted(entry, "Table 4’s first and last row against Table 2’s row lego", right)


def number_of_a_table(bench: Bench, entry: Printed) -> Finding:
    note = "the ablation is Table 4; there is no Table 7"
    return Finding(
        _agrees(entry.printed == TABLES), "the table that holds the ablation", TABLES, None, OWN_FIGURES, note
    )


COMPONENT_TITLES = {
    "density_net": "density MLP",
    "density_head": "density head",
    "colour_net": "colour MLP",
    "amplifier": "amplifier",
    "total": "total",
}


PUBLISHED = "need the authors’ code, which is not published"
SETTING = "are settings, taken over or named under Deviations, not results"


def weights(bench: Bench, entry: Printed) -> Finding:
    """Check the weights, counted at the paper's own size: no training is needed, so the run's scale does not matter."""
    how = "counted in the network that Table 1 describes"
    ours, printed = bench.paper.get("parameters_measured") or {}, bench.paper.get("table1") or {}
    if "total" not in ours or not set(printed) <= set(ours):
        return Finding(UNTESTED, how, note="need the weights to be counted: run again with --resume")
    wrong = [name for name, many in printed.items() if abs(ours[name] - many) > half_unit(many)]
    off = [
        f"{COMPONENT_TITLES[name]} {count(ours[name])} for {count(printed[name])}" for name in wrong if name != "total"
    ]
    return Finding(
        "not reproduced" if wrong else "reproduced", how, ours["total"], scale="the paper’s network", note=listed(off)
    )


def run_setting(bench: Bench, entry: Printed) -> Finding:
    """Show a setting, which is taken over and not tested; the run's own stands beside it."""
    value = number_at(bench.records.run.settings, *entry.of["at"].split("."))
    return Finding(UNTESTED, "the settings of this run", value, note=SETTING)


def lines(bench: Bench, entry: Printed) -> Finding:
    """Show the lines of their module, which is not published; those of the same parts here stand beside it."""
    how = "lines of our modules for the same parts that are neither blank nor comment"
    ours = bench.paper.get("sloc_measured")
    files = bench.paper.get("sloc_files") or {}
    if files:
        how += ": " + listed([f"{name} {count(many)}" for name, many in files.items()])
    return Finding(UNTESTED, how, int(ours) if ours is not None else None, note=PUBLISHED)


def their_code(bench: Bench, entry: Printed) -> Finding:
    return Finding(UNTESTED, "cannot be measured from outside", note=PUBLISHED)
