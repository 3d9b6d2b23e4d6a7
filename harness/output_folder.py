"""The folder that a run writes to: a fresh one, or one that is gone on with; never one that is in use."""

import json
import shutil
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness.plan import Machine, Plan
from harness.records import records_folder, write_json
from scenes.errors import InputError

LEAST_FREE_BYTES = 200 << 20


def fresh_folder(profile: str, resume: bool) -> Path:
    """`out/<profile>-<time>`, or the folder that `out/latest` names when resuming."""
    latest = latest_folder()
    if resume and latest is not None:
        return latest
    stem = Path("out") / f"{profile}-{time.strftime('%Y%m%d-%H%M%S')}"
    candidates = [stem, *(stem.with_name(f"{stem.name}-{count}") for count in range(2, 100))]
    return next(path for path in candidates if not path.exists())


def point_latest_to(out: Path) -> None:
    """`latest` beside the folder, where it lies in `out/`; elsewhere nothing."""
    if out.resolve().parent != Path("out").resolve():
        return
    link = Path("out/latest")
    beside = link.with_name(".latest.part")
    try:
        beside.unlink(missing_ok=True)
        beside.symlink_to(out.resolve().name)
        beside.replace(link)
    except OSError:
        pass  # a file system without links: the folder's name was printed


def latest_folder() -> Path | None:
    """What `out/latest` names, if that is there."""
    latest = Path("out/latest")
    return latest.resolve() if latest.exists() else None


def claim_for(out: Path, file: str, resume: bool) -> bool:
    """Make the folder ours for a measurement that keeps everything in `file`; whether there is one to go on with.

    Raises `InputError` for a folder that is in use, and with `resume` for one without that file.
    """
    if resume:
        if not (out / file).exists():
            raise InputError(f"--resume: {out} holds no {file} to go on with; name its folder with --out")
        return True
    try:
        if out.exists() and not out.is_dir():
            raise InputError(f"--out {out}: is a file; name a folder")
        if out.exists() and any(out.iterdir()):
            raise InputError(f"--out {out}: the folder is in use; name another one, or go on with --resume")
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}); name another folder") from error
    return False


def claim_beside(out: Path, file: str, resume: bool) -> bool:
    """As `claim_for`, for a measurement that may also be added to the folder of a finished run that lacks `file`."""
    if not resume and (records_folder(out) / "run.json").exists() and not (out / file).exists():
        return False
    return claim_for(out, file, resume)


def claim(out: Path, plan: Plan, machine: Machine, resume: bool) -> None:
    """Make the folder ours, or refuse it. A run is gone on with by the same plan on the same kind of machine alone."""
    try:
        _claim(out, {**plan.settings(), "machine": asdict(machine)}, resume)
        free = shutil.disk_usage(out).free
    except OSError as error:
        raise InputError(
            f"--out {out}: cannot be written ({error.strerror}); name a folder on a disk with room"
        ) from error
    if free < LEAST_FREE_BYTES:
        raise InputError(f"--out {out}: less than {LEAST_FREE_BYTES >> 20} MiB are free on its disk; make room")


def _claim(out: Path, started_with: dict[str, Any], resume: bool) -> None:
    used = records_folder(out).exists()
    if out.exists() and not out.is_dir():
        raise InputError(f"--out {out}: is a file; name a folder")
    if used and not resume:
        raise InputError(f"--out {out}: holds results already; name another folder, or go on with --resume")
    if not used and out.exists() and any(out.iterdir()):
        raise InputError(f"--out {out}: the folder is in use by something else; name another one")
    if resume and not used:
        raise InputError(
            f"--resume: {out} holds no run to go on with; leave --resume out, or name its folder with --out"
        )
    if resume:
        _same_plan(out, started_with)
    write_json(records_folder(out) / "plan.json", started_with)


def release(out: Path) -> None:
    """Give up a claim that led to nothing, so that the same folder can be named again; results stay."""
    records = records_folder(out)
    if (records / "run.json").exists() or (records / "cells").exists():
        return
    (records / "plan.json").unlink(missing_ok=True)
    for folder in (records, out):
        try:
            folder.rmdir()
        except OSError:
            return  # not empty, or not ours to remove


def _same_plan(out: Path, started_with: dict[str, Any]) -> None:
    path = records_folder(out) / "plan.json"
    try:
        before = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except ValueError as error:
        raise InputError(f"--resume: {path}: {error}; run again into a fresh folder") from error
    if not isinstance(before, dict):
        raise InputError(f"--resume: {path}: not a plan; run again into a fresh folder")
    now = json.loads(json.dumps(started_with))
    changed = sorted(key for key in {*before, *now} if before.get(key) != now.get(key))
    if changed:
        what = "; ".join(f"{key} was {before.get(key)}, is {now.get(key)}" for key in changed)
        raise InputError(
            f"--resume: {out} was started with another plan ({what}); use the same options or a new folder"
        )
