"""`view_set.json`: what a view set of ours was made from and what its files must be. Written last."""

import hashlib
import json
from pathlib import Path
from typing import Any

from scenes.errors import InputError
from scenes.transforms import read_json

FORMAT = "radiance-verdict view set"
SCHEMA = 1
NAME = "view_set.json"


class DamagedViewSet(InputError):
    """A view set of ours whose files are not the ones that were written: it must be rendered again."""


def write_manifest(folder: Path, facts: dict[str, Any], files: list[Path]) -> None:
    """Writes `facts` with the checksums of `files` (inside the folder) and one of the manifest itself."""
    checksums = {file.relative_to(folder).as_posix(): checksum(file) for file in files}
    content = {"format": FORMAT, "schema": SCHEMA, **facts, "files": checksums}
    text = json.dumps({**content, "checksum": _own_checksum(content)}, indent=1, allow_nan=False)
    (folder / NAME).write_text(text, encoding="utf-8")


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest, or an empty dictionary where there is none: then the folder is not ours.

    Raises `InputError` for another version and `DamagedViewSet` where it was changed.
    """
    file = folder / NAME
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{file}: not a manifest of {FORMAT!r}; remove it to read the folder as anyone's view set")
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"{file}: schema {content.get('schema')!r}, this version reads {SCHEMA}; render the view set again "
            "with this version, or remove the manifest to read its PNG files alone"
        )
    claimed = content.pop("checksum", None)
    if claimed != _own_checksum(content):
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    return content


def checked(folder: Path, file: Path, manifest: dict[str, Any]) -> Path:
    """The file, if it is the one that the manifest lists; raises `DamagedViewSet` if not."""
    relative = file.resolve().relative_to(folder.resolve()).as_posix()
    if relative not in manifest["files"]:
        raise DamagedViewSet(f"{file}: not listed in {NAME}, so it is not of this view set; render it again")
    try:
        same = checksum(file) == manifest["files"][relative]
    except OSError as error:
        raise DamagedViewSet(f"{file}: cannot be read ({error.strerror}); render the view set again") from error
    if not same:
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    return file


def check_all(folder: Path) -> dict[str, Any]:
    """The manifest, once every file that it lists is there and whole; raises `InputError` if not."""
    manifest = read_manifest(folder)
    if not manifest:
        raise DamagedViewSet(f"{folder / NAME}: missing, so this view set is not complete; render it again")
    for relative in manifest["files"]:
        checked(folder, folder / relative, manifest)
    return manifest


def checksum(file: Path) -> str:
    """SHA-256 of a file's bytes, hexadecimal."""
    with file.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _own_checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
