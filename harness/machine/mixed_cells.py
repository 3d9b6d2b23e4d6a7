"""Checks whether the cells of a run share code, packages and kind of processor; notes for readers if they do not."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

from harness.machine.provenance import CHECKED
from harness.records.cells import CellRecord, cell_path
from scenes.files.json_object import JsonObject


def mixed_hardware(cells: list[CellRecord]) -> list[str]:
    """Return the sentences on mixed hardware for the list of what a run did not test."""
    timed = [cell for cell in cells if cell.provenance and cell.train_seconds > 0]
    groups: dict[tuple[str, int], set[str]] = defaultdict(set)
    for cell in timed:
        device = cell.provenance.get("device", "cpu")
        name = cell.provenance.get("processor", "unknown") if device == "cpu" else device
        groups[cell.scene, cell.seed].add(f"{name}, {cell.provenance.get('threads', '?')} threads")
    kinds = sorted(set().union(*groups.values()))
    sentences = []
    if len(kinds) > 1:
        split = sum(len(kinds) > 1 for kinds in groups.values())
        consequence = (
            f"In {split} of {len(groups)} groups of one scene and seed the methods ran on different kinds: their "
            "comparisons at equal time mix clocks."
            if split
            else f"Each of the {len(groups)} groups of one scene and seed was trained on one kind: comparisons at "
            "equal time do not mix kinds, but seconds of different scenes and seeds do."
        )
        sentences.append(f"One clock: cells ran on {len(kinds)} kinds of processor ({'; '.join(kinds)}). {consequence}")
    # old records do not name their cores
    if unbound := sum(not cell.provenance.get("own_cores", True) for cell in timed):
        sentences.append(
            f"Cores of their own for all timed cells: {unbound} of {len(timed)} could not be bound to any, so that "
            "their training seconds may be long."
        )
    if pieces := sum("resumed_at" in cell.provenance for cell in timed):
        sentences.append(
            f"Clocks in one piece: {pieces} of {len(timed)} cells were interrupted and resumed in another process; "
            "their training seconds are the sum of both parts."
        )
    return sentences


NAMED = 4
"""The maximum number of cells of the same origin that are named; the others are counted."""


def mixed_sources(cells: Sequence[CellRecord]) -> list[str]:
    """Return the sentence on mixed code, if it is mixed, for the list of what a run did not test."""
    groups: dict[tuple[str, int], list[dict[str, str]]] = defaultdict(list)
    for cell in cells:
        if cell.provenance:
            groups[cell.scene, cell.seed].append(_made_by(cell.provenance, cell.method))
    made = [versions for group in groups.values() for versions in group]
    differing = _unlike(made)
    if not differing:
        return []
    counted = {name: Counter(versions[name] for versions in made if name in versions) for name in differing}
    what = "; ".join(
        f"{name} {', '.join(f'{value} ({count} cells)' for value, count in values.items())}"
        for name, values in counted.items()
    )
    split = sum(bool(_unlike(group)) for group in groups.values())
    consequence = (
        f"In {split} of {len(groups)} groups of one scene and seed the methods were made by different code or "
        "packages: their paired comparisons compare the code as well."
        if split
        else f"Each of the {len(groups)} groups of one scene and seed was made by one code: differences between scenes "
        "and seeds may come from the code."
    )
    return [f"One code and one set of packages for all cells: they differ in {what}. {consequence}"]


def stale_cells(cells: Sequence[CellRecord], here: JsonObject, out: Path) -> str | None:
    """Return a line on the finished cells whose code or packages differ from `here`, and how to renew them."""
    unlike: dict[str, list[str]] = defaultdict(list)
    for cell in cells:
        before, now = (_made_by(origin, cell.method) for origin in (cell.provenance, here))
        if cell.provenance and (differing := _unlike([before, now])):
            words = ", ".join(f"{name} {before[name]} instead of {now[name]}" for name in differing)
            unlike[words].append(cell_path(out, cell.scene, cell.method, cell.seed).stem)
    if not unlike:
        return None
    which = "; ".join(
        ", ".join(names[:NAMED]) + (f" and {len(names) - NAMED} more" if len(names) > NAMED else "") + f": {words}"
        for words, names in unlike.items()
    )
    return (
        f"{sum(map(len, unlike.values()))} of {len(cells)} finished cells were made by other code or packages "
        f"({which}) and are compared with the others all the same; to train them again, remove their records in "
        f"{cell_path(out, '', '', 0).parent} and use --resume, or name a fresh --out"
    )


def _made_by(origin: JsonObject, method: str) -> dict[str, str]:
    """Return name → version of all software that a cell of `method` may depend on, as far as it is known."""
    packages, plugin = origin.get("packages", {}), origin.get("plugins", {}).get(method)
    made = {"sources": origin.get("sources"), "commit": origin.get("commit"), "Python": origin.get("python")}
    made |= {name: packages.get(name) for name in CHECKED}
    if plugin is not None:
        made[f"package of {method}"] = f"{plugin['package']} {plugin['version']} ({plugin['sources'][:12]})"
    return {name: value for name, value in made.items() if value is not None}


def _unlike(made: list[dict[str, str]]) -> list[str]:
    """Return the names with several values; not the commit, which may concern other files, if all sources are equal."""
    names = dict.fromkeys(name for versions in made for name in versions)
    differing = [name for name in names if len({versions[name] for versions in made if name in versions}) > 1]
    if "sources" not in differing and all("sources" in versions for versions in made):
        return [name for name in differing if name != "commit"]
    return differing
