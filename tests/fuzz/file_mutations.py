"""Files whose parts are spoilt one by one: archives, XML, Python, lines, and folders of which files are away, cut off,
changed, turned into links and other things; `tests.fuzz.mutations` has what is in them.
"""

import contextlib
import copy
import io
import json
import os
import re
import shutil
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.mutations import NUMBERS, TEXTS, of_bytes, of_json, of_safetensors
from tests.fuzz.seals import closed, opened

SHAPES = (
    "()", "(0,)", "(-1, 4, 4)", "(1,)", "(2, 4, 4)", "(10, 4, 4)", "(10, 8, 16, 3)", "(10, 8, 16, 4)", "(10, 8, 16)",
    "(10, 0, 16, 3)", "(99999999999, 8, 16, 3)", "(10, 100000, 100000, 3)", "(2**70, 4)", "(1.5, 4)", "None", "'x'",
    "(True, 4, 4)", "(" * 300, "(10, 8, 16, 3),) + (",
)  # fmt: skip
KINDS = (
    "<f4", "<f8", "<f2", ">f4", "|O", "|u1", "<i8", "<u8", "|b1", "<c8", "|S9", "<U4", "<M8[s]", "|V8", "f4,f4", "",
    "x",
)  # fmt: skip
XML_VALUES = (
    "", "0", "-1", "1e400", "nan", "inf", "1, 0", "0, 0, 0", "nan, 1, 0", "1 2 3 4", "$table", "$", "$x", "a" * 5000,
    "mine.xml", "parts.xml", "..", "/", "/etc/passwd", "/dev/zero", "\0", "true", "9" * 400, "²", "٣", "\ud800",
    "../../x", "x" * 300,
)  # fmt: skip
TAGS = (
    "scene", "shape", "bsdf", "emitter", "medium", "texture", "ref", "default", "include", "string", "float", "rgb",
    "integrator", "integer", "sensor", "transform", "lookat", "x", "spectrum", "volume", "phase", "alias", "path",
)  # fmt: skip
KEYS = ("id", "name", "value", "type", "filename", "up", "version")
CODE = (
    "None", "0", "-1", "1e400", "float('nan')", "float('inf')", "'x'", "''", "[]", "{}", "()", "1/0", "b'x'", "set()",
    "...", "object()", "lambda: None", "10**400", "True", "np.zeros(3)", "np.zeros((0, 3))",
    "np.full((4, 4), np.nan)", "[1]", "np.array(['x'])", "np.eye(3)", "range(3)", "'../../x'", "'\\x1b[31m'",
    "'\\ud800'", "'a' * 5000", "'mesh'", "'sphere'", "'envmap'", "'bitmap'", "'cube'", "1e-30", "1e30", "build",
    "SCENE", "Scene", "exit(3)", "(_ for _ in ())", "[[1, 2], [3]]", "1j", "{1: 2}", "{'type': 'mesh'}",
    "{'type': None}", "{'type': []}",
)  # fmt: skip

VALUE = re.compile(r"\"[^\"\n]*\"|\[[^][\n]*\]|\b\d+\.?\d*\b|\b(?:to_world|build|height|colour|turn)\b")


