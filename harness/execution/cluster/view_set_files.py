"""View sets on nodes without the driver's disk: listed by content, fetched file by file, kept on the node."""

import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from scenes.files.atomic import replacing
from scenes.files.digest import file_digest
from scenes.files.errors import InputError
from scenes.files.lock import waited_for

PIECE_BYTES = 32 << 20
"""The largest piece of a file that is sent at once, which bounds the memory."""


@dataclass(frozen=True)
class Listing:
    """The files of a view set."""

    folder: Path
    """The driver's folder; a node with a shared disk has the same folder."""
    files: dict[str, int]
    """Map path inside the folder → size in bytes."""
    digest: str
    """The digest of all paths and contents."""


def listed(folder: Path) -> Listing:
    """List a folder; raises `InputError` if it cannot be read."""
    digest = hashlib.sha256()
    files = {}
    try:
        for file in sorted(folder.rglob("*")):
            relative = file.relative_to(folder)
            if file.is_file() and not any(part.startswith(".") for part in relative.parts):
                files[relative.as_posix()] = file.stat().st_size
                digest.update(f"{relative.as_posix()} {file_digest(file)}\n".encode())
    except OSError as error:
        raise InputError(f"{error.filename or folder}: cannot be read ({error.strerror})") from error
    return Listing(folder.resolve(), files, digest.hexdigest())


def piece(listing: Listing, relative: str, offset: int) -> bytes:
    """Return up to `PIECE_BYTES` of a listed file; raises `KeyError` for any other."""
    if relative not in listing.files:
        raise KeyError(relative)
    with (listing.folder / relative).open("rb") as handle:
        handle.seek(offset)
        return handle.read(PIECE_BYTES)


def on_this_node(listing: Listing, fetch: Callable[[str, int], bytes]) -> Path:
    """Return this node's folder of the view set: the driver's if the disk is shared, else a copy, made once per node.
    `fetch` returns the piece of a file that begins at an offset. Raises `OSError` if the copy cannot be written, and
    `InputError` if its bytes differ from those listed.
    """
    if _same(listing.folder, listing):
        return listing.folder
    target = node_folder() / "view_sets" / listing.digest[:32] / listing.folder.name
    with waited_for(node_folder() / f"{target.parent.name}.lock"):  # no cell replaces what another one reads
        if _same(target, listing):
            return target
        with replacing(target.parent) as partial:
            copy = partial / listing.folder.name
            for relative, size in listing.files.items():
                _fetch(copy / relative, relative, size, fetch)
            if listed(copy).digest != listing.digest:
                raise InputError(
                    f"{listing.folder}: changed while it was copied to a node; leave it alone during a run"
                )
            shutil.rmtree(target.parent, ignore_errors=True)
    return target


def node_folder() -> Path:
    """Return this user's folder for files sent to a node, in the node's temporary folder (`TMPDIR`). Raises
    `InputError` if another user made it or could change its contents, as code is run from there.
    """
    user = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(tempfile.gettempdir()) / f"radiance-verdict-{'node' if user is None else user}"
    with suppress(FileExistsError):
        folder.mkdir(mode=0o700, parents=True)
    status = folder.lstat()
    shared = user is not None and (status.st_uid != user or status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
    if shared or not stat.S_ISDIR(status.st_mode):
        raise InputError(f"{folder}: is not a folder of this user only; remove it, or set TMPDIR to your own folder")
    return folder


def _same(folder: Path, listing: Listing) -> bool:
    try:
        if any((folder / relative).stat().st_size != size for relative, size in listing.files.items()):
            return False
        return listed(folder).digest == listing.digest
    except (OSError, InputError):
        return False


def _fetch(file: Path, relative: str, size: int, fetch: Callable[[str, int], bytes]) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("wb") as handle:
        while handle.tell() < size:
            data = fetch(relative, handle.tell())
            if not data:
                return  # the digest then differs
            handle.write(data)
