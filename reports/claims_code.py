"""What needs no training, or cannot be tested from outside: weights, settings, lines of code."""

from reports.judging import half_unit
from reports.ledger import UNTESTED, Bench, Finding, Printed, Verdict
from reports.scale import number_at
from reports.wording import count, listed

COMPONENTS = {
    "density_net": "density MLP",
    "density_head": "density head",
    "colour_net": "colour MLP",
    "amplifier": "amplifier",
    "total": "total",
}


def weights(bench: Bench, entry: Printed) -> Finding:
    """Counted at the paper's own size: no training is needed, so the scale of the run does not matter."""
    how = "counted in the network that is built as Table 1 describes it"
    ours = (bench.paper.get("parameters_measured") or {}).get(entry.of["component"])
    if ours is None or not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how, note="not counted in this run")
    verdict: Verdict = "holds" if abs(ours - entry.printed) <= half_unit(entry.printed) else "does not hold"
    return Finding(verdict, how, ours, scale="the paper’s network")


def run_setting(bench: Bench, entry: Printed) -> Finding:
    """A setting is taken over, not put to the test; the run's own stands beside."""
    path = entry.of["at"].split(".") if "at" in entry.of else ["train", "network", entry.of["setting"]]
    value = number_at(bench.records.run.settings, *path)
    how = "the settings of this run" if "at" in entry.of else "the networks of this run"
    return Finding(UNTESTED, how, value, note="a setting, not a result")


def lines(bench: Bench, entry: Printed) -> Finding:
    """Of their module, which is not published; what the same parts take here stands beside."""
    how = "lines of our modules for the same parts that are neither blank nor comment"
    ours = bench.paper.get("sloc_measured")
    files = bench.paper.get("sloc_files") or {}
    note = "the authors’ module is not published"
    if files:
        note += "; ours: " + listed([f"{name} {count(many)}" for name, many in files.items()])
    return Finding(UNTESTED, how, int(ours) if ours is not None else None, note=note)


def their_code(bench: Bench, entry: Printed) -> Finding:
    return Finding(UNTESTED, "cannot be measured from outside", note="the authors’ code is not published")
