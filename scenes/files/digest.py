"""Hashes of files and of plain data: equal for equal data, different for different data."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np


def digest_of(value: object) -> str:
    """Return the SHA-256 of nested plain data and arrays; the order of keys counts."""
    state = hashlib.sha256()
    for piece in _pieces(value):
        state.update(piece)
    return state.hexdigest()


def file_digest(file: Path) -> str:
    """Return the SHA-256 of a file's bytes; raises `OSError`."""
    with file.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def json_digest(value: object, more: bytes = b"") -> str:
    """Return the SHA-256 of JSON data, independent of the order of its keys, and of the bytes `more` after it."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode() + more).hexdigest()


def _pieces(value: object) -> Iterator[bytes]:
    """Yield self-delimiting bytes: each piece states its type and length, so different values give different bytes."""
    if isinstance(value, dict):
        yield f"dict {len(value)}\n".encode()
        for key, inner in value.items():
            yield from _pieces(key)
            yield from _pieces(inner)
    elif isinstance(value, list | tuple):
        yield f"list {len(value)}\n".encode()
        for inner in value:
            yield from _pieces(inner)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        yield f"array {value.dtype.str} {value.shape}\n".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, np.generic):
        yield from _pieces(value.item())
    elif value is None or isinstance(value, bool | int | float | str):
        text = repr(value).encode()
        yield f"{type(value).__name__} {len(text)}\n".encode()
        yield text
    else:
        raise TypeError(f"a {type(value).__name__} is not plain data, so it cannot be hashed")
