"""`view_set.json`: the origin of a view set of ours and the digests of its files. Written last."""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scenes.files.errors import InputError
from scenes.view_sets.transforms import read_json

FORMAT = "radiance-verdict view set"
SCHEMA = 1
NAME = "view_set.json"


class DamagedViewSet(InputError):
    """A view set of ours with files other than those written: it must be rendered again."""


def write_manifest(folder: Path, facts: dict[str, Any], files: list[Path]) -> None:
    """Write `facts` with the checksums of `files` (inside the folder) and one of the manifest itself."""
    checksums = {file.relative_to(folder).as_posix(): checksum(file) for file in files}
    content = {"format": FORMAT, "schema": SCHEMA, **facts, "files": checksums}
    text = json.dumps({**content, "checksum": _own_checksum(content)}, indent=1, allow_nan=False)
    (folder / NAME).write_text(text, encoding="utf-8")


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest, or an empty dictionary if there is none: then the folder is not ours.

    Raises `InputError` for another version and `DamagedViewSet` if it was changed.
    """
    file = folder / NAME
    if not file.exists():
        return {}
    content = read_json(file)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{file}: not a manifest of {FORMAT!r}; remove it to read the folder as anyone's view set")
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"{file}: schema {_shown(content.get('schema'))}, this version reads {SCHEMA}; render the view set again "
            "with this version, or remove the manifest to read its PNG files alone"
        )
    claimed = content.pop("checksum", None)
    if claimed != _own_checksum(content):
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    for key, (fits, what) in _KEYS.items():
        if (key in content or key not in _LATER) and not fits(content.get(key)):
            found = _shown(content.get(key))
            raise DamagedViewSet(f"{file}: {key} is {found}; it must be {what}: render the view set again")
    return content


def checked(folder: Path, file: Path, manifest: dict[str, Any]) -> Path:
    """Return the file if it is the one that the manifest lists; raises `DamagedViewSet` if not."""
    try:
        relative = file.resolve().relative_to(folder.resolve()).as_posix()
    except (ValueError, OSError, RuntimeError) as error:  # a link out of it, a name too long, a loop of links
        raise DamagedViewSet(f"{file}: leads out of the folder or nowhere; render the view set again") from error
    if relative not in manifest["files"]:
        raise DamagedViewSet(f"{file}: not listed in {NAME}, so it is not of this view set; render it again")
    if file.exists() and not file.is_file():  # a pipe would keep us waiting for ever
        raise DamagedViewSet(f"{file}: is no file; render the view set again")
    try:
        same = checksum(file) == manifest["files"][relative]
    except OSError as error:
        raise DamagedViewSet(f"{file}: cannot be read ({error.strerror}); render the view set again") from error
    if not same:
        raise DamagedViewSet(f"{file}: its checksum is wrong, so it was changed or damaged; render the view set again")
    return file


def check_all(folder: Path) -> dict[str, Any]:
    """Return the manifest, once every file that it lists is there and intact; raises `InputError` if not."""
    manifest = read_manifest(folder)
    if not manifest:
        raise DamagedViewSet(f"{folder / NAME}: missing, so this view set is not complete; render it again")
    for relative in manifest["files"]:
        checked(folder, folder / relative, manifest)
    return manifest


def checksum(file: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal."""
    with file.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e30


def _is_corner(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= 500 and (value.isprintable() or not value)


def _is_name(value: Any) -> bool:
    """Return whether a text is fit for a part of a file's name."""
    return _is_text(value) and value not in ("", ".", "..") and not set(value) & set("/\\")


def _are_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(map(_is_text, value)) and all(map(_is_text, value.values()))


def _are_views(value: Any) -> bool:
    return isinstance(value, dict) and all(
        isinstance(view, dict) and _is_number(view.get("noise_mse")) for view in value.values()
    )


def _are_needs(value: Any) -> bool:
    keys = {"name", "needed", "reason", "kept"}
    return _are_rows(value) and all(set(row) == keys and _is_text(row["name"]) for row in value)


def _are_left_out(value: Any) -> bool:
    return _are_rows(value) and all(_is_text(row.get("what")) for row in value)


def _are_rows(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(row, dict) and all(map(_is_plain, row.values())) for row in value)


def _is_plain(value: Any) -> bool:
    return value is None or isinstance(value, bool) or _is_number(value) or _is_text(value) or _is_number_list(value)


def _is_number_list(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_number, value))


_KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "files": (_are_texts, "an object of checksums by path"),
    "scene": (_is_name, "the name of a scene"),
    "title": (_is_text, "a line of text"),
    "near": (_is_number, "a number"),
    "far": (_is_number, "a number"),
    "bounds": (lambda v: isinstance(v, list) and len(v) == 2 and all(map(_is_corner, v)), "two corners of a box"),
    "views": (_are_views, "an object of views, each with its noise_mse"),
    "empty_splits": (lambda v: isinstance(v, list) and all(map(_is_text, v)), "a list of splits"),
    "needs": (_are_needs, "a list of needs"),
    "left_out": (_are_left_out, "a list of what was left out"),
}
"""The keys that are read of a manifest, with checks: anyone who writes a folder can make its checksum right."""
_LATER = ("empty_splits", "needs", "left_out")
"""The keys that older versions did not write."""


def _shown(value: Any) -> str:
    if value is None:
        return "missing or null"
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:79]}…"


def _own_checksum(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


JOURNAL = "rendered.jsonl"
SUFFIXES = (".png", ".exr")


def note(folder: Path, order: str, name: str, facts: dict[str, Any]) -> None:
    """Note that a view, `<split>/r_<number>`, is complete; `order` is the digest of its set.

    Raises `OSError` if that cannot be written.
    """
    line = {"order": order, "name": name, **facts, "files": _digests(folder, name)}
    with (folder / JOURNAL).open("a", encoding="utf-8") as file:
        # in one write, after a line end: half a line of a killed writer does not spoil it
        file.write(f"\n{json.dumps({**line, 'digest': _digest(line)}, allow_nan=False)}\n")


def salvaged(folder: Path, donors: list[Path], order: str, names: list[str]) -> dict[str, dict[str, Any]]:
    """Return view → its facts, of the views that are valid in one of `donors`; their files are then in `folder`, and
    noted.

    Raises `OSError` if they cannot be copied.
    """
    found: dict[str, dict[str, Any]] = {}
    for donor in donors:
        for name, line in {**_of_manifest(donor, order), **_of_lines(donor, order)}.items():
            if name in found or name not in names or line["files"] != _digests(donor, name):
                continue
            for suffix in SUFFIXES:
                (folder / name).parent.mkdir(exist_ok=True)
                shutil.copyfile(donor / f"{name}{suffix}", folder / f"{name}{suffix}")
            facts = {key: value for key, value in line.items() if key not in ("order", "name", "files", "digest")}
            note(folder, order, name, facts)
            found[name] = facts
    return found


def _of_lines(folder: Path, order: str) -> dict[str, dict[str, Any]]:
    try:
        text = (folder / JOURNAL).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    found = {}
    for row in text.splitlines():
        try:
            line = json.loads(row)
            claimed = line.pop("digest")
            if claimed == _digest(line) and line["order"] == order and line["files"] and _is_sound(line):
                found[str(line["name"])] = line
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            continue
    return found


def _of_manifest(folder: Path, order: str) -> dict[str, dict[str, Any]]:
    """Return the facts of the views of a set that was complete once."""
    try:
        manifest = read_manifest(folder)
        if manifest.get("digest") != order:
            return {}
        return {
            name: {**told, "files": {suffix: manifest["files"][f"{name}{suffix}"] for suffix in SUFFIXES}}
            for name, told in manifest["views"].items()
            if _is_sound(told)
        }
    except (InputError, OSError, KeyError, TypeError, AttributeError):
        return {}


def _is_sound(facts: dict[str, Any]) -> bool:
    """Return whether facts are as `note` takes them: the facts of a view go into a manifest."""
    numbers = [facts.get("noise_mse"), facts.get("seconds", 0.0)]
    return all(type(one) in (int, float) and abs(one) < 1e30 for one in numbers) and all(
        isinstance(facts.get(name, True), bool) for name in ("seen", "lit")
    )


def _digests(folder: Path, name: str) -> dict[str, str | None]:
    found: dict[str, str | None] = {}
    for suffix in SUFFIXES:
        try:
            found[suffix] = checksum(folder / f"{name}{suffix}")
        except OSError:
            found[suffix] = None
    return found


def _digest(line: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(line, sort_keys=True).encode()).hexdigest()
