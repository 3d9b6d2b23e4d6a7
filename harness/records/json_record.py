"""JSON files that outlive the process: written whole or not at all, read strictly, held to their types."""

import hashlib
import json
import math
import stat
import types
import typing
from collections.abc import Callable
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from scenes.files.atomic import write_atomically
from scenes.files.errors import readable

DIGEST = "digest"
"""The last key of a record."""
LARGEST_FILE = 256 << 20
"""Bytes of a record that is read."""


class DamagedRecord(ValueError):
    """A record file is not what this version writes: the message names the file, the reason and the remedy."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


def finite_or_none(value: float | None) -> float | None:
    """`value` as a JSON number, or None where it is missing, NaN or infinite."""
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def write_record(path: Path, data: dict[str, Any]) -> None:
    """As `write_json`, with the digest of everything else as the last key."""
    if DIGEST in data:
        raise ValueError(f"{path}: {DIGEST!r} is a key of the file itself")
    write_json(path, {**data, DIGEST: digest_of(data)})


def load_record(path: Path) -> dict[str, Any]:
    """What `write_record` was given, as JSON holds it. Raises `OSError`, and `ValueError` where the file is not an
    object of JSON or its digest is not that of its content; the message does not name the file."""
    data = load_json(path)
    if not isinstance(data, dict):
        raise ValueError(f"holds a {type(data).__name__}, not an object")
    claimed = data.pop(DIGEST, None)
    if claimed not in (None, digest_of(data)):
        raise ValueError("its digest does not match its content, so it was damaged or changed by hand")
    return data


def load_json(path: Path) -> Any:
    """Strict JSON of finite numbers. Raises `OSError`, and `ValueError`, which does not name the file, for anything
    else, however deeply it is nested and however large it is."""
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):  # a pipe would keep us waiting for ever
        raise ValueError("is no file")
    if (size := found.st_size) > LARGEST_FILE:
        raise ValueError(f"has {size} bytes, more than the {LARGEST_FILE} of any record")
    try:
        text = path.read_text(encoding="utf-8")
        data = json.loads(text, parse_constant=_refuse)
        digest_of(data)  # a number like 1e999 is read as infinity
        if "\\ud" in text.lower():  # half of a character, which no file and no page can hold
            json.dumps(data, ensure_ascii=False).encode()
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    return data


def as_text(text: str) -> str:
    """With the halves of characters written out, which a name that is not UTF-8 has and no file can hold."""
    return text.encode(errors="backslashreplace").decode()


def shown(value: Any) -> str:
    """A value in a message, which it must not make endless."""
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"


def digest_of(data: Any) -> str:
    """SHA-256, hexadecimal, of the keys and values in their order, however they are spaced; raises `ValueError` on NaN
    or Infinity."""
    text = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256, hexadecimal, of a file's bytes; raises `OSError`."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no number of JSON")


def write_json(path: Path, data: Any) -> None:
    """Whole or not at all, also under `kill -9`; raises `ValueError` on NaN or Infinity."""
    write_atomically(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))


def read_record(path: Path, kind: type, schema: int, formerly: tuple[str, ...] = ()) -> dict[str, Any]:
    """The fields of a dataclass `kind` as they were written; those with a default may be missing, those that
    were there `formerly` are left out.

    Raises `DamagedRecord` for anything else.
    """
    try:
        data = load_record(path)
    except (OSError, ValueError) as error:
        raise damaged(path, error) from error
    if data.get("schema") != schema:
        found = shown(data.get("schema"))
        raise DamagedRecord(f"{path}: schema {found}, this version reads {schema}; run again into a fresh folder")
    data = {name: value for name, value in data.items() if name not in formerly}
    known = {one.name for one in fields(kind)}
    needed = {one.name for one in fields(kind) if one.default is MISSING and one.default_factory is MISSING}
    if wrong := sorted((set(data) - known) | (needed - set(data))):
        raise DamagedRecord(f"{path}: unexpected or missing keys {shown(wrong)}; delete it and run again with --resume")
    return data


def damaged(path: Path, why: Exception) -> DamagedRecord:
    return DamagedRecord(f"{path}: {why}; delete it and run again with --resume")


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
