"""JSON files that outlive the process: written whole or not at all, read strictly.

JSON here never holds NaN or Infinity: a number that is not finite is `None`, and a status says why. The last key of a
record is the digest of all the others, so that a damaged file is told from one that says something else; `None` where
there is none, in files of an earlier version.
"""

import hashlib
import json
import math
import os
import stat
from contextlib import suppress
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from scenes.errors import readable

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
    write_whole(path, json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False).encode("utf-8"))


def write_whole(path: Path, data: bytes) -> None:
    """Whole or not at all, also under `kill -9`; raises `OSError`, naming the file, where it cannot be written."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        # a failed write does not say of which file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):  # what went wrong before is what is said
            beside.unlink()


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
