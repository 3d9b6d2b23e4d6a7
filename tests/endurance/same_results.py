"""When two output folders hold the same results: everything bit for bit, but clocks and where a run was made."""

import json
from pathlib import Path
from typing import Any

BYTES = ("checkpoints/*.safetensors", "records/pictures/*.safetensors")
"""Files that are the same byte for byte."""
CLOCKS = ("train_seconds", "seconds", "provenance", "files", "digest", "phases", "command", "checksum")
"""Keys left out wherever they stand: clocks, how and where a run was made, and digests of files with clocks in them."""
BY_TIME = "seconds"
"""Comparisons at this budget, or on this axis, depend on the clock."""

ABOUT_CLOCKS = ("Cores of their own for all timed cells", "Clocks in one piece")
"""How sentences of a run begin that say how busy the machine was, and what was interrupted."""


def same_results(one: Path, other: Path) -> list[str]:
    """What differs between two finished runs of one plan, a line each; none where the results are the same."""
    found = []
    for pattern in BYTES:
        found += _unlike_bytes(one, other, pattern)
    records = [{file.name: _read(file) for file in (out / "records/cells").glob("*.json")} for out in (one, other)]
    found += _unlike("records/cells", *records)
    for name in ("plan.json", "run.json", "comparisons.json", "targets.json"):
        here, there = (_read(out / "records" / name) for out in (one, other))
        if here != there:
            found.append(f"records/{name}: not the same")
    return found


def same_view_sets(one: Path, other: Path) -> list[str]:
    """As `same_results`, of two caches of view sets; the journal of what was rendered is in the order of rendering."""
    found = []
    for pattern in ("*/*/*.png", "*/*/*.exr", "*/transforms*.json"):
        found += _unlike_bytes(one, other, pattern)
    manifests = [{file.parent.name: _read(file) for file in out.glob("*/view_set.json")} for out in (one, other)]
    return found + _unlike("view_set.json", *manifests)


def cells_gone_on(out: Path) -> int:
    """How many cells of a run went on in the middle of their training."""
    cells = (json.loads(file.read_text(encoding="utf-8")) for file in (out / "records/cells").glob("*.json"))
    return sum("resumed_at" in cell["provenance"] for cell in cells)


def left_behind(folder: Path) -> list[str]:
    """Temporary files and folders of writers."""
    names = (file.name for file in folder.rglob(".*"))
    return [name for name in names if name.endswith((".part", ".partial")) or name.startswith(".scratch-")]


def _unlike_bytes(one: Path, other: Path, pattern: str) -> list[str]:
    return _unlike(
        pattern,
        *({str(file.relative_to(out)): file.read_bytes() for file in out.glob(pattern)} for out in (one, other)),
    )


def _unlike(what: str, one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    if not one:
        return [f"{what}: nothing to compare"]
    return [f"{what}: {name}" for name in sorted({*one, *other}) if one.get(name) != other.get(name)]


def _read(file: Path) -> Any:
    return _timeless(json.loads(file.read_text(encoding="utf-8")))


def _timeless(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _timeless(one) for key, one in value.items() if key not in CLOCKS}
    if isinstance(value, list):
        return [_timeless(one) for one in value if not _is_by_time(one)]
    return value


def _is_by_time(row: Any) -> bool:
    if isinstance(row, str):
        return row.startswith(ABOUT_CLOCKS)
    return isinstance(row, dict) and BY_TIME in (row.get("budget"), row.get("axis"))
