"""A lock on a file: one holder at a time among threads and processes, released when it dies; no link is followed.
Temporary folders of view sets: a folder in work is not touched, an abandoned folder is recognised.
"""

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from scenes.files.lock import LockTaken, acquire, is_held, waited_for
from scenes.files.partial_folders import STALE_SECONDS, abandoned, remove_stale, working_folder

pytest.importorskip("fcntl")


def test_another_holder_of_the_same_process_excludes_it_and_its_note_is_read(tmp_path: Path) -> None:
    lock = acquire(tmp_path / "lock")
    os.write(lock.handle, b"mine" + b" " * 1000)
    with pytest.raises(LockTaken) as caught:
        acquire(tmp_path / "lock")
    assert caught.value.note == b"mine" + b" " * 496
    assert is_held(tmp_path / "lock")
    lock.release()
    acquire(tmp_path / "lock").release(remove=True)
    assert list(tmp_path.iterdir()) == []


def test_a_lock_is_waited_for_and_its_file_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = acquire(tmp_path / "lock")
    monkeypatch.setattr(time, "sleep", lambda _: other.release())
    with waited_for(tmp_path / "lock"):
        assert not other.is_held
        assert is_held(tmp_path / "lock")
    assert not list(tmp_path.iterdir())


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


HOLDER = """
import sys, pathlib
from scenes.files.partial_folders import working_folder
with working_folder(pathlib.Path(sys.argv[1]), "lego") as partial:
    print(partial, flush=True)
    sys.stdin.read()
"""


def test_the_folder_of_a_living_process_is_kept(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdin is not None
    partial = Path(holder.stdout.readline().strip())
    # in a container it has another host name and an unknown process number: neither is used
    remove_stale(tmp_path)
    assert abandoned(tmp_path, "lego") == []
    assert partial.is_dir()
    os.utime(partial, (0, 0))
    remove_stale(tmp_path)
    assert partial.is_dir(), "a long rendering is not a dead one"
    os.utime(partial)
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    holder.stdin.close()
    holder.stdout.close()
    assert abandoned(tmp_path, "lego") == [partial]
    assert abandoned(tmp_path, "leg") == []
    remove_stale(tmp_path, but="lego")
    assert partial.is_dir(), "the next process takes over what it holds"
    remove_stale(tmp_path, but="drums")
    assert not partial.exists()


def test_without_a_lock_a_folder_is_stale_after_two_days(tmp_path: Path) -> None:
    partial = tmp_path / ".lego.of-an-earlier-version.partial"
    partial.mkdir()
    remove_stale(tmp_path)
    assert partial.is_dir()
    assert abandoned(tmp_path, "lego") == []
    os.utime(partial, (time.time() - STALE_SECONDS - 60,) * 2)
    remove_stale(tmp_path, but="lego")
    assert not partial.exists()


def test_what_gets_its_name_holds_no_lock_and_others_may_read_it(tmp_path: Path) -> None:
    with working_folder(tmp_path, "lego") as partial:
        assert list(partial.iterdir()) == []
        assert partial.stat().st_mode & 0o777 == 0o755
        partial.rename(tmp_path / "lego")
    assert [file.name for file in tmp_path.iterdir()] == ["lego"]


def test_one_killed_just_before_or_after_it_gets_its_name_leaves_nothing(tmp_path: Path) -> None:
    dying = HOLDER.replace("sys.stdin.read()", "partial.rename(sys.argv[2]) if sys.argv[2:] else None; os._exit(9)")
    for rename in ([], [str(tmp_path / "lego")]):
        subprocess.run([sys.executable, "-c", f"import os{dying}", str(tmp_path), *rename], capture_output=True)
        left = [file.name for file in tmp_path.iterdir() if file.name != "lego"]
        assert left, "killed before it could tidy up"
        assert len(abandoned(tmp_path, "lego")) == 1 - len(rename)
        remove_stale(tmp_path)
        assert {file.name for file in tmp_path.iterdir()} <= {"lego"}
