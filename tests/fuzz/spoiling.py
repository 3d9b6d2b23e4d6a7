"""Strategies: bytes of a valid file → bytes that may be wrong, with corrected checksums.

A JSON file is changed as a value, a text by its tokens, an archive by its members, other files by bytes.
"""

import base64
import copy
import hashlib
import io
import json
import re
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from safetensors import SafetensorError
from safetensors.numpy import load

from harness.records.json_record import digest_of
from harness.records.pictures import digest_of as pictures_digest
from scenes.files.digest import json_digest

CODE = "<script>alert(1)</script>"
NASTY = (
    "", "\0", "a\nb", "../../etc/passwd", "/etc/passwd", "..", "C:\\x", "~root/x", "file:///etc/passwd", "\u202egnp",
    "\ud800", CODE, "x" * 300, "x" * 100_000, "%s%n", "{0}", "nan", "-1", "--help", "all", "nerf", "./train/r_0",
    "/dev/zero", "\x1b[31m", "$(id)", "'", "\\", "²",
)  # fmt: skip
TEXTS = st.sampled_from(NASTY) | st.text(max_size=8)
WHOLE = st.integers(-3, 300) | st.sampled_from((2**31, 2**53 + 1, 2**63, 2**64, 10**18, -(2**63), 10**400))
FINITE = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-2.0, 2.0)
VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | WHOLE | st.floats() | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=2),
    max_leaves=6,
)
TOKEN = re.compile(rb'"[^"\n]*"|[\w.$-]+|[^\w\s]|\n')
WORDS = (
    *(text.encode("utf-8", "surrogatepass") for text in NASTY),
    b"[" * 100_000, b'{"a":' * 50_000, b"<shape>" * 5000, b"1" * 5000, b"NaN", b"1e99999", b"tru", b"\xef\xbb\xbf",
    b"None", b"-1", b"1/0", b"[]", b"()", b"object()", b"exit(3)", b"float('nan')", b"{'type': []}", b"$where",
    b"0, 0, 0", b"mine.xml", b"parts.xml", b"ref", b"include", b"default", b"(2**70, 4)", b"(-1, 4, 4)", b"|O", b":",
    b"(10, 100000, 100000, 3)", b"<M8[s]", b"nothing.there:X", b"a:b:c", b"os:environ", b"fuzzed_broken:METHOD",
    b"fuzzed_ending:METHOD", b"fuzzed_method:WRONG",
)  # fmt: skip
BITS = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\x80", b"\0\x7c\0\xfc", b"\xff\x7b", bytes(16))


def _like(value: Any) -> st.SearchStrategy[Any]:
    if isinstance(value, bool):
        return st.just(not value)
    if isinstance(value, str):
        return TEXTS.map(value.__add__) | TEXTS
    if isinstance(value, int):
        return st.sampled_from((-value, value + 1, value - 1)) | WHOLE
    if isinstance(value, float) or value is None:
        return st.sampled_from((-(value or 1.0), 1.5 * (value or 1.0))) | FINITE
    return st.sampled_from((value * 2, value[::-1], [value], [])) if isinstance(value, list) else st.just({})


@st.composite
def _edited(draw: st.DrawFn, value: Any) -> Any:
    """Draw a copy with one element changed, left out, or replaced by a neighbour."""
    if not isinstance(value, dict | list) or not value or draw(st.integers(0, 5)) == 5:
        return draw(_like(value) | _like(value) | VALUES)
    changed, keys = copy.copy(value), st.sampled_from([*value] if isinstance(value, dict) else range(len(value)))
    key, how = draw(keys), draw(st.sampled_from(("deeper", "deeper", "deeper", "deeper", "left out", "exchanged")))
    if how == "deeper":
        changed[key] = draw(_edited(value[key]))
    elif how == "exchanged":
        changed[key] = value[draw(keys)]
    else:
        del changed[key]
    return changed


@st.composite
def _in_json(draw: st.DrawFn, valid: bytes) -> bytes:
    value = json.loads(valid)
    for _ in range(draw(st.integers(1, 3))):
        value = draw(_edited(value))
    return json.dumps(value, ensure_ascii=False).encode("utf-8", "surrogatepass")


@st.composite
def in_text(draw: st.DrawFn, valid: bytes) -> bytes:
    """Leave out or double consecutive tokens, or replace them by another token or a word."""
    for _ in range(draw(st.integers(1, 3))):
        tokens = list(TOKEN.finditer(valid))
        if not tokens:
            break
        first = draw(st.integers(0, len(tokens) - 1))
        last = min(first + draw(st.sampled_from((0, 0, 0, 1, 8, 30))), len(tokens) - 1)
        start, end = tokens[first].start(), tokens[last].end()
        new = draw(st.sampled_from((b"", valid[start:end] * 2)) | st.sampled_from(WORDS)
                   | st.sampled_from(tokens).map(re.Match.group))  # fmt: skip
        if tokens[first][0][:1] == b'"' != new[:1]:
            new = b'"' + new + b'"'
        valid = valid[:start] + new + valid[end:]
    return valid


