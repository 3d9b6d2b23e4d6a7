"""What tells one view set from another, and whether finished cells were trained on the one that is there now."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from harness.records import cell_path, read_cell
from scenes.errors import InputError
from scenes.view_set import ViewSet

SAME = 1e-6
"""Relative: what is found from cameras may differ in its last bits between processors."""


def view_set_facts(views: ViewSet) -> dict[str, Any]:
    """As a cell's record holds them."""
    return {
        "name": views.path.resolve().name,
        "digest": views.rendered.get("digest"),
        "content": views.content,
        "width": views.width,
        "height": views.height,
        "focal": views.focal,
        "near": views.near,
        "far": views.far,
        "train": len(views.train.names),
        "test": len(views.test.names),
        "bounds": views.bounds.tolist(),
    }


def finished_on(out: Path, keys: Iterable[tuple[str, str, int]], views: ViewSet) -> int:
    """How many cells of `keys` (scene, method, seed) are finished, all of them on `views`; what an earlier version did
    not record counts as the same. Raises `InputError` where one was trained on others, and `DamagedRecord`."""
    now = view_set_facts(views)
    finished = 0
    for key in keys:
        path = cell_path(out, *key)
        if not path.exists():
            continue
        finished += 1
        before = read_cell(path).settings.get("view_set") or {}
        # a folder may be moved: it is what is in it that counts
        known = [name for name in now if name != "name" and None not in (before.get(name), now[name])]
        if changed := [name for name in known if not _same(before[name], now[name])]:
            what = "; ".join(f"{name} was {_short(before[name])}, is {_short(now[name])}" for name in changed)
            raise InputError(
                f"--resume: {views.path}: not the view set that {path.stem} was trained on ({what}); put that one "
                "back, or name a fresh --out"
            )
    return finished


def _same(before: Any, now: Any) -> bool:
    if isinstance(before, list) and isinstance(now, list):
        return len(before) == len(now) and all(map(_same, before, now))
    if isinstance(before, int | float) and isinstance(now, int | float):
        return math.isclose(before, now, rel_tol=SAME, abs_tol=SAME)
    return bool(before == now)


def _short(value: Any) -> Any:
    return f"{value[:12]}…" if isinstance(value, str) and len(value) > 12 else value
