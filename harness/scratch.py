"""A folder for files that outlive no command, within the output folder and so on its disk.

It carries its owner's lock: whoever tidies the output folder removes it where its owner was killed, and never while
its owner, which may be the command that asked for the tidying, still works in it.
"""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.folder_lock import is_abandoned, lock_folder

PREFIX = ".scratch-"


@contextmanager
def scratch_folder(out: Path) -> Iterator[Path]:
    """Makes a folder within `out` and removes it at the end. Raises `OSError` where `out` cannot be written."""
    folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=out))
    try:
        lock = lock_folder(folder)
        try:
            yield folder
        finally:
            lock.release()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(out: Path) -> int:
    """Removes the scratch folders whose owners were killed; how many."""
    found = [folder for folder in out.glob(f"{PREFIX}*") if folder.is_dir() and is_abandoned(folder)]
    for folder in found:
        shutil.rmtree(folder, ignore_errors=True)
    return len(found)
