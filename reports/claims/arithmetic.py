"""Checks of the paper's own figures against each other (sums, means, ratios, cross-references), and counts of code."""

import math
from collections.abc import Callable

from harness.records.claims import Number, Pair, Statement
from reports.claims.ledger import OWN_FIGURES, Bench, Finding, half_unit, judge_figures
from reports.data.scale import number_at
from reports.data.wording import UNTESTED, Verdict, count, listed, number

PHI = (1 + math.sqrt(5)) / 2
COMPONENT_TITLES = {
    "density_net": "density MLP",
    "density_head": "density head",
    "colour_net": "colour MLP",
    "amplifier": "amplifier",
    "total": "total",
}
DIGIT_DB = 0.05
"""The maximum error of a printed score by rounding."""

Result = tuple[Verdict, Number | Pair, str]


def _exactly(entry: Statement, value: Number | Pair, note: str = "") -> Result:
    return "reproduced" if entry.printed == value else "not reproduced", value, note


def _counted(entry: Statement, right: dict[str, bool]) -> Result | None:
    """Return how many of several figures are as printed, and which are not; None if there are none."""
    wrong = [name for name, holds in right.items() if not holds]
    verdict: Verdict = "reproduced" if not wrong and len(right) == entry.printed else "not reproduced"
    return (verdict, len(right) - len(wrong), f"not {listed(wrong)}" if wrong else "") if right else None


def last_exponent(bench: Bench, entry: Statement) -> Result:
    """Compare Eq. 3 with the code that is printed next to it, for L = 10."""
    return _exactly(entry, 9, "Listing 1 is used; it also keeps the raw coordinate, which Eq. 3 does not")


def sum_of_weights(bench: Bench, entry: Statement) -> Result | None:
    printed = bench.file.tables.get("weights", {})
    parts = [printed[name] for name in ("density_net", "density_head", "colour_net") if name in printed]
    if len(parts) < 3 or not isinstance(entry.printed, int | float):
        return None
    total, slack = sum(parts), sum(half_unit(part) for part in parts)
    rounding = half_unit(entry.printed, entry.unit)
    return judge_figures(entry.printed, rounding, total, (total - slack, total + slack)), total, ""


def differences_of_rows(bench: Bench, entry: Statement) -> Result | None:
    """Check Δ = Q-NeRF − NeRF, the average's row included; each to within the rounding of three figures."""
    needed = {"delta", entry.of["method"], entry.of["against"]}
    rows = {name: row for name, row in bench.file.psnr.items() if needed <= row.keys()}
    gains = {name: row[entry.of["method"]] - row[entry.of["against"]] for name, row in rows.items()}
    return _counted(entry, {name: abs(gains[name] - row["delta"]) <= 3 * DIGIT_DB for name, row in rows.items()})


def means_of_rows(bench: Bench, entry: Statement) -> Result | None:
    """Check the row of averages, each to within the rounding of its column's figures."""
    rows, right = list(bench.file.scenes.values()), {}
    for column, average in bench.file.psnr.get("average", {}).items():
        values = [row[column] for row in rows if column in row]
        if len(values) < max(len(rows), 1):
            return None
        mean = sum(values) / len(values)
        ends = (mean - DIGIT_DB, mean + DIGIT_DB)
        right[column] = judge_figures(average, half_unit(average, "dB"), mean, ends) == "reproduced"
    return _counted(entry, right)


def range_of_rows(bench: Bench, entry: Statement) -> Result | None:
    gains = [row["delta"] for row in bench.file.scenes.values() if "delta" in row]
    return _exactly(entry, (min(gains), max(gains))) if gains else None


def source_of_baseline(bench: Bench, entry: Statement) -> Result | None:
    """Judge whether the baseline was measured or copied: equal figures suggest a copy, but do not prove it."""
    original, method = bench.file.tables.get("original", {}), entry.of["method"]
    printed = {scene: row[method] for scene, row in bench.file.scenes.items() if method in row}
    known = [scene for scene in printed if scene in original]
    unknown = [scene for scene in printed if scene not in original]
    without = f" (without {listed(unknown)}, of which no original score is recorded)" if unknown else ""
    same = [scene for scene in known if abs(original[scene] - printed[scene]) <= DIGIT_DB + 1e-9]
    note = (
        f"equal in {len(same)} of {len(known)} scenes{without}; the original trained with 4096 rays per step for "
        "100 000 to 300 000 steps. Scores of a separate training would differ in some last digit, as seeds differ by "
        "more; figures do not prove where they come from"
    )
    return ("inconclusive", len(same), note) if known else None


