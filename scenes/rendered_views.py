"""Views that are rendered already, of a set that is not whole: what was killed or damaged costs only what is missing.

    FOLDER/rendered.jsonl    a line a view, added once both its files are written

A line holds the digests of the files and one of itself, so that nothing is taken for rendered that is not as it was
written, however its writer ended.
"""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from scenes.errors import InputError
from scenes.manifest import checksum, read_manifest

NAME = "rendered.jsonl"
SUFFIXES = (".png", ".exr")


def note(folder: Path, order: str, name: str, facts: dict[str, Any]) -> None:
    """Says that a view, `<split>/r_<number>`, is complete; `order` is the digest of the set that it is of.

    Raises `OSError` where that cannot be written.
    """
    line = {"order": order, "name": name, **facts, "files": _digests(folder, name)}
    with (folder / NAME).open("a", encoding="utf-8") as file:
        # in one write, after a line end: half a line of a killed writer does not spoil it
        file.write(f"\n{json.dumps({**line, 'digest': _digest(line)}, allow_nan=False)}\n")


def salvaged(folder: Path, donors: list[Path], order: str, names: list[str]) -> dict[str, dict[str, Any]]:
    """View → its facts, of those that are sound in one of `donors`; their files are then in `folder`, and noted.

    Raises `OSError` where they cannot be copied.
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
        text = (folder / NAME).read_text(encoding="utf-8", errors="replace")
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
    """Of a set that was whole once."""
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
    """Whether they are what `note` is given: what is told of a view goes into a manifest."""
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