def of_listed(random: Random, valid: bytes) -> bytes:
    """Of a file of `harness.records.pictures`: the listing in the header, or the values, or the file as it comes."""
    words = (b"\0\x7c", b"\0\xfc", b"\0\x7e", b"\xff\x7b", b"\xff\xfb", b"\1\0", b"\0\0")
    if random.randrange(3) == 0:
        return of_safetensors(random, valid)
    header, rest = opened(valid)
    if random.randrange(4):
        ((key, listing),) = header["__metadata__"].items()
        header["__metadata__"][key] = of_json(random, listing.encode()).decode("utf-8", "replace")
    else:
        changed = bytearray(rest)
        for _ in range(1 + random.randrange(4)):
            at = 2 * random.randrange(len(changed) // 2)
            changed[at : at + 2] = random.choice(words)
        rest = bytes(changed)
    return closed(header, rest)


def of_npz(random: Random, valid: bytes) -> bytes:
    """Remove, exchange and double arrays of the archive, or give them other shapes and bytes; checksums are right."""
    if random.randrange(5) == 0:
        return of_bytes(random, valid)
    with zipfile.ZipFile(io.BytesIO(valid)) as archive:
        members = [(name, archive.read(name)) for name in archive.namelist()]
    for _ in range(1 + random.randrange(3)):
        at = random.randrange(len(members))
        name, data = members[at]
        kind = random.randrange(8)
        if kind == 0 and len(members) > 1:
            del members[at]
        elif kind == 1:
            members[at] = name, random.choice(members)[1]
        elif kind == 2:
            members.append((random.choice((name, "alpha.npy", "bounds.npy", "i_train.npy", "../x.npy", "x")), data))
        elif kind in (3, 4):
            members[at] = name, _other_header(random, data)
        else:
            members[at] = name, of_bytes(random, data)
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
        for name, data in {name: data for name, data in members}.items():
            archive.writestr(name, data)
    return made.getvalue()


def _other_header(random: Random, data: bytes) -> bytes:
    length = int.from_bytes(data[8:10], "little")
    header = data[10 : 10 + length].decode("latin-1")
    if random.randrange(2):
        header = re.sub(r"'shape': \([^)]*\)", lambda _: f"'shape': {random.choice(SHAPES)}", header)
    else:
        header = re.sub(r"'descr': '[^']*'", lambda _: f"'descr': {random.choice(KINDS)!r}", header)
    if random.randrange(8) == 0:
        header = header.replace("False", random.choice(("True", "1", "None", "x")))
    text = header.encode("latin-1")[:65535]
    return data[:8] + len(text).to_bytes(2, "little") + text + data[10 + length :]


def of_xml(random: Random, valid: bytes) -> bytes:
    """1 to 4 elements changed, or the text."""
    if random.randrange(6) == 0:
        return of_bytes(random, valid)
    root = ET.fromstring(valid)
    for _ in range(1 + random.randrange(4)):
        every = list(root.iter())
        element, other = random.choice(every), random.choice(every)
        kind = random.randrange(9)
        if kind == 0 and len(element):
            element.remove(random.choice(list(element)))
        elif kind == 1:
            with contextlib.suppress(RecursionError):  # what was nested before may be too deep to copy
                element.append(copy.deepcopy(other))
        elif kind == 2:
            element.tag = random.choice(TAGS)
        elif kind == 3:
            attributes = {key: random.choice(XML_VALUES) for key in random.sample(KEYS, 3)}
            element.insert(0, ET.Element(random.choice(TAGS), attributes))
        elif kind == 4 and element.attrib:
            del element.attrib[random.choice(list(element.attrib))]
        elif kind == 5 and random.randrange(10) == 0:
            inner = element
            for _ in range(random.choice((20, 900, 5000))):
                inner = ET.SubElement(inner, random.choice(("shape", "bsdf", "x")), {"type": "sphere"})
        else:
            key = random.choice([*element.attrib, random.choice(KEYS)])
            element.attrib[key] = random.choice((*XML_VALUES, random.choice(TEXTS), str(random.choice(NUMBERS[:20]))))
    try:
        return ET.tostring(root, encoding="unicode").encode("utf-8", "surrogatepass")
    except RecursionError:
        return b"<scene>" + b"<shape>" * 100_000


def of_python(random: Random, valid: bytes) -> bytes:
    """Values of a program are others; of what it could do, there is nothing that anybody need fear."""
    if random.randrange(10) == 0:
        return of_bytes(random, valid)
    text = valid.decode()
    for _ in range(1 + random.randrange(3)):
        values = list(VALUE.finditer(text))
        if not values:
            break
        value = random.choice(values)
        text = text[: value.start()] + random.choice(CODE) + text[value.end() :]
    return text.encode("utf-8", "surrogatepass")


def of_lines(random: Random, valid: bytes) -> bytes:
    """Of JSON lines: one or two changed, doubled, away, cut."""
    lines = valid.split(b"\n")
    for _ in range(1 + random.randrange(2)):
        full = [at for at, line in enumerate(lines) if line.startswith(b"{")]
        if not full or random.randrange(8) == 0:
            return of_bytes(random, b"\n".join(lines))
        at, kind = random.choice(full), random.randrange(6)
        if kind == 0:
            del lines[at]
        elif kind == 1:
            lines[at] = lines[at][: random.randrange(len(lines[at]))]
        else:
            try:
                lines[at] = of_json(random, lines[at]).replace(b"\n", b" ")
            except (ValueError, RecursionError):  # a change before this one made it no JSON, or too deep a one
                lines[at] = of_bytes(random, lines[at])
    return b"\n".join(lines)


def of_points(random: Random, valid: bytes) -> bytes:
    """An `entry_points.txt`: names and values that nobody would choose."""
    if random.randrange(6) == 0:
        return of_bytes(random, valid)
    names = ("mine", "nerf", "qnerf", "", " ", "a b", "é", "x" * 300, "../x", "[x]", "#", "mine = other")
    values = (
        "fuzzed_method:METHOD", "fuzzed_method:NOTHING", "fuzzed_method", "fuzzed_method:WRONG", "nothing.there:X",
        ":", "", "fuzzed_method:METHOD.title", "fuzzed_method:ended", "os:environ", "..x:y", "é:é", "x" * 400,
        "a:b:c", "fuzzed_method:METHOD [extra]", "fuzzed_broken:METHOD", "fuzzed_ending:METHOD",
    )  # fmt: skip
    lines = valid.decode().splitlines()
    for _ in range(1 + random.randrange(3)):
        lines.insert(random.randrange(len(lines) + 1), f"{random.choice(names)} = {random.choice(values)}")
    if random.randrange(6) == 0:
        del lines[random.randrange(len(lines))]
    return "\n".join(lines).encode("utf-8", "surrogatepass")


OF_FILES = ("cut", "flip", "write", "swap", "large")
LINKS = ("/etc/hostname", "/dev/null", "/proc/self/mem", "/", ".", "..", "loop", "nothing there", "../../outside")


def of_folder(random: Random, valid: bytes) -> bytes:
    """1 to 3 changes, as a JSON list of [what, where, with what]; places are indices into the sorted paths."""
    changes = []
    for _ in range(1 + random.randrange(3)):
        what = random.choice(list(FOLDER_CHANGES))
        with_what: Any = random.randrange(1 << 16)
        if what == "link":
            with_what = random.choice(LINKS)
        elif what in ("write", "rename", "add"):
            with_what = random.choice(TEXTS)
        changes.append([what, random.randrange(1 << 16), with_what])
    return json.dumps(changes).encode()


def place_changes(folder: Path, file: str, data: bytes) -> None:
    """Makes the changes in a fresh copy of the folder; what cannot be done is left out."""
    for what, where, with_what in json.loads(data):
        # never through a link, which may lead anywhere
        paths = sorted(path for path in folder.rglob("*") if path.exists() and not path.is_symlink())
        paths = [path for path in paths if path.is_file() or (path.is_dir() and what not in OF_FILES)]
        if not paths:
            return
        with suppress(OSError, ValueError, ArithmeticError):
            FOLDER_CHANGES[what](paths[where % len(paths)], with_what)


def _remove(path: Path, _: Any) -> None:
    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _link(path: Path, to: str) -> None:
    _remove(path, None)
    path.symlink_to(path.name if to == "loop" else to)


def _flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 1 + at % 255
    path.write_bytes(bytes(data))


def _rename(path: Path, name: str) -> None:
    inside = path.parent / name.replace("/", "_")
    path.rename(inside if inside.parent == path.parent else path)


def _add(path: Path, name: str) -> None:
    (path.parent / f"{name.replace('/', '_')[:200]}{path.suffix}").write_bytes(b"{}")


def _swap(path: Path, other: int) -> None:
    beside = sorted(file for file in path.parent.iterdir() if file.is_file() and not file.is_symlink())
    path.write_bytes(beside[other % len(beside)].read_bytes())


FOLDER_CHANGES: dict[str, Callable[[Path, Any], object]] = {
    "remove": _remove,
    "link": _link,
    "pipe": lambda path, _: (_remove(path, None), os.mkfifo(path)),
    "folder": lambda path, _: (_remove(path, None), path.mkdir()),
    "cut": lambda path, length: os.truncate(path, length % (path.stat().st_size + 1)),
    "flip": _flip,
    "write": lambda path, text: path.write_text(text, encoding="utf-8", errors="surrogatepass"),
    "rename": _rename,
    "add": _add,
    "swap": _swap,
    "large": lambda path, size: os.truncate(path, 60 * (1 << 20) + size),
}
