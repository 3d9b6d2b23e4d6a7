"""One process at a time writes into an output folder, and a holder that dies leaves no lock."""

import errno
import os
import signal
import time
from pathlib import Path

import pytest

from harness.run_folder.folder_lock import LOCK_FILE, lock_folder, locked_folder
from scenes.files.errors import InputError
from scenes.files.lock import is_held


def holder(out: Path) -> int:
    """Another process that holds the lock until it is killed."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        lock_folder(out)
        os.write(theirs, b"x")
        time.sleep(60)
        os._exit(0)
    assert os.read(ours, 1) == b"x"
    return child


def killed(child: int) -> None:
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)


def test_the_second_is_refused_with_the_name_of_the_holder(tmp_path: Path) -> None:
    child = holder(tmp_path)
    try:
        with pytest.raises(InputError, match=rf"in use by process {child} on .*; let that end"):
            lock_folder(tmp_path)
        assert is_held(tmp_path / LOCK_FILE)
    finally:
        killed(child)
    assert not is_held(tmp_path / LOCK_FILE)


def test_a_killed_holder_leaves_nothing_to_clean_up(tmp_path: Path) -> None:
    killed(holder(tmp_path))
    assert (tmp_path / LOCK_FILE).exists()
    lock = lock_folder(tmp_path)
    assert lock.is_held
    lock.release(remove=True)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_stays_empty_is_removed_and_one_that_was_there_stays(tmp_path: Path) -> None:
    with locked_folder(tmp_path / "fresh"):
        assert (tmp_path / "fresh" / LOCK_FILE).exists()
    assert not (tmp_path / "fresh").exists()
    with locked_folder(tmp_path):
        pass
    assert tmp_path.exists()


def test_without_locks_it_is_not_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def none(*_: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    with locked_folder(tmp_path) as lock:
        assert not lock.is_held


def test_a_file_elsewhere_is_not_written_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    (out := tmp_path / "out").mkdir()
    (out / LOCK_FILE).hardlink_to(tmp_path / "precious")
    with pytest.raises(InputError, match=r"\.lock: is a link or a device; remove it"):
        lock_folder(out)
    assert not is_held(out / LOCK_FILE)
    assert (tmp_path / "precious").read_text() == "mine"


@pytest.mark.parametrize("note", [b"", b"{", b'{"process": 1e999, "host": ""}', b"\xff", b"[[" * 400])
def test_a_holder_without_a_readable_note_is_another_process(note: bytes, tmp_path: Path) -> None:
    with locked_folder(tmp_path) as lock:
        os.truncate(tmp_path / LOCK_FILE, 0)
        os.pwrite(lock.handle, note, 0)
        with pytest.raises(InputError, match="in use by another process; let that end"):
            lock_folder(tmp_path)
