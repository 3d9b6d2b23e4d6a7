"""Names that a user gives: each is known, and given once; that of a view set comes from its folder."""

import re
from pathlib import Path

from scenes.files.errors import InputError


def scene_name_of(view_set: Path) -> str:
    """Make a name for records from the folder's: letters, digits, `-` and `_` alone."""
    folder = view_set.resolve()
    name = folder.stem if folder.suffix in (".npz", ".json") and folder.is_file() else folder.name
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or "view-set"


def known_names(option: str, names: list[str], known: list[str]) -> tuple[str, ...]:
    """Return `names` as they are; raises `InputError` for one that is unknown or named twice."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"{option}: unknown {' '.join(map(repr, unknown))}; known: {' '.join(known)}")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"{option}: {' '.join(repeated)} named twice")
    return tuple(names)
