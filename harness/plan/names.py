"""Names that a user gives: each must be known, and given once; that of a view set comes from its folder."""

import re
from pathlib import Path

from scenes.files.errors import InputError


def scene_name_of(view_set: Path) -> str:
    """Make a name for records from that of the folder, or of an archive, of letters, digits, `-` and `_`."""
    place = view_set.resolve()
    if place.is_file() and place.suffix == ".json":
        place = place.parent
    name = place.stem if place.is_file() and place.suffix == ".npz" else place.name
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or "view-set"


def known_names(option: str, names: list[str], known: list[str]) -> tuple[str, ...]:
    """Return `names` as a tuple; raises `InputError` for a name that is unknown or given twice."""
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"{option}: unknown {' '.join(map(repr, unknown))}; known: {' '.join(known)}")
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise InputError(f"{option}: {' '.join(repeated)} named twice")
    return tuple(names)
