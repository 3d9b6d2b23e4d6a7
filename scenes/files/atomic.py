"""Files and folders that are complete or absent, even after `kill -9`: written under another name, then renamed.

A killed writer leaves `.<name>.<process>.part`, followed by a suffix where a library derives the format from it.
"""

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scenes.files.errors import InputError


def require_suffix(file: Path, suffix: str, option: str) -> None:
    """Raise `InputError`, before long work, for a file of another format, a folder, and a place in a run's folder."""
    if file.suffix.lower() != suffix:
        raise InputError(f"{option} {file}: give a name that ends in {suffix}")
    if file.is_dir():
        raise InputError(f"{option} {file}: is a folder; name a file")
    if (file.parent / "run.json").exists():
        raise InputError(f"{option} {file}: lies among the records of a run; name a file elsewhere")


def write_atomically(path: Path, content: bytes | str, fsync: bool = True) -> None:
    """Write a file; without `fsync` a crash of the system may leave it empty. Raises `OSError`, naming the file."""
    with replacing(path) as temporary, temporary.open("xb") as file:
        file.write(content.encode("utf-8") if isinstance(content, str) else content)
        if fsync:
            file.flush()
            os.fsync(file.fileno())


@contextmanager
def replacing(path: Path, suffix: str = "") -> Iterator[Path]:
    """Yield a temporary path that ends in `suffix`; what is written there then replaces a file or an empty folder.

    The temporary is removed if anything fails. Raises `OSError`, naming `path` unless the error concerns a file
    elsewhere. A device is never replaced.
    """
    # a user's link to a device is replaced like any other link; a system's, such as /dev/stdout, is not
    of_the_system = not path.is_symlink() or path.parent == Path("/dev")
    if of_the_system and (path.is_char_device() or path.is_block_device()):
        raise OSError(errno.EPERM, "is a device, which no file replaces", str(path))
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part{suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove(temporary)
        yield temporary
        temporary.replace(path)
    except OSError as error:
        named = error.filename  # None where a write failed: the system does not name the file
        elsewhere = isinstance(named, str) and not (Path(named).is_relative_to(temporary) or path.is_relative_to(named))
        if elsewhere or error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):  # the first error is the one to report
            _remove(temporary)


def remove_leftovers(folder: Path, of: str = "*") -> int:
    """Remove what killed writers left of files whose name matches the pattern `of`; returns the number removed."""
    parts = [part for pattern in (f".{of}.part", f".{of}.part.*") for part in folder.glob(pattern) if part.is_file()]
    for part in parts:
        part.unlink(missing_ok=True)
    return len(parts)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