def ratio_of_times(bench: Bench, entry: Statement) -> Result | None:
    """Check 1 − Q-NeRF / NeRF in per cent, with the rounding of both."""
    row = bench.file.tables.get("times", {}).get(entry.of["row"], {})
    if not {entry.of["method"], entry.of["against"]} <= row.keys() or not isinstance(entry.printed, int | float):
        return None
    ours, theirs = row[entry.of["method"]], row[entry.of["against"]]
    half = half_unit(theirs, "h") if entry.of["row"].startswith("hours") else 500.0  # printed in thousands
    low, high = (100 * (1 - (ours + side * half) / (theirs - side * half)) for side in (1, -1))
    value = 100 * (1 - ours / theirs)
    verdict = judge_figures(entry.printed, half_unit(entry.printed, entry.unit), value, (low, high))
    note = f"as a ratio of speeds {number(100 * (theirs / ours - 1), 0)} %"
    if verdict == "inconclusive":
        room = f"{number(low, 1)} to {number(high, 1)}"
        note = f"the rounding of the hours leaves {room} % open, and so room for the printed figure; {note}"
    return verdict, value, note


def final_is_average(bench: Bench, entry: Statement) -> Result | None:
    final, average = bench.file.tables.get("times", {}).get("final_psnr", {}), bench.file.psnr.get("average", {})
    return _counted(entry, {name: average[name] == value for name, value in final.items() if name in average})


def row_of_table2(bench: Bench, entry: Statement) -> Result | None:
    lego = bench.file.psnr.get("lego", {})
    ablation = {row["method"]: row["scores"]["psnr"] for row in bench.file.tables.get("ablation", [])}
    return _counted(entry, {name: lego[name] == value for name, value in ablation.items() if name in lego})


FIGURES: dict[str, tuple[str, Callable[[Bench, Statement], Result | None]]] = {
    "listing 1": ("exponents of Listing 1’s freq_bands, which run from 0 to L − 1", last_exponent),
    "skip layer": ("⌊φ·8/2⌋", lambda _, entry: _exactly(entry, math.floor(PHI * 8 / 2))),
    "sum of weights": ("density MLP + density head + colour MLP, as Table 1 prints them", sum_of_weights),
    "differences of rows": ("Q-NeRF less NeRF against Δ, row by row", differences_of_rows),
    "means of rows": ("mean of each column’s rows", means_of_rows),
    "range of rows": ("smallest and largest Δ of Table 2", range_of_rows),
    "scenes of rows": (
        "rows of Table 2 without the average",
        lambda bench, entry: _exactly(entry, len(bench.file.scenes)) if bench.file.scenes else None,
    ),
    "source of the baseline": (
        "scenes whose printed NeRF score is the original NeRF paper’s, rounded (Mildenhall et al. 2020)",
        source_of_baseline,
    ),
    "ratio of times": ("1 − Q-NeRF / NeRF of the row", ratio_of_times),
    "final is average": ("Table 3’s final scores against Table 2’s averages", final_is_average),
    "row of table 2": ("Table 4’s first and last row against Table 2’s row lego", row_of_table2),
    "number of a table": (
        "the table that holds the ablation",
        lambda _, entry: _exactly(entry, 4, "the ablation is Table 4; there is no Table 7"),
    ),
}
"""Quantity of a claim → how the printed figures check it, and the check, which returns None without the tables."""


def own_figures(bench: Bench, entry: Statement) -> Finding:
    how, check = FIGURES[entry.quantity]
    result = check(bench, entry)
    if result is None:
        return Finding(UNTESTED, how, scale=OWN_FIGURES, note="need the printed tables, which this run’s record lacks")
    verdict, value, note = result
    return Finding(verdict, how, value, None, OWN_FIGURES, note)


PUBLISHED = "need the authors’ code, which is not published"


def weights(bench: Bench, entry: Statement) -> Finding:
    """Check the weights of a network of the paper's size: counting needs no training, so any run will do."""
    how = "counted in the network that Table 1 describes"
    ours, printed = bench.file.measured.get("weights", {}), bench.file.tables.get("weights", {})
    if "total" not in ours or not set(printed) <= set(ours):
        return Finding(UNTESTED, how, note="need the weights to be counted: run again with --resume")
    wrong = [name for name, many in printed.items() if abs(ours[name] - many) > half_unit(many)]
    off = [
        f"{COMPONENT_TITLES[name]} {count(ours[name])} for {count(printed[name])}" for name in wrong if name != "total"
    ]
    verdict: Verdict = "not reproduced" if wrong else "reproduced"
    return Finding(verdict, how, ours["total"], scale="the paper’s network", note=listed(off))


def run_setting(bench: Bench, entry: Statement) -> Finding:
    value = number_at(bench.records.run.settings, *entry.of["at"].split("."))
    note = "are settings, taken over or named under Deviations, not results"
    return Finding(UNTESTED, "the settings of this run", value, note=note)


def lines(bench: Bench, entry: Statement) -> Finding:
    """Show how many lines the same parts have here; the paper's module is not published."""
    here, files = bench.file.measured.get("sloc"), bench.file.measured.get("sloc_files", {})
    how = "lines of our modules for the same parts that are neither blank nor comment"
    how += ": " + listed([f"{name} {count(many)}" for name, many in files.items()]) if files else ""
    return Finding(UNTESTED, how, int(here) if here is not None else None, note=PUBLISHED)


def their_code(bench: Bench, entry: Statement) -> Finding:
    return Finding(UNTESTED, "cannot be measured from outside", note=PUBLISHED)
