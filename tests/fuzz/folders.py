"""Folders that are not as they were: files away, cut off, changed, turned into links and other things.

An input is a JSON list of [what, where, with what]; places are numbers, as an index into the sorted paths.
"""

import json
import os
import shutil
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.mutations import TEXTS

OF_FILES = ("cut", "flip", "write", "swap", "large")
LINKS = ("/etc/hostname", "/dev/null", "/proc/self/mem", "/", ".", "..", "loop", "nothing there", "../../outside")


def mutate(random: Random, valid: bytes) -> bytes:
    """1 to 3 changes."""
    changes = []
    for _ in range(1 + random.randrange(3)):
        what = random.choice(list(CHANGES))
        with_what: Any = random.randrange(1 << 16)
        if what == "link":
            with_what = random.choice(LINKS)
        elif what in ("write", "rename", "add"):
            with_what = random.choice(TEXTS)
        changes.append([what, random.randrange(1 << 16), with_what])
    return json.dumps(changes).encode()


def place(folder: Path, file: str, data: bytes) -> None:
    """Makes the changes in a fresh copy of the folder; what cannot be done is left out."""
    for change in json.loads(data):
        what, where, with_what = change
        paths = sorted(path for path in folder.rglob("*") if path.is_dir() or path.is_file())
        # never through a link, which may lead anywhere
        paths = [path for path in paths if not path.is_symlink()]
        if what in OF_FILES:
            paths = [path for path in paths if path.is_file()]
        if not paths:
            return
        with suppress(OSError, ValueError, ArithmeticError):
            CHANGES[what](paths[where % len(paths)], with_what)


def _remove(path: Path, _: Any) -> None:
    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _link(path: Path, to: str) -> None:
    _remove(path, None)
    path.symlink_to(path.name if to == "loop" else to)


def _pipe(path: Path, _: Any) -> None:
    _remove(path, None)
    os.mkfifo(path)


def _folder(path: Path, _: Any) -> None:
    _remove(path, None)
    path.mkdir()


def _cut(path: Path, length: int) -> None:
    os.truncate(path, length % (path.stat().st_size + 1))


def _flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at % len(data)] ^= 1 + at % 255
    path.write_bytes(bytes(data))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", errors="surrogatepass")


def _rename(path: Path, name: str) -> None:
    inside = path.parent / name.replace("/", "_")
    path.rename(inside if inside.parent == path.parent else path)


def _add(path: Path, name: str) -> None:
    (path.parent / f"{name.replace('/', '_')[:200]}{path.suffix}").write_bytes(b"{}")


def _swap(path: Path, other: int) -> None:
    beside = sorted(one for one in path.parent.iterdir() if one.is_file() and not one.is_symlink())
    path.write_bytes(beside[other % len(beside)].read_bytes())


def _large(path: Path, size: int) -> None:
    os.truncate(path, 60 * (1 << 20) + size)


CHANGES = {
    "remove": _remove, "link": _link, "pipe": _pipe, "folder": _folder, "cut": _cut, "flip": _flip, "write": _write,
    "rename": _rename, "add": _add, "swap": _swap, "large": _large,
}  # fmt: skip
