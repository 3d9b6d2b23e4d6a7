"""Whether the clocks of a run's cells were of the same kind; what a reader must know where they were not."""

from collections import defaultdict

from harness.records import CellRecord


def clocks_apart(cells: list[CellRecord]) -> list[str]:
    """Sentences for what a run did not test: one clock for all cells. None where all ran alike."""
    timed = [cell for cell in cells if cell.provenance and cell.train_seconds > 0]
    kinds = sorted({_kind(cell) for cell in timed})
    found = []
    if len(kinds) > 1:
        groups: dict[tuple[str, int], set[str]] = defaultdict(set)
        for cell in timed:
            groups[cell.scene, cell.seed].add(_kind(cell))
        split = sum(len(kinds) > 1 for kinds in groups.values())
        said = (
            f"All {len(groups)} groups of one scene and seed were trained on one kind each: what is compared at equal "
            "time is of one kind, but seconds of different scenes and seeds are not."
        )
        if split:
            said = (
                f"In {split} of {len(groups)} groups of one scene and seed the methods ran on different kinds: what is "
                "compared at equal time mixes their clocks there."
            )
        found.append(f"One clock: cells ran on {len(kinds)} kinds of processor ({'; '.join(kinds)}). {said}")
    # runs from before cores were taken say nothing about them
    unbound = sum(not cell.provenance.get("own_cores", True) for cell in timed)
    if unbound:
        found.append(
            f"Cores of their own for all timed cells: {unbound} of {len(timed)} could not be bound to any, so that "
            "their training seconds may be long."
        )
    pieces = sum("resumed_at" in cell.provenance for cell in timed)
    if pieces:
        found.append(
            f"Clocks in one piece: {pieces} of {len(timed)} cells were interrupted and went on in another process; "
            "their training seconds are the sum of what both measured."
        )
    return found


def _kind(cell: CellRecord) -> str:
    """The GPU where there is one, else the processor; with the number of threads, which set the pace as well."""
    device = cell.provenance.get("device", "cpu")
    name = cell.provenance.get("processor", "unknown") if device == "cpu" else device
    return f"{name}, {cell.provenance.get('threads', '?')} threads"
