"""The folder that a run writes to: fresh or resumed, never in use."""

import json
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

from harness.plan.run_plan import Machine, Plan
from harness.records.cells import records_folder
from harness.records.json_record import load_record, write_record
from harness.run_folder.folder_lock import LOCK_FILE, locked_folder
from harness.run_folder.integrity import DAMAGED, plan_of_cells, quarantine, reason_of, repair, sweep
from scenes.files.atomic import replacing
from scenes.files.errors import DamagedRecord, InputError, shown
from scenes.files.json_object import JsonObject

LEAST_FREE_BYTES = 200 << 20

Record = TypeVar("Record")


def fresh_folder(profile: str, resume: bool) -> Path:
    """Return `out/<profile>-<time>`, or the folder that `out/latest` names when resuming."""
    latest = latest_folder()
    if resume and latest is not None:
        return latest
    stem = Path("out") / f"{profile}-{time.strftime('%Y%m%d-%H%M%S')}"
    candidates = [stem, *(stem.with_name(f"{stem.name}-{count}") for count in range(2, 100))]
    return next(path for path in candidates if not path.exists())


def point_latest_to(out: Path) -> None:
    """Point `latest` to the folder if it lies in `out/`; elsewhere do nothing."""
    if out.resolve().parent != Path("out").resolve():
        return
    with suppress(OSError), replacing(Path("out/latest")) as link:  # not every file system has links
        link.symlink_to(out.resolve().name)


def latest_folder() -> Path | None:
    latest = Path("out/latest")
    return latest.resolve() if latest.exists() else None


def make_ours(out: Path, remedy: str = "name another one") -> None:
    """Create the locked folder; raises `InputError` if it is in use, with the remedy, or cannot be written."""
    try:
        if not _is_free(out):
            raise InputError(f"--out {out}: the folder is in use; {remedy}")
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}); name another folder") from error


def resumable_record(
    out: Path,
    file: str,
    resume: bool,
    read: Callable[[Path], Record],
    say: Callable[[str], None],
    in_run_folder: bool = False,
    folders: tuple[str, ...] = (),
) -> Record | None:
    """Claim the folder of a measurement whose only record is `file`; return that record if it is to be resumed.

    With `in_run_folder`, OUT may be a finished run that lacks `file`. With `resume`, a damaged record is reported and
    moved to OUT/damaged, and the measurement starts again; so it does without a record if one of `folders`, or an
    earlier damaged record, shows that OUT belongs to it. Raises `InputError` for a folder of something else.
    """
    path = out / file
    if not resume:
        if not (in_run_folder and (records_folder(out) / "run.json").exists() and not path.exists()):
            make_ours(out, "name another one, or add --resume")
        return None
    is_there = path.exists()
    if not (is_there or any((out / name).is_dir() for name in folders) or any((out / DAMAGED).glob(f"{file}.*"))):
        raise InputError(f"--resume: {out} holds no {file} to resume; name its folder with --out")
    sweep(out)
    try:
        return read(path)
    except (DamagedRecord, OSError) as error:
        say(f"{file}: {reason_of(error, path) if is_there else 'missing'}: everything in it is measured again")
        quarantine(out, file)
    return None


@contextmanager
def claimed(out: Path, plan: Plan, machine: Machine, resume: bool, say: Callable[[str], None]) -> Iterator[None]:
    """Lock and claim the folder, and with `resume` repair it; release the claim if the context raises `InputError`."""
    with locked_folder(out) as lock:
        if not lock.is_held:
            say(f"{out}: its file system has no locks; make sure that no other run uses the folder")
        lost = claim(out, plan, machine, resume)
        try:
            if lost is not None:
                say(f"records/plan.json: {lost}: written again from the options, which match the finished cells")
            if resume:
                repair(out, plan, say)
            yield
        except InputError:
            release(out)
            raise


