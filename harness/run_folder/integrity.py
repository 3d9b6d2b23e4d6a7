"""A check of a run's files before it is resumed: damaged files are named, quarantined in OUT/damaged, and made again.

Only incomplete files of killed writers are deleted.
"""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from harness.plan.run_plan import Plan
from harness.plan.settings import TrainSettings
from harness.records.cells import (
    CellRecord,
    cell_path,
    checkpoint_name,
    read_cell,
    read_cells,
    read_comparisons,
    read_run,
)
from harness.records.pictures import read_truth, truth_pictures
from harness.records.snapshot import ENDED, read_unfinished, unfinished_path
from harness.records.snapshot import FOLDER as UNFINISHED
from harness.records.study import SHELVES, read_studies
from harness.records.targets import TARGETS_FILE, read_targets
from harness.run_folder.folder_lock import remove_abandoned
from scenes.files.atomic import remove_leftovers
from scenes.files.digest import file_digest
from scenes.files.errors import DamagedRecord, InputError

DAMAGED = "damaged"
FOLDERS = ("records", "records/cells", "records/pictures", "checkpoints", UNFINISHED)
"""The folders in which a run writes, outer folders first."""
Say = Callable[[str], None]


def sweep(out: Path) -> int:
    """Remove incomplete files and scratch folders of killed processes; return their number. The folder is locked."""
    return sum(remove_leftovers(out / folder) for folder in (".", *FOLDERS)) + remove_abandoned(out)


def repair(out: Path, plan: Plan, say: Say) -> None:
    """Repair the folder, so that it holds only valid files; reports each fault and its remedy. Raises `OSError` if a
    file cannot be moved, and `InputError` if OUT/damaged is a file.
    """
    for folder in FOLDERS:
        if (out / folder).exists() and not (out / folder).is_dir():
            say(f"{folder}: is not a folder; moved to {DAMAGED}")
            quarantine(out, folder)
    sweep(out)
    cells = files = 0
    for scene, method, seed in (*plan.cells(), *plan.guest_cells()):
        path = cell_path(out, scene, method, seed)
        names = [checkpoint_name(scene, method, seed), f"records/pictures/{scene}.{method}.{seed}.safetensors"]
        cell, wrong = _cell_fault(out, path, (scene, method, seed), names)
        kept = unfinished_path(out, scene, method, seed)
        if cell is not None and cell.status in ENDED and kept.is_file():
            kept.unlink()
        elif kept.exists():
            _check(out, kept.relative_to(out).as_posix(), read_unfinished, "trained from the start", say)
        if wrong is not None:
            say(f"{wrong}: {scene}, {method}, seed {seed} is trained again")
            for name in (path.relative_to(out).as_posix(), *names):
                quarantine(out, name)
        elif cell is not None:
            cells, files = cells + 1, files + len(cell.files)
        else:
            for name in names:  # an unfinished cell writes its files again
                if (out / name).is_dir():
                    quarantine(out, name)
    _check_others(out, plan, say)
    say(f"{cells} finished cells and their {files} files are valid")


def plan_of_cells(out: Path, plan: Plan) -> list[str]:
    """Return a sentence for each setting in which finished cells differ from a plan, for a run whose plan is lost."""
    planned = json.loads(json.dumps(plan.settings()))
    sentences = []
    for scene, method, seed in plan.cells():
        with suppress(DamagedRecord):
            settings = read_cell(cell_path(out, scene, method, seed)).settings
            pairs: dict[str, tuple[object, object]] = {}
            for name in ("score", "budget"):
                if settings.get(name) is not None:
                    pairs[name] = settings[name], planned[name]
            if (before := settings.get("train")) is not None:
                usual = asdict(TrainSettings())  # old records lack newer settings
                pairs |= {key: (before.get(key, usual[key]), planned["train"].get(key)) for key in TRAINED_WITH}
                if "own" in before:
                    pairs["own"] = before["own"].get(method), planned["train"]["own"].get(method)
            sentences += [
                f"{scene}.{method}.{seed}: {name} was {before}, is {now}"
                for name, (before, now) in pairs.items()
                if before != now
            ]
    return sentences


TRAINED_WITH = (
    *("network", "rays", "covered_share", "contrast_weight", "precision"),
    *("learning_rate", "last_learning_rate", "decay", "warm_up_steps", "average"),
)
"""The training settings that are the same for all scenes of a plan; the others depend on a scene's needs."""


def _cell_fault(
    out: Path, path: Path, key: tuple[str, str, int], names: list[str]
) -> tuple[CellRecord | None, str | None]:
    """Return the record if it is valid, and its fault; neither if there is no record yet."""
    if not path.exists():
        return None, None
    shown = path.relative_to(out)
    try:
        cell = read_cell(path)
    except DamagedRecord as error:
        return None, f"{shown}: {reason_of(error, path)}"
    if cell.status == "done" and cell.files and names[0] not in cell.files:
        return None, f"{shown}: names no weights"
    for name, digest in cell.files.items():
        if name not in names:
            return None, f"{shown}: names a file of another cell"
        try:
            if not (out / name).is_file():
                return None, f"{name}: is not a file" if (out / name).exists() else f"{name}: missing"
            if file_digest(out / name) != digest:
                return None, f"{name}: its digest does not match, so it was damaged or changed"
        except OSError as error:
            return None, f"{name}: cannot be read ({error.strerror})"
    return cell, None


def _check_others(out: Path, plan: Plan, say: Say) -> None:
    """Check the files that belong to no cell; of missing files only pictures are faults."""
    started = {scene for scene, method, seed in plan.cells() if cell_path(out, scene, method, seed).exists()}
    for scene in plan.scenes:
        name = f"records/{truth_pictures(scene)}"
        if (out / name).exists() or (plan.score.stored_views and scene in started):
            _check(out, name, read_truth, "taken from the view set again", say)
    tries: dict[str, tuple[Callable[[Path], object], str]] = {
        "records/run.json": (lambda _: read_run(out), "written again"),
        "records/comparisons.json": (lambda _: read_comparisons(out, read_cells(out)), "computed again"),
        f"records/{TARGETS_FILE}": (lambda _: read_targets(out, read_cells(out)), "computed again"),
        SHELVES["serving"]: (read_studies, f"moved away; `python -m harness study serving {out}` measures it again"),
    }
    for name, (read, remedy) in tries.items():
        if (out / name).exists():
            _check(out, name, read, remedy, say)


def _check(out: Path, name: str, read: Callable[[Path], object], remedy: str, say: Say) -> None:
    """Quarantine a file that cannot be read."""
    try:
        read(out / name)
    except (DamagedRecord, OSError) as error:
        say(f"{name}: {reason_of(error, out / name)}: {remedy}")
        quarantine(out, name)


def reason_of(error: Exception, path: Path) -> str:
    """Return the reason without the file's name and without the remedy."""
    return " ".join(str(error).split()).removeprefix(f"{path}: ").rsplit("; ", 1)[0][:200]


def quarantine(out: Path, name: str) -> None:
    """Move a file or folder, if it exists, to OUT/damaged under a free name."""
    path = out / name
    if not (path.exists() or path.is_symlink()):
        return
    folder = out / DAMAGED
    try:
        folder.mkdir(exist_ok=True)
    except FileExistsError:
        raise InputError(f"{folder}: is a file, and damaged files are moved there; remove it") from None
    stem = name.replace("/", ".")
    path.rename(next(free for count in range(1, 1_000_000) if not (free := folder / f"{stem}.{count}").exists()))
