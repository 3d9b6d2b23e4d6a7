"""`view_set.json`, the manifest of a rendered view set: its origin and the digests of its files. Written last."""

import json
import shutil
from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct, convert, field, to_builtins

from scenes.files.digest import file_digest, json_digest
from scenes.files.errors import InputError, shown
from scenes.files.json_object import JsonObject
from scenes.view_sets.formats.transforms import Number, read_json

FORMAT = "radiance-verdict view set"
SCHEMA = 1
NAME = "view_set.json"


class DamagedViewSet(InputError):
    """A rendered view set whose files have changed: it must be rendered again."""


def write_manifest(folder: Path, facts: dict[str, object], files: list[Path]) -> None:
    """Write `facts` with the checksums of `files` (inside the folder) and one of the manifest itself."""
    checksums = {file.relative_to(folder).as_posix(): file_digest(file) for file in files}
    content = {"format": FORMAT, "schema": SCHEMA, **facts, "files": checksums}
    text = json.dumps({**content, "checksum": json_digest(content)}, indent=1, allow_nan=False)
    (folder / NAME).write_text(text, encoding="utf-8")


def read_manifest(folder: Path) -> JsonObject:
    """Return the manifest, empty for a folder without one, as of another program. Raises `InputError` for another
    version and `DamagedViewSet` if the manifest was changed.
    """
    file = folder / NAME
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{file}: not a manifest of {FORMAT!r}; remove it to read the folder as a foreign view set")
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"{file}: schema {shown(content.get('schema'))}, this version reads {SCHEMA}; render the view set again "
            "with this version, or remove the manifest to read only its PNG files"
        )
    if content.pop("checksum", None) != json_digest(content):
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    try:
        _require_printable(to_builtins(convert(content, _Manifest)))
    except ValueError as error:
        raise DamagedViewSet(f"{file}: {str(error)[:400]}: render the view set again") from error
    return content


def checked(folder: Path, file: Path, manifest: JsonObject) -> Path:
    """Return the file if it is intact and listed in the manifest; raises `DamagedViewSet` if not."""
    try:
        relative = file.resolve().relative_to(folder.resolve()).as_posix()
    except (ValueError, OSError, RuntimeError) as error:  # a link out of the folder, a name too long, a loop of links
        raise DamagedViewSet(f"{file}: leads out of the folder or nowhere; render the view set again") from error
    if relative not in manifest["files"]:
        raise DamagedViewSet(f"{file}: not listed in {NAME}, so it does not belong to this view set; render it again")
    if file.exists() and not file.is_file():  # reading a pipe would never end
        raise DamagedViewSet(f"{file}: is not a regular file; render the view set again")
    try:
        same = file_digest(file) == manifest["files"][relative]
    except OSError as error:
        raise DamagedViewSet(f"{file}: cannot be read ({error.strerror}); render the view set again") from error
    if not same:
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    return file


def check_all(folder: Path) -> JsonObject:
    """Return the manifest if every file that it lists is intact; raises `InputError` if not."""
    manifest = read_manifest(folder)
    if not manifest:
        raise DamagedViewSet(f"{folder / NAME}: missing, so this view set is not complete; render it again")
    for relative in manifest["files"]:
        checked(folder, folder / relative, manifest)
    return manifest


Text = Annotated[str, Meta(max_length=500)]
Name = Annotated[str, Meta(max_length=500, pattern=r"^(?!\.{0,2}$)[^/\\]*$")]
Corner = tuple[Number, Number, Number]


class _View(Struct, frozen=True):
    noise_mse: Number
    seconds: Number = 0.0
    seen: bool = True
    lit: bool = True


class _Line(_View, frozen=True, kw_only=True):
    order: str
    name: str
    files: dict[str, str]


class _Need(Struct, frozen=True, forbid_unknown_fields=True):
    name: Text
    needed: bool
    reason: Text
    kept: Text


class _LeftOut(Struct, frozen=True):
    """Older versions knew no bounds."""

    what: Text
    reason: Text
    name: Text = ""
    concerns: Text = ""
    bound: Number | None = None
    unit: Text = ""


class _Manifest(Struct, frozen=True):
    """The values that are read: anybody can write a manifest with a correct checksum, so their types are checked. The
    other keys only document the rendering. Older versions did not write the keys with defaults.
    """

    files: dict[Text, Text]
    scene: Name
    title: Text
    near: Number
    far: Number
    bounds: tuple[Corner, Corner]
    views: dict[str, _View]
    empty_splits: list[Text] = field(default_factory=list)
    needs: list[_Need] = field(default_factory=list)
    left_out: list[_LeftOut] = field(default_factory=list)


def _require_printable(value: object) -> None:
    if isinstance(value, str) and not value.isprintable():
        raise ValueError(f"{shown(value)} is not printable")
    if isinstance(value, dict):
        value = [*value, *value.values()]
    for inner in value if isinstance(value, list) else ():
        _require_printable(inner)


JOURNAL = "rendered.jsonl"
SUFFIXES = (".png", ".exr")


def note(folder: Path, order: str, name: str, facts: dict[str, object]) -> None:
    """Record that a view, `<split>/r_<number>`, of the set with the digest `order` is complete. Raises `OSError`."""
    line = {"order": order, "name": name, **facts, "files": _digests(folder, name)}
    with (folder / JOURNAL).open("a", encoding="utf-8") as file:
        # in one write, after a line end: a partial line of a killed writer does not spoil it
        file.write(f"\n{json.dumps({**line, 'digest': json_digest(line)}, allow_nan=False)}\n")


def salvaged(folder: Path, donors: list[Path], order: str, names: list[str]) -> dict[str, JsonObject]:
    """Copy intact views of `donors` to `folder` and its journal; return view → its facts. Raises `OSError`."""
    taken: dict[str, JsonObject] = {}
    for donor in donors:
        for name, line in _from_journal(donor, order).items():
            if name in taken or name not in names or line["files"] != _digests(donor, name):
                continue
            for suffix in SUFFIXES:
                (folder / name).parent.mkdir(exist_ok=True)
                shutil.copyfile(donor / f"{name}{suffix}", folder / f"{name}{suffix}")
            facts = {key: value for key, value in line.items() if key not in ("order", "name", "files", "digest")}
            note(folder, order, name, facts)
            taken[name] = facts
    return taken


def _from_journal(folder: Path, order: str) -> dict[str, JsonObject]:
    try:
        text = (folder / JOURNAL).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    lines = {}
    for row in text.splitlines():
        try:
            line = json.loads(row)
            claimed = line.pop("digest")
            if claimed == json_digest(line) and convert(line, _Line).order == order:
                lines[line["name"]] = line
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            continue
    return lines


def _digests(folder: Path, name: str) -> dict[str, str | None]:
    digests: dict[str, str | None] = {}
    for suffix in SUFFIXES:
        try:
            digests[suffix] = file_digest(folder / f"{name}{suffix}")
        except OSError:
            digests[suffix] = None
    return digests
