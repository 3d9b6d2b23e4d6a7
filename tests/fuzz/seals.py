"""Checksums of a spoilt file put right again, so that what stands behind their check is reached as well.

Each gives back what it was given where that is too far from such a file to have a checksum.
"""

import base64
import hashlib
import json
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.numpy import load

from harness.records.json_record import DIGEST, digest_of
from harness.records.pictures import digest_of as pictures_digest
from scenes.files.digest import json_digest

NO_SUCH_FILE = (ValueError, TypeError, KeyError, AttributeError, RecursionError)


def same(data: bytes) -> bytes:
    return data


def png_sealed(data: bytes) -> bytes:
    """With the right checksum after each chunk."""
    sealed, start = bytearray(data[:8]), 8
    while start + 12 <= len(data):
        length = min(int.from_bytes(data[start : start + 4], "big"), len(data) - start - 12)
        body = data[start + 4 : start + 8 + length]
        sealed += length.to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
        start += 12 + length
    return bytes(sealed)


def _sealed(data: bytes, key: str, digest: Callable[[Any], str]) -> bytes:
    """JSON with the right digest under that key."""
    try:
        content = json.loads(data)
        content.pop(key, None)
        return json.dumps({**content, key: digest(content)}).encode()
    except NO_SUCH_FILE:
        return data


manifest_sealed = partial(_sealed, key="checksum", digest=json_digest)
record_sealed = partial(_sealed, key=DIGEST, digest=digest_of)
"""Seals a file of `harness.records.json_record.write_record`."""


def occupancy_sealed(data: bytes) -> bytes:
    def digest(content: dict[str, Any]) -> str:
        plain = {key: value for key, value in content.items() if key != "inside"}
        return json_digest(plain, base64.b64decode(content["inside"]))

    return _sealed(data, "checksum", digest)


def journal_sealed(data: bytes) -> bytes:
    """Every line of `scenes.view_sets.manifest` that is one."""
    return b"\n".join(_sealed(line, "digest", json_digest) for line in data.split(b"\n"))


def listed_sealed(data: bytes) -> bytes:
    """A file of `harness.records.pictures` whose tensors can be read."""
    try:
        header, rest = opened(data)
        ((key, text),) = header["__metadata__"].items()
        listing = json.loads(text)
        listing.pop("digest", None)
        listing["digest"] = pictures_digest(listing, load(data))
        header["__metadata__"][key] = json.dumps(listing)
        return closed(header, rest)
    except (*NO_SUCH_FILE, SafetensorError):
        return data


def opened(data: bytes) -> tuple[Any, bytes]:
    """The header of a safetensors file, and its tensors."""
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def closed(header: Any, rest: bytes) -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + rest


def place_listed(folder: Path, file: str, data: bytes) -> None:
    """Overwrites a file of a view set of ours, and its checksum in the manifest."""
    (folder / file).write_bytes(data)
    manifest = json.loads((folder / "view_set.json").read_bytes())
    manifest["files"][file] = hashlib.sha256(data).hexdigest()
    (folder / "view_set.json").write_bytes(manifest_sealed(json.dumps(manifest).encode()))


def place_tried(folder: Path, file: str, data: bytes) -> None:
    """Under a name of its own, with the suffix of what it was made of."""
    for other in folder.glob("tried.*"):
        other.unlink()
    (folder / f"tried{Path(file).suffix}").write_bytes(data)
