"""JSON objects: the type of those whose values are checked where they are read, and objects with repeated keys."""

from typing import Any

JsonObject = dict[str, Any]


def each_key_once(pairs: list[tuple[str, Any]]) -> JsonObject:
    """As `object_pairs_hook` of `json.loads`, raise `ValueError` for a repeated key, whose last value readers take."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(name for name in names if names.count(name) > 1)!r} is given twice; keep one of them")
    return content
