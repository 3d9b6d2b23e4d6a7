"""Where nothing more can be written the picture stays in memory, and the store says why it is not on disk."""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from harness.view_cache import keys, ledger
from harness.view_cache.disk import DiskPictures
from harness.view_cache.ledger import locked
from harness.view_cache.store import ViewStore
from tests.harness.view_cache.drawn import drawn, same_bits

resource = pytest.importorskip("resource")


@contextmanager
def files_of_at_most(limit: int) -> Iterator[None]:
    """What is beyond is refused by the system, after what still fits was taken: as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def names_in(folder: Path) -> set[Path]:
    return {file for file in folder.rglob("*") if file.is_file() and file.name != "ledger"}


@pytest.mark.parametrize("limit", [0, 1, 100, 129, 131, 600, 1100])
def test_a_disk_that_is_full_costs_no_picture(tmp_path: Path, limit: int) -> None:
    """A drawn picture takes 1143 bytes, and its key 130."""
    store = ViewStore(10**6, tmp_path, 10**6)
    store.store("before", drawn(1), level=2)
    there = names_in(tmp_path)
    with files_of_at_most(limit):
        for seed in range(2, 6):
            store.store(f"{seed}", drawn(seed), level=2)
            assert store.where(f"{seed}") == 1
            assert same_bits(store.get(f"{seed}"), drawn(seed))
        assert same_bits(store.get("before"), drawn(1))
    assert names_in(tmp_path) == there
    statistics = store.statistics
    assert statistics.failed_writes == 4
    assert statistics.last_failure
    assert (statistics.damaged, statistics.stored[1]) == (0, 4)
    store.store("after", drawn(7), level=2)
    fresh = ViewStore(0, tmp_path, 10**6)
    assert same_bits(fresh.get("after"), drawn(7))
    assert same_bits(fresh.get("before"), drawn(1))
    assert fresh.get("3") is None
    assert fresh.statistics.damaged == fresh.statistics.leftovers == 0


ON_A_SMALL_DISK = """
import sys
import numpy as np
from pathlib import Path
from harness.view_cache.store import ViewStore
folder = Path(sys.argv[1])
store = ViewStore(10**9, folder, 10**9)
def noise(seed):
    return np.random.default_rng(seed).random((100, 100, 5), dtype=np.float32)
for seed in range(12):
    store.store(f"{seed}", noise(seed), level=2)
    assert np.array_equal(store.get(f"{seed}"), noise(seed)), seed
statistics = store.statistics
again = ViewStore(0, folder, 10**9)
kept = [seed for seed in range(12) if again.get(f"{seed}") is not None]
assert all(np.array_equal(again.get(f"{seed}"), noise(seed)) for seed in kept)
assert not list((folder / "parts").iterdir())
print(len(kept), statistics.failed_writes, again.statistics.damaged, statistics.last_failure)
"""


def test_a_real_disk_that_is_full(tmp_path: Path) -> None:
    """One mebibyte in memory, mounted in a name space of its own: five pictures of 200 kB fit."""
    unshare, mount = shutil.which("unshare"), shutil.which("mount")
    if unshare is None or mount is None:
        pytest.skip("needs unshare and mount")
    small = f'{mount} -t tmpfs -o size=1m none "$1" && exec "$2" -c "$3" "$1"'
    done = subprocess.run(
        [unshare, "--user", "--map-root-user", "--mount", "sh", "-c", small, "sh", tmp_path, sys.executable,
         ON_A_SMALL_DISK],
        cwd=keys.ROOT, capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode and ("unshare" in done.stderr or "mount:" in done.stderr):
        pytest.skip(f"no file system can be mounted here: {done.stderr.strip()[:200]}")
    assert done.stderr == ""
    kept, failed, damaged, reason = done.stdout.strip().split(" ", 3)
    assert int(kept) in (4, 5)
    assert int(kept) + int(failed) == 12
    assert int(damaged) == 0
    assert reason


READ_ONLY = """
import os, sys
from pathlib import Path
from harness.view_cache.disk import DiskPictures
from harness.view_cache.store import ViewStore
from scenes.errors import InputError
from tests.harness.view_cache.drawn import drawn, same_bits
folder = Path(sys.argv[1])
store = ViewStore(10**6, folder, 10**6)
store.store("a", drawn(1), level=2)
for name, _, _ in os.walk(folder):
    os.chmod(name, 0o555)
os.chmod(folder / "ledger", 0o444)
if os.geteuid() == 0:
    os.setgroups([]), os.setgid(65534), os.setuid(65534)
assert same_bits(store.get("a"), drawn(1))
store.store("b", drawn(2), level=2)
assert store.where("b") == 1 and same_bits(store.get("b"), drawn(2))
print(store.statistics.failed_writes, store.statistics.last_failure)
try:
    ViewStore(10**6, folder, 10**6)
except InputError as error:
    print(error)
"""


def test_a_folder_that_can_only_be_read_is_read(tmp_path: Path) -> None:
    shared = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else tmp_path  # where another user can get to
    folder = shared / f"views-{os.getpid()}-{id(tmp_path)}"
    try:
        done = subprocess.run(
            [sys.executable, "-c", READ_ONLY, str(folder)], cwd=keys.ROOT, capture_output=True, text=True
        )
    finally:
        for name, _, _ in os.walk(folder):
            Path(name).chmod(0o755)
        shutil.rmtree(folder, ignore_errors=True)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first == "1 Permission denied"
    assert second.startswith(f"{folder}: views cannot be kept there (Permission denied)")


@pytest.mark.parametrize(
    ("call", "at"), [("replace", 1), ("replace", 2), ("write_bytes", 1), ("stat", 1), ("unlink", 1), ("unlink", 2)]
)
def test_a_system_that_refuses_at_any_call_leaves_no_half_file(
    tmp_path: Path, call: str, at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Picture and key are renamed, the key is written; what is not renamed is removed, which may be refused as well."""
    store = ViewStore(10**6, tmp_path, 10**6)
    works = getattr(Path, call)
    calls: list[Path] = []

    def refuses(path: Path, *arguments: object, **options: object) -> object:
        calls.append(path)
        if len(calls) == at:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        return works(path, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, call, refuses)
        store.store("a", drawn(1), level=2)
    assert len(calls) >= at, "a call that is never made shows nothing"
    fresh = DiskPictures(tmp_path, 10**6)
    if call == "unlink":  # of what was renamed before, and is no longer there
        assert (store.where("a"), store.statistics.failed_writes) == (2, 0)
        assert same_bits(fresh.get("a"), drawn(1))
    else:
        assert (store.where("a"), store.statistics.last_failure) == (1, "No space left on device")
        assert fresh.get("a") is None
    assert fresh.counts.damaged == 0
    assert not list((tmp_path / "parts").iterdir())
    assert same_bits(store.get("a"), drawn(1))


def test_a_lock_that_nobody_lets_go_costs_a_write_and_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ledger, "LOCK_SECONDS", 0.05)
    store = ViewStore(10**6, tmp_path, 10**6)
    store.store("a", drawn(1), level=2)
    with locked(tmp_path):
        store.store("b", drawn(2), level=2)
        assert store.where("b") == 1
        assert same_bits(store.get("a"), drawn(1))
    assert "another process" in str(store.statistics.last_failure)
    store.store("c", drawn(3), level=2)
    assert store.where("c") == 2
    assert store.statistics.failed_writes == 1
    fresh = ViewStore(0, tmp_path, 10**6)
    assert same_bits(fresh.get("c"), drawn(3))
    assert fresh.get("b") is None
