"""Files and folders that are complete or absent, also under `kill -9`: written beside their place, then renamed.

A writer that was killed leaves `.<name>.<process>.part`, followed by the suffix of the file if a library decides by
that.
"""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def write_atomically(path: Path, content: bytes | str, fsync: bool = True) -> None:
    """Write a file; without `fsync` a crash of the system may leave it empty. Raises `OSError`, naming the file."""
    with replacing(path) as beside, beside.open("xb") as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)
        if fsync:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def replacing(path: Path, suffix: str = "") -> Iterator[Path]:
    """Yield a free name, which ends in `suffix`, for what then takes the place of a file or of an empty folder.

    What stands there is removed if anything fails. Raises `OSError`, naming `path` unless it is about a file elsewhere;
    a device is never replaced.
    """
    # a link of ours to a device is replaced as any other; one of the system, as /dev/stdout, is not
    of_the_system = not path.is_symlink() or path.parent == Path("/dev")
    if of_the_system and (path.is_char_device() or path.is_block_device()):
        raise OSError(errno.EPERM, "is a device, which no file replaces", str(path))
    beside = path.with_name(f".{path.name}.{os.getpid()}.part{suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove(beside)
        yield beside
        beside.replace(path)
    except OSError as error:
        named = error.filename  # None where a write failed: the system does not say of which file
        elsewhere = isinstance(named, str) and not (Path(named).is_relative_to(beside) or path.is_relative_to(named))
        if elsewhere or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):  # what went wrong before is what is said
            _remove(beside)


def remove_leftovers(folder: Path, of: str = "*") -> int:
    """Remove what killed writers left of files `of` this name, a pattern, if nobody writes; returns their number."""
    parts = [part for pattern in (f".{of}.part", f".{of}.part.*") for part in folder.glob(pattern) if part.is_file()]
    for part in parts:
        part.unlink(missing_ok=True)
    return len(parts)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
