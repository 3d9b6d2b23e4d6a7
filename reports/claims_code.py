"""What needs no training, or cannot be tested from outside: weights, settings, lines of code."""

from reports.judging import half_unit
from reports.ledger import Bench, Finding, Printed
from reports.scale import number_at
from reports.wording import UNTESTED, count, listed

COMPONENTS = {
    "density_net": "density MLP",
    "density_head": "density head",
    "colour_net": "colour MLP",
    "amplifier": "amplifier",
    "total": "total",
}


PUBLISHED = "need the authors’ code, which is not published"
SETTING = "are settings, taken over or named under Deviations, not results"


def weights(bench: Bench, entry: Printed) -> Finding:
    """Counted at the paper's own size: no training is needed, so the scale of the run does not matter."""
    how = "counted in the network that Table 1 describes"
    ours, printed = bench.paper.get("parameters_measured") or {}, bench.paper.get("table1") or {}
    if "total" not in ours or not set(printed) <= set(ours):
        return Finding(UNTESTED, how, note="need the weights to be counted: run again with --resume")
    wrong = [name for name, many in printed.items() if abs(ours[name] - many) > half_unit(many)]
    off = [f"{COMPONENTS[name]} {count(ours[name])} for {count(printed[name])}" for name in wrong if name != "total"]
    return Finding(
        "not reproduced" if wrong else "reproduced", how, ours["total"], scale="the paper’s network", note=listed(off)
    )


def run_setting(bench: Bench, entry: Printed) -> Finding:
    """A setting is taken over, not put to the test; the run's own stands beside."""
    value = number_at(bench.records.run.settings, *entry.of["at"].split("."))
    return Finding(UNTESTED, "the settings of this run", value, note=SETTING)


def lines(bench: Bench, entry: Printed) -> Finding:
    """Of their module, which is not published; what the same parts take here stands beside."""
    how = "lines of our modules for the same parts that are neither blank nor comment"
    ours = bench.paper.get("sloc_measured")
    files = bench.paper.get("sloc_files") or {}
    if files:
        how += ": " + listed([f"{name} {count(many)}" for name, many in files.items()])
    return Finding(UNTESTED, how, int(ours) if ours is not None else None, note=PUBLISHED)


def their_code(bench: Bench, entry: Printed) -> Finding:
    return Finding(UNTESTED, "cannot be measured from outside", note=PUBLISHED)