@st.composite
def in_bytes(draw: st.DrawFn, valid: bytes) -> bytes:
    """Leave out, insert or replace bytes; half of the time in the header."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, min(len(valid), 400)) | st.integers(0, len(valid)))
        new = draw(st.binary(max_size=4) | st.sampled_from((*BITS, valid[at : at + 64])))
        # mostly the same number of bytes, as otherwise only the wrong length would be detected
        end = at + draw(st.sampled_from((len(new), len(new), len(new), 0, 1, 64, len(valid))))
        valid = valid[:at] + new + valid[end:]
    return valid


@st.composite
def _in_tensors(draw: st.DrawFn, valid: bytes) -> bytes:
    """Change the listing in the header of a safetensors file, the header itself, or its values."""
    header, rest = opened(valid)
    for key, listing in header.get("__metadata__", {}).items():
        if draw(st.booleans()):
            header["__metadata__"][key] = draw(_in_json(listing.encode())).decode("utf-8", "surrogatepass")
            return closed(header, rest)
    return closed(draw(_edited(header)), rest) if draw(st.booleans()) else closed(header, draw(in_bytes(rest)))


@st.composite
def _in_archive(draw: st.DrawFn, valid: bytes) -> bytes:
    """Leave out an array of an .npz file, or change its header or its bytes; checksums are correct."""
    arrays = members(valid)
    name, how = draw(st.sampled_from(sorted(arrays))), draw(st.integers(0, 4))
    data = arrays.pop(name)
    start = 10 + int.from_bytes(data[8:10], "little")
    if how == 1:
        arrays[name] = draw(in_bytes(data))
    elif how > 1:
        header = draw(in_text(data[10:start]))[:65535]
        arrays[name] = data[:8] + len(header).to_bytes(2, "little") + header + data[start:]
    return archived(arrays)


def members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def archived(arrays: dict[str, bytes]) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, data in arrays.items():
            archive.writestr(name, data)
    return made.getvalue()


def opened(data: bytes) -> tuple[Any, bytes]:
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def closed(header: Any, rest: bytes) -> bytes:
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + rest


WAYS: dict[str, tuple[Callable[[bytes], st.SearchStrategy[bytes]], ...]] = {
    ".json": (_in_json, _in_json, _in_json, in_text),
    ".safetensors": (_in_tensors, _in_tensors, _in_tensors),
    ".npz": (_in_archive, _in_archive, _in_archive),
    **dict.fromkeys((".jsonl", ".csv", ".xml", ".py", ".txt"), (in_text, in_text, in_text)),
}


def spoilt(file: Path) -> st.SearchStrategy[bytes]:
    valid = file.read_bytes()
    return st.one_of(*(way(valid) for way in (*WAYS.get(file.suffix, ()), in_bytes)))


# --- checksums


def reseal(folder: Path, file: Path) -> None:
    """Correct the checksums in the file, and that of the file in the manifest of its folder, so that the code behind
    the checksums is tested too. A file without the expected structure is not changed.
    """
    data = file.read_bytes()
    with suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError, SafetensorError):
        if file.suffix == ".json":
            data = _json_sealed(data)
        elif file.suffix == ".jsonl":
            data = b"\n".join(_json_sealed(line, json_digest) if line.strip() else line for line in data.splitlines())
        elif file.suffix == ".safetensors":
            data = _listing_sealed(data)
        elif file.suffix == ".png":
            data = png_sealed(data)
        file.write_bytes(data)
        if (manifest := folder / "view_set.json").exists() and manifest != file:
            content = json.loads(manifest.read_bytes())
            content["files"][file.relative_to(folder).as_posix()] = hashlib.sha256(data).hexdigest()
            manifest.write_bytes(_json_sealed(json.dumps(content).encode()))


def _json_sealed(data: bytes, digest: Callable[[Any], str] = digest_of) -> bytes:
    """Return a record, a line of a journal, a manifest or an occupancy with the right digest."""
    content = json.loads(data)
    if content.pop("checksum", None) is not None:  # such a file may hold the digest of another file
        more = [base64.b64decode(content["inside"])] if "inside" in content else []
        plain = {key: value for key, value in content.items() if key != "inside"}
        return json.dumps({**content, "checksum": json_digest(plain, *more)}).encode()
    if content.pop("digest", None) is not None:
        return json.dumps({**content, "digest": digest(content)}).encode()
    return data


def _listing_sealed(data: bytes) -> bytes:
    header, rest = opened(data)
    ((key, text),) = header["__metadata__"].items()
    listing = json.loads(text)
    listing.pop("digest")
    header["__metadata__"][key] = json.dumps({**listing, "digest": pictures_digest(listing, load(data))})
    return closed(header, rest)


def png_sealed(data: bytes) -> bytes:
    sealed, start = bytearray(data[:8]), 8
    while start + 12 <= len(data):
        length = min(int.from_bytes(data[start : start + 4], "big"), len(data) - start - 12)
        body = data[start + 4 : start + 8 + length]
        sealed += length.to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
        start += 12 + length
    return bytes(sealed)
