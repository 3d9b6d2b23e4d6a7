"""Temporary folders of view sets: a folder in work is not touched, an abandoned folder is recognised."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from scenes.files.partial_folders import STALE_SECONDS, abandoned, remove_stale, working_folder

pytest.importorskip("fcntl")

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