def claim(out: Path, plan: Plan, machine: Machine, resume: bool) -> str | None:
    """Write the plan into the folder; a run is resumed only with the same plan on the same kind of machine. Return why
    the plan of a resumed run could not be read, else None. Raises `InputError` for any other folder.
    """
    started_with = {**plan.settings(), "machine": machine.settings()}
    path, lost = records_folder(out) / "plan.json", None
    try:
        free = shutil.disk_usage(next(folder for folder in (out, *out.absolute().parents) if folder.exists())).free
        if free < LEAST_FREE_BYTES:
            raise InputError(f"--out {out}: less than {LEAST_FREE_BYTES >> 20} MiB are free on its disk; make room")
        used = path.parent.exists()
        if used and not resume:
            raise InputError(f"--out {out}: holds results already; name another folder, or add --resume")
        if not used and not _is_free(out):
            raise InputError(f"--out {out}: the folder is in use by something else; name another one")
        if resume and not used:
            raise InputError(f"--resume: {out} holds no run to resume; leave the option out, or give --out")
        if resume:
            lost = _same_plan(out, plan, started_with)
        write_record(path, started_with)
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}); name a folder on a disk with room"
        ) from error
    return lost


def release(out: Path) -> None:
    """Release a claim that led to no results, so that the folder can be named again."""
    records = records_folder(out)
    if (records / "run.json").exists() or (records / "cells").exists():
        return
    (records / "plan.json").unlink(missing_ok=True)
    with suppress(OSError):
        records.rmdir()
        out.rmdir()


def _same_plan(out: Path, plan: Plan, started_with: dict[str, object]) -> str | None:
    """Return why the folder's plan is lost, or None if it is the same. Raises `InputError` for another plan."""
    path = records_folder(out) / "plan.json"
    try:
        before = _load_plan(path)
    except (OSError, ValueError, RecursionError) as error:
        if unlike := plan_of_cells(out, plan):
            raise InputError(
                f"--resume: {path}: {error}; it cannot be made again, as finished cells were trained with another plan "
                f"({unlike[0]}); use the same options or a new folder"
            ) from error
        if path.is_dir():
            quarantine(out, path.relative_to(out).as_posix())
        return "missing" if isinstance(error, FileNotFoundError) else str(error)
    now = json.loads(json.dumps(started_with))
    if any(settings.get("machine", {}).get("executor") for settings in (before, now)):
        # a cluster decides how many groups run at once, and each cell's record names its machine
        for settings in (before, now):
            settings["machine"] = {key: settings.get("machine", {}).get(key) for key in ("device", "threads")}
    if what := differences(before, now):
        raise InputError(
            f"--resume: {out} was started with another plan ({what}); use the same options or a new folder"
        )
    return None


def differences(before: dict[str, object], now: dict[str, object]) -> str:
    """Return the keys whose values changed, with both values; empty if none did."""
    return "; ".join(_differences("", before, now))


def _differences(within: str, before: object, now: object) -> list[str]:
    if not (isinstance(before, dict) and isinstance(now, dict)):
        was, is_ = ("{…}" if isinstance(value, dict) else value for value in (before, now))
        return [] if before == now else [f"{within} was {was}, is {is_}"]
    inner = f"{within}." if within else ""
    keys = sorted({*before, *now})
    return [line for key in keys for line in _differences(f"{inner}{key}", before.get(key), now.get(key))]


def _load_plan(path: Path) -> JsonObject:
    """Load a plan; raises `OSError`, and `ValueError` also for a key that no plan has, as in a damaged digest."""
    plan = load_record(path)
    if unknown := sorted(plan.keys() - {"machine", "density_units", *(each.name for each in fields(Plan))}):
        raise ValueError(f"holds {shown(unknown[0])}, which no plan has, so it was damaged")
    if not isinstance(plan.get("machine", {}), dict):
        raise ValueError(f"machine is {shown(plan['machine'])}, not an object, so it was damaged")
    return plan


def _is_free(out: Path) -> bool:
    return not out.exists() or all(entry.name == LOCK_FILE for entry in out.iterdir())
