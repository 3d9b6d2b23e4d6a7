"""Past runs → a record of studies: for each machine its figures over the runs, and when they changed."""

from collections.abc import Iterator, Sequence

import numpy as np

from harness.records.study import Answer, Finding, Series, Studies, StudyInfo, StudyRecord, Table
from harness.verdicts.history.change_points import CHANCE, FEWEST, ChangePoint, change_points
from harness.verdicts.history.past_runs import PastRun

MOST_LINES = 8
"""The maximum number of lines in a chart: those with changes first, then those that vary most."""
COLUMNS = ["figure", "unit", "between the commits", "runs", "before", "after", "change (%)", "by chance"]


def figures_over_runs(
    runs: Sequence[PastRun], damaged: Sequence[str], settings: dict[str, object], provenance: dict[str, object]
) -> Studies:
    """Return a study for each machine, in descending order of runs."""
    machines: dict[str, list[PastRun]] = {}
    for run in runs:
        machines.setdefault(run.machine, []).append(run)
    ordered = sorted(machines.items(), key=lambda each: -len(each[1]))
    studies = [
        StudyRecord(
            StudyInfo(f"machine {number}", machine),
            scale=f"{len(own)} runs from {own[0].when} to {own[-1].when}",
            findings=[*_of_machine(own), *map(Answer, damaged if number == 1 else ())],
        )
        for number, (machine, own) in enumerate(ordered, 1)
    ]
    return Studies("history", provenance, settings, studies, finished=True)


def _of_machine(runs: list[PastRun]) -> Iterator[Finding]:
    figures = {name: [run for run in runs if name in run.values] for run in runs for name in run.values}
    values = {name: np.array([run.values[name] for run in own]) for name, own in figures.items()}
    changes = {name: change_points(series) for name, series in values.items()}
    changed = [name for name, points in changes.items() if points]
    tried = sum(len(series) >= FEWEST for series in values.values())
    if not tried:
        yield Answer(f"No figure has the {FEWEST} runs in which a change can be distinguished from chance.")
    else:
        expected = f"{CHANCE * tried:.1g} of them would by chance"
        yield Answer(f"{len(changed)} of {tried} figures with at least {FEWEST} runs changed; {expected}.")
    for name in changed:
        yield Answer(f"{name}: {'; '.join(_sentence(change, figures[name]) for change in changes[name])}.")
    if changed:
        rows = [_row(name, change, figures[name]) for name in changed for change in changes[name]]
        yield Table("changes", 0, "When figures changed", COLUMNS, rows)
    numbers = {id(run): number for number, run in enumerate(runs, 1)}
    units = {name: unit for run in runs for name, unit in run.units.items()}
    for panel, names in _panels(values, units, changes).items():
        for name in names:
            x = [float(numbers[id(run)]) for run in figures[name]]
            label = units.get(name) or "value"
            yield Series(panel, 0, name, "run", label, x, values[name].tolist(), log_x=False, log_y=False)


def _panels(
    values: dict[str, np.ndarray], units: dict[str, str], changes: dict[str, list[ChangePoint]]
) -> dict[str, list[str]]:
    """Return the varying figures of each chart: those with the same unit and the same first part of their names."""
    panels: dict[str, list[str]] = {}
    for name, series in values.items():
        if len(series) > 1 and np.ptp(series) > 0:
            unit = units.get(name)
            panels.setdefault(f"{name.partition('.')[0]}{f' ({unit})' if unit else ''}", []).append(name)

    def first(name: str) -> tuple[bool, float]:
        series = values[name]
        return not changes[name], -float(np.ptp(series) / max(np.abs(series).max(), 1e-300))

    return {panel: sorted(names, key=first)[:MOST_LINES] for panel, names in panels.items()}


def _percent(change: ChangePoint) -> float | None:
    """Return the relative change of positive figures; None for others, such as differences in dB."""
    return 100.0 * (change.after / change.before - 1.0) if min(change.before, change.after) > 0.0 else None


def _sentence(change: ChangePoint, runs: list[PastRun]) -> str:
    percent = _percent(change)
    by = "" if percent is None else f" ({percent:+.1f} %)"
    commits = f"between {runs[change.index - 1].commit} and {runs[change.index].commit}"
    sentence = f"from {change.before:.4g} to {change.after:.4g}{by} {commits}"
    return sentence.replace("from -", "from −").replace("to -", "to −")


def _row(name: str, change: ChangePoint, runs: list[PastRun]) -> list[str | float | None]:
    last, first = runs[change.index - 1], runs[change.index]
    return [
        name,
        first.units.get(name, ""),
        f"{last.commit} … {first.commit}",
        f"{change.index} of {len(runs)}",
        change.before,
        change.after,
        _percent(change),
        change.chance,
    ]
