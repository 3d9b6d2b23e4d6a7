"""Compare two output folders: everything must be bit-identical except clocks and the origin of a run."""

import json
from pathlib import Path
from typing import Any

SAME_BYTES = (
    "out/checkpoints/*.safetensors", "out/records/pictures/*.safetensors",
    "view_sets/*/*/*.png", "view_sets/*/*/*.exr", "view_sets/*/transforms*.json",
)  # fmt: skip
SAME_JSON = (
    "out/records/cells/*.json", "out/records/plan.json", "out/records/run.json", "out/records/comparisons.json",
    "out/records/targets.json", "view_sets/*/view_set.json",
)  # fmt: skip
"""All other files except the journal of rendering, whose order varies."""
CLOCKS = ("train_seconds", "seconds", "train_core_seconds", "core_seconds", "costs", "phases")
CLOCKS += ("provenance", "files", "digest", "digests", "command", "checksum", "p_adjusted")
"""Ignored keys: clocks, how and where a run was made, digests of files with clocks, and adjustments for a family with
comparisons at equal seconds."""
BY_TIME = {"seconds", "core_seconds"}
"""Comparisons at these budgets, or on these axes, depend on a clock."""
ABOUT_CLOCKS = ("Cores of their own for all timed cells", "Clocks in one piece")
"""The beginnings of sentences about the load of the machine and about interruptions."""


def differences(here: Path, reference: Path) -> list[str]:
    """Return the differences of a run and its view sets from an undisturbed run, and leftover temporary files."""
    names = (file.name for file in here.rglob(".*"))
    unlike = [f"left behind: {name}" for name in names
              if name.endswith((".part", ".partial")) or name.startswith(".scratch-")]  # fmt: skip
    for patterns, read in ((SAME_BYTES, Path.read_bytes), (SAME_JSON, _timeless_json)):
        for pattern in patterns:
            first, second = ({file.relative_to(root): read(file) for file in root.glob(pattern)}
                          for root in (reference, here))  # fmt: skip
            unlike += [] if first else [f"{pattern}: nothing to compare"]
            unlike += [f"{name}: not the same" for name in {*first, *second} if first.get(name) != second.get(name)]
    return unlike


def cells_resumed(out: Path) -> int:
    """Count the cells of a run that were resumed in the middle of their training."""
    cells = (json.loads(file.read_text(encoding="utf-8")) for file in (out / "records/cells").glob("*.json"))
    return sum("resumed_at" in cell["provenance"] for cell in cells)


def _timeless_json(file: Path) -> Any:
    return _timeless(json.loads(file.read_text(encoding="utf-8")))


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(inner) for key, inner in value.items() if key not in CLOCKS}
    if isinstance(value, list):
        return [_timeless(inner) for inner in value if not _is_by_time(inner)]
    return value


def _is_by_time(row: Any) -> bool:
    if isinstance(row, str):
        return row.startswith(ABOUT_CLOCKS)
    return isinstance(row, dict) and not BY_TIME.isdisjoint((row.get("budget"), row.get("axis")))
