"""The folder of a film: a fresh one, or one of the same film that is gone on with; never one that is in use.

DIR/film.json                     what is filmed, so that another film is not mixed into it
DIR/<scene>/<method>/0000.png …   frames (`harness.filming.frames`)
DIR/<scene>/side_by_side/0000.png …
DIR/<scene>/<path>.webp           the animation
"""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.records import write_json
from scenes.errors import InputError

if TYPE_CHECKING:
    from harness.filming.takes import Wish

RECORD = "film.json"
SIDE_BY_SIDE = "side_by_side"


def claim(folder: Path, wish: "Wish", out: Path) -> None:
    """Makes the folder this film's. Scenes and methods may come later; everything else must be as it was.

    Raises `InputError` for a folder that is something else's, holds another film, or cannot be written.
    """
    # relative to the folder: a run may be moved with its films
    now = {**asdict(wish), "run": os.path.relpath(out.resolve(), folder.resolve())}
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--to {folder}: is a file; name a folder")
        used = folder.exists() and any(folder.iterdir())
        if used and not (folder / RECORD).is_file():
            raise InputError(f"--to {folder}: the folder is in use by something else; name another one")
        if used:
            _same_film(folder, now)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / RECORD, now)
    except OSError as error:
        raise InputError(f"--to {folder}: cannot be written ({error.strerror}); name another folder") from error


def _same_film(folder: Path, now: dict[str, Any]) -> None:
    try:
        before = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(f"{folder / RECORD}: {error}; delete the folder or name another one with --to") from error
    if not isinstance(before, dict):
        raise InputError(f"{folder / RECORD}: not the record of a film; name another folder with --to")
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        what = "; ".join(f"{key} was {before.get(key)}, is {now.get(key)}" for key in changed)
        raise InputError(f"--to {folder}: holds another film ({what}); use the same options or name another folder")
