"""A lock on a file: one holder at a time among threads and processes, released when it dies; no link is followed."""

import errno
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from scenes.files.lock import LockTaken, acquire, is_held

pytest.importorskip("fcntl")


def test_another_holder_of_the_same_process_is_waited_for_and_read(tmp_path: Path) -> None:
    lock = acquire(tmp_path / "lock")
    os.write(lock.handle, b"mine" + b" " * 1000)
    for seconds in (0.0, 0.05):
        before = time.monotonic()
        with pytest.raises(LockTaken) as caught:
            acquire(tmp_path / "lock", seconds)
        assert seconds <= time.monotonic() - before < seconds + 0.5
        assert caught.value.note == b"mine" + b" " * 496
    assert is_held(tmp_path / "lock")
    threading.Timer(0.05, lock.release).start()
    acquire(tmp_path / "lock", 5.0).release(remove=True)
    assert list(tmp_path.iterdir()) == []


def test_a_process_that_was_forked_meanwhile_does_not_keep_the_lock(tmp_path: Path) -> None:
    lock = acquire(tmp_path / "lock")
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.read(reading, 1)
        os._exit(0)
    try:
        lock.release()
        acquire(tmp_path / "lock").release()
    finally:
        os.write(writing, b"x")
        os.waitpid(child, 0)


def test_who_asks_makes_no_file_unless_that_is_wanted(tmp_path: Path) -> None:
    assert is_held(tmp_path / "lock") is None
    assert list(tmp_path.iterdir()) == []
    assert is_held(tmp_path / "lock", create=True) is False
    assert is_held(tmp_path / "lock") is False


@pytest.mark.parametrize("name", ["ENOLCK", "ENOSYS", "EOPNOTSUPP", "EINVAL", "EIO"])
def test_a_file_system_without_locks_is_no_error_and_one_that_fails_is(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: int) -> None:
        raise OSError(getattr(errno, name), "refused")

    monkeypatch.setattr("fcntl.flock", refuse)
    assert is_held(tmp_path / "lock", create=True) is None
    if name == "EIO":
        with pytest.raises(OSError, match="refused"):
            acquire(tmp_path / "lock")
        return
    lock = acquire(tmp_path / "lock")
    assert not lock.is_held
    with pytest.raises(OSError, match="locks"):
        assert lock.handle
    lock.release(remove=True)


@pytest.mark.parametrize("put", [Path.symlink_to, Path.hardlink_to, lambda file, _: os.mkfifo(file)])
def test_what_is_no_plain_file_of_its_folder_alone_is_refused(
    put: Callable[[Path, Path], None], tmp_path: Path
) -> None:
    (tmp_path / "precious").write_text("mine")
    put(tmp_path / "lock", tmp_path / "precious")
    with pytest.raises(OSError, match="lock") as caught:
        acquire(tmp_path / "lock")
    assert caught.value.errno == errno.ELOOP


def test_a_lock_that_was_let_go_while_it_was_being_opened_is_not_taken_for_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, opened = acquire(tmp_path / "lock"), []
    plain = os.open

    def open_then_released(path: Path, *rest: int) -> int:
        file = plain(path, *rest)
        if not opened:
            first.release(remove=True)  # the file that was opened has no name any more
        opened.append(file)
        return file

    monkeypatch.setattr("scenes.files.lock.os.open", open_then_released)
    lock = acquire(tmp_path / "lock")
    assert len(opened) == 2
    assert is_held(tmp_path / "lock")
    lock.release()
