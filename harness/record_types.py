"""Whether what was read is what the types of a record promise: JSON by itself promises nothing.

This module imports the standard library and `harness.json_record` alone, as reports read records as well.
"""

import math
import types
import typing
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import cache
from typing import Any, TypeVar

from harness.json_record import shown

One = TypeVar("One")


def sound(value: One, hint: Any) -> One:
    """`value`, if it is what `hint` promises; raises `ValueError` with the first place where it is not."""
    wrong = first_mismatch(value, hint)
    if wrong is not None:
        raise ValueError(wrong if len(wrong) <= 400 else f"{wrong[:399]}…")
    return value


def first_mismatch(value: Any, hint: Any, where: str = "") -> str | None:
    """The first place where `value` is not what `hint` promises, or a number is not finite; None where all is well."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    here = where or "the record"
    if hint is Any:
        return _first_not_finite(value, here)
    if is_dataclass(hint):
        if not isinstance(value, typing.cast(type, hint)):
            return f"{here} is not a {getattr(hint, '__name__', hint)}"
        hints = _hints(typing.cast(type, hint))
        found = (first_mismatch(getattr(value, name), of, f"{where}.{name}".strip(".")) for name, of in hints.items())
        return next((wrong for wrong in found if wrong), None)
    if origin in (types.UnionType, typing.Union):
        wrong = [first_mismatch(value, part, where) for part in parts if part is not type(None)]
        return None if (value is None and type(None) in parts) or None in wrong else wrong[0]
    if origin is typing.Literal:
        return None if value in parts else f"{here} is {shown(value)}, not one of {', '.join(map(str, parts))}"
    if origin is list:
        return _first_in(value, list, lambda: [(f"{where}[{i}]", one, parts[0]) for i, one in enumerate(value)], here)
    if origin is dict:
        return _first_in(value, dict, lambda: [(f"{where}.{key}", one, parts[1]) for key, one in value.items()], here)
    if origin is tuple:
        if not isinstance(value, tuple) or len(value) != len(parts):
            return f"{here} is not a pair of numbers"
        return _first_in(
            value, tuple, lambda: [(where, one, part) for one, part in zip(value, parts, strict=True)], here
        )
    return _scalar_mismatch(value, hint, here)


def _first_in(value: Any, kind: type, items: Callable[[], list[tuple[str, Any, Any]]], here: str) -> str | None:
    if not isinstance(value, kind):
        return f"{here} is {type(value).__name__}, not {kind.__name__}"
    found = (first_mismatch(one, hint, where.strip(".")) for where, one, hint in items())
    return next((wrong for wrong in found if wrong), None)


def _scalar_mismatch(value: Any, hint: type, here: str) -> str | None:
    accepted: tuple[type, ...] = (int, float) if hint is float else (hint,)
    if not isinstance(value, accepted) or (isinstance(value, bool) and hint is not bool):
        return f"{here} is {shown(value)}, not {hint.__name__}"
    return _first_not_finite(value, here)


def _first_not_finite(value: Any, here: str) -> str | None:
    if isinstance(value, float) and not math.isfinite(value):
        return f"{here} is {value}, which no record may hold"
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return next((wrong for one in inner if (wrong := _first_not_finite(one, here))), None)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)
