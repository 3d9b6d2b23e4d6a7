"""The folder of a film: a fresh folder, or that of the same film to resume, never one in use.

DIR/film.json                     the film's settings, so that another film is not mixed into it
DIR/<scene>/<method>/0000.png …   frames (`harness.viewer.film.frames`)
DIR/<scene>/side_by_side/0000.png …
DIR/<scene>/<path>.webp           the animation; .mp4 where ffmpeg is installed
"""

import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from harness.records.json_record import load_record, write_record
from harness.run_folder.folder_lock import LOCK_FILE
from harness.run_folder.integrity import DAMAGED, quarantine
from harness.run_folder.output_folder import differences
from harness.viewer.film.frames import LISTING
from harness.viewer.film.takes import FilmSpec
from scenes.files.atomic import remove_leftovers
from scenes.files.errors import InputError

RECORD = "film.json"
SIDE_BY_SIDE = "side_by_side"


def claim(folder: Path, spec: FilmSpec, out: Path, say: Callable[[str], None]) -> None:
    """Write the film's record into the folder, which this process has locked. A resumed film may get further scenes
    and methods; all other settings must be the same. A lost record is reported and written again, as `frames.json`
    names the view of each frame.

    Raises `InputError` for a folder with other contents or another film, or that cannot be written.
    """
    # relative, as a run may be moved with its films
    now = {**asdict(spec), "run": os.path.relpath(out.resolve(), folder.resolve())}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        remove_leftovers(folder, f"{RECORD}.*")
        used = any(entry.name not in (LOCK_FILE, DAMAGED) for entry in folder.iterdir())
        if used and not (folder / RECORD).exists() and any(folder.glob(f"*/*/{LISTING}")):
            say(f"{folder / RECORD}: missing: written again")
        elif used and not (folder / RECORD).is_file():
            raise InputError(f"--to {folder}: the folder is in use by something else; name another one")
        elif used:
            _same_film(folder, now, say)
        for inner in folder.glob("**/"):
            remove_leftovers(inner)
        write_record(folder / RECORD, now)
    except OSError as error:
        raise InputError(f"--to {folder}: cannot be written ({error.strerror}); name another folder") from error


def _same_film(folder: Path, now: dict[str, object], say: Callable[[str], None]) -> None:
    try:
        before = load_record(folder / RECORD)
    except ValueError as error:
        say(f"{folder / RECORD}: {error}: written again")
        quarantine(folder, RECORD)
        return
    if what := differences(before, now):
        raise InputError(f"--to {folder}: holds another film ({what}); use the same options or name another folder")
