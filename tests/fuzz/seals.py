"""Checksums of a spoilt file put right again, so that what stands behind their check is reached as well.

Each gives back what it was given where that is too far from such a file to have a checksum.
"""

import base64
import hashlib
import json
import zlib
from pathlib import Path
from typing import Any


def same(data: bytes) -> bytes:
    return data


def png_sealed(data: bytes) -> bytes:
    """With the right checksum after each chunk."""
    found, start = bytearray(data[:8]), 8
    while start + 12 <= len(data):
        length = min(int.from_bytes(data[start : start + 4], "big"), len(data) - start - 12)
        body = data[start + 4 : start + 8 + length]
        found += length.to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
        start += 12 + length
    return bytes(found)


def manifest_sealed(data: bytes) -> bytes:
    try:
        content = json.loads(data)
        content.pop("checksum", None)
        own = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        return json.dumps({**content, "checksum": own}).encode()
    except (ValueError, TypeError, AttributeError, RecursionError):
        return data


def record_sealed(data: bytes) -> bytes:
    """A file of `harness.records.json_record.write_record`."""
    from harness.records.json_record import DIGEST, digest_of

    try:
        content = json.loads(data)
        content.pop(DIGEST, None)
        return json.dumps({**content, DIGEST: digest_of(content)}).encode()
    except (ValueError, TypeError, AttributeError, RecursionError):
        return data


def occupancy_sealed(data: bytes) -> bytes:
    try:
        content = json.loads(data)
        content.pop("checksum", None)
        plain = {key: value for key, value in content.items() if key != "inside"}
        bits = base64.b64decode(content["inside"])
        own = hashlib.sha256(json.dumps(plain, sort_keys=True).encode() + bits).hexdigest()
        return json.dumps({**content, "checksum": own}).encode()
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return data


def journal_sealed(data: bytes) -> bytes:
    """Every line of `scenes.view_sets.manifest` that is one."""
    return b"\n".join(_line_sealed(line) for line in data.split(b"\n"))


def _line_sealed(line: bytes) -> bytes:
    try:
        content = json.loads(line)
        content.pop("digest", None)
        own = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        return json.dumps({**content, "digest": own}).encode()
    except (ValueError, TypeError, AttributeError, RecursionError):
        return line


def listed_sealed(data: bytes) -> bytes:
    """A file of `harness.records.pictures` whose tensors can be read."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    from harness.records.pictures import digest_of

    try:
        header, rest = opened(data)
        ((key, text),) = header["__metadata__"].items()
        listing = json.loads(text)
        listing.pop("digest", None)
        listing["digest"] = digest_of(listing, load(data))
        header["__metadata__"][key] = json.dumps(listing)
        return closed(header, rest)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, SafetensorError):
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
