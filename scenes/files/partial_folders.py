"""Temporary folders in which view sets are rendered: locked by their process, so that those of killed ones are known.

CACHE/.<view set>.<…>.partial        in work, or left by a process that was killed
CACHE/.<view set>.<…>.partial.lock   beside it, there before the folder and for as long
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
    """Yield a fresh temporary folder for one view set, marked as in use until the context is left."""
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
    """Remove a folder with its lock."""
    shutil.rmtree(partial, ignore_errors=True)
    _lock_of(partial).unlink(missing_ok=True)


def remove_stale(cache: Path, but: str | None = None) -> None:
    """Remove temporary folders that killed processes left: those whose lock nobody has, or two days old if locks say
    nothing; those of the view set `but` stay while they are young, as the next process takes over what they hold.
    """
    for partial in {*cache.glob(f".*{PARTIAL}"), *(lock.with_suffix("") for lock in cache.glob(f".*{PARTIAL}{LOCK}"))}:
        held = is_held(_lock_of(partial))
        try:
            old = time.time() - partial.stat().st_mtime > STALE_SECONDS
        except OSError:
            # its folder has got its name, or was never made
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
