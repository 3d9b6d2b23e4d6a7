"""JSON files that outlive the process: written atomically, read strictly, checked against their types."""

import hashlib
import json
import math
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from scenes.files.atomic import write_atomically
from scenes.files.errors import DamagedRecord, shown
from scenes.files.json_object import JsonObject

DIGEST = "digest"
"""The last key of a record."""
LARGEST_FILE = 256 << 20
"""The maximum size of a record in bytes; a larger file is not read."""
REMEDY = "delete it and run again with --resume"


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A JSON file or a part of it; unknown keys and other types are refused."""


def finite_or_none(value: float | None) -> float | None:
    """Return `value` as a JSON number; None if it is missing, NaN or infinite."""
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def write_record(path: Path, record: object) -> None:
    """Write a `Record` or plain data as `write_json` does, with a digest of the content as the last key."""
    data = plain(record)
    if DIGEST in data:
        raise ValueError(f"{path}: {DIGEST!r} is a key of the file itself")
    write_json(path, {**data, DIGEST: digest_of(data)})


def load_record(path: Path) -> JsonObject:
    """Return the plain data that `write_record` wrote; raises `OSError`, and `ValueError` without the file's name."""
    return _load(path)[0]


def _load(path: Path) -> tuple[JsonObject, bool]:
    """Return the data, and whether they have a digest; raises `ValueError` if the digest is wrong."""
    data = load_json(path)
    if not isinstance(data, dict):
        raise ValueError(f"holds a {type(data).__name__}, not an object")
    claimed = data.pop(DIGEST, None)
    if claimed not in (None, digest_of(data)):
        raise ValueError("its digest does not match its content, so it was damaged or changed by hand")
    return data, claimed is not None


def load_json(path: Path) -> Any:
    """Read strict JSON of finite numbers; raises `OSError`, and otherwise `ValueError` without the file's name."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would block for ever
        raise ValueError("is not a file")
    if (size := status.st_size) > LARGEST_FILE:
        raise ValueError(f"has {size} bytes, more than the {LARGEST_FILE} of any record")
    try:
        return msgspec.json.decode(path.read_bytes())
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error


def digest_of(data: object) -> str:
    """Return the SHA-256 of keys and values in their order; raises `ValueError` on NaN or Infinity."""
    try:
        text = json.dumps(data, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    return hashlib.sha256(text.encode()).hexdigest()


def without_gaps(data: object) -> object:
    """Return plain data with sorted keys, without empty values: a later field does not change an older digest."""
    if isinstance(data, dict):
        values = {key: without_gaps(data[key]) for key in sorted(data)}
        return {key: value for key, value in values.items() if value is not None and value not in ({}, [])}
    return [without_gaps(value) for value in data] if isinstance(data, list | tuple) else data


def write_json(path: Path, data: object) -> None:
    """Write atomically, also under `kill -9`; raises `ValueError` on NaN or Infinity."""
    write_atomically(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False))


T = TypeVar("T")


def read_record(
    path: Path,
    kind: type[T],
    schema: int | None,
    formerly: tuple[str, ...] = (),
    remedy: str = REMEDY,
    by_hand: bool = False,
    former: Callable[[object], object] | None = None,
) -> T:
    """Read a record. Keys of earlier versions, `formerly`, are dropped, and `former` converts the data of an earlier
    version. Raises `DamagedRecord` for anything else, and without a digest unless it may be written `by_hand`.
    """
    try:
        data, sealed = _load(path)
        if (written := data.get("schema")) != schema:
            remedy = "run again into a fresh folder" if remedy == REMEDY else remedy
            raise ValueError(f"schema {shown(written)}, this version reads {schema}")
        data = {name: value for name, value in data.items() if name not in formerly}
        record = as_promised(former(data) if former else data, kind)
        if not (sealed or by_hand):
            raise ValueError("its digest is missing, so it was changed by hand")
        return record
    except RecursionError as error:
        raise DamagedRecord(f"{path}: is nested too deeply; {remedy}") from error
    except (OSError, ValueError) as error:
        raise DamagedRecord(f"{path}: {error}; {remedy}") from error


def plain(record: object) -> Any:
    """Return the content of `record` in JSON types."""
    return msgspec.to_builtins(record, enc_hook=_plain_scalar)


def flat(value: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Yield the values in nested objects one by one, with names joined by dots."""
    if not isinstance(value, dict):
        yield name, value
        return
    for key, inner in value.items():
        yield from flat(inner, f"{name}.{key}".strip("."))


def _plain_scalar(value: object) -> float | str:
    """Convert numpy's subclasses of `float` and `str` to the built-in types."""
    return float(value) if isinstance(value, float) else str.__str__(value)


def as_promised(data: object, kind: type[T]) -> T:
    """Return plain data as `kind`; raises `ValueError` that names the first value of a wrong type."""
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        text = str(error)
        raise ValueError(text if len(text) <= 400 else f"{text[:200]}…{text[-200:]}") from error
