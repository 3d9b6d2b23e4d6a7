"""Temporary folders in which view sets are rendered, locked by their process: without a lock, the process has died.

CACHE/.<view set>.<…>.partial        in work, or left by a killed process
CACHE/.<view set>.<…>.partial.lock   its lock, created before the folder and removed after it
"""

import glob
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scenes.files.lock import acquire, is_held

STALE_SECONDS = 48 * 3600
PARTIAL = ".partial"
LOCK = ".lock"


@contextmanager
def working_folder(cache: Path, name: str) -> Iterator[Path]:
    """Yield a new temporary folder for one view set, locked until the context is left."""
    partial = cache / f".{name}.{secrets.token_hex(4)}{PARTIAL}"
    lock = acquire(_lock_of(partial))
    if not lock.is_held:
        lock.path.unlink(missing_ok=True)
    try:
        partial.mkdir(mode=0o755)
        yield partial
    finally:
        lock.release()
        if not partial.exists():
            lock.path.unlink(missing_ok=True)


def remove(partial: Path) -> None:
    shutil.rmtree(partial, ignore_errors=True)
    _lock_of(partial).unlink(missing_ok=True)


def remove_stale(cache: Path, but: str | None = None) -> None:
    """Remove temporary folders of killed processes: those whose lock is free, or older than two days if the system has
    no locks. Younger ones of the view set `but` stay, as the next process takes over their views.
    """
    for partial in {*cache.glob(f".*{PARTIAL}"), *(lock.with_suffix("") for lock in cache.glob(f".*{PARTIAL}{LOCK}"))}:
        held = is_held(_lock_of(partial))
        try:
            old = time.time() - partial.stat().st_mtime > STALE_SECONDS
        except OSError:
            # only the lock is left: the folder was renamed into place, or never made
            if held is False:
                remove(partial)
            continue
        young = but is not None and partial.name.startswith(f".{but}.") and not old
        if (held is False and not young) or (held is None and old):
            remove(partial)


def abandoned(cache: Path, name: str) -> list[Path]:
    """Return the temporary folders of one view set whose process has died."""
    partials = sorted(cache.glob(f".{glob.escape(name)}.*{PARTIAL}"))
    return [partial for partial in partials if is_held(_lock_of(partial)) is False]


def _lock_of(partial: Path) -> Path:
    return partial.with_name(f"{partial.name}{LOCK}")
