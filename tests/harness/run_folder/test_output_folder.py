"""The folder that a run writes to: fresh or resumed, never one in use; a holder that dies leaves no lock."""

import errno
import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from harness.command.plan_options import planned
from harness.plan.run_plan import Machine, Plan
from harness.records.cells import write_cell
from harness.records.json_record import load_record, write_json, write_record
from harness.run_folder import output_folder
from harness.run_folder.folder_lock import LOCK_FILE, lock_folder, locked_folder
from harness.run_folder.output_folder import claim, fresh_folder, point_latest_to, release, resumable_record
from scenes.files.errors import InputError
from scenes.files.lock import is_held
from tests.harness.cells import diverged
from tests.replacing import replace

MACHINE = Machine("cpu", 2, 1)
PLAN = "records/plan.json"


@pytest.fixture
def plan() -> Plan:
    return planned("smoke", scenes=["lego"])


@pytest.fixture
def out(tmp_path: Path, plan: Plan) -> Path:
    """A folder with results."""
    claim(tmp_path / "run", plan, MACHINE, resume=False)
    write_json(tmp_path / "run" / "records" / "run.json", {})
    write_cell(tmp_path / "run", diverged("lego", "nerf", 0))
    return tmp_path / "run"


def resumed(out: Path, plan: Plan) -> list[str]:
    """Return the printed lines of a resumed run, whose plan is then that of a fresh one."""
    lines: list[str] = []
    with output_folder.claimed(out, plan, MACHINE, True, lines.append):
        pass
    assert load_record(out / PLAN) == json.loads(json.dumps({**plan.settings(), "machine": MACHINE.settings()}))
    return lines


def test_results_are_kept_unless_the_run_is_resumed(out: Path, plan: Plan) -> None:
    with pytest.raises(InputError, match="holds results already; name another folder, or add --resume"):
        claim(out, plan, MACHINE, resume=False)
    before = sorted(out.rglob("*"))
    release(out)
    assert sorted(out.rglob("*")) == before
    claim(out, plan, MACHINE, resume=True)


@pytest.mark.parametrize(
    ("mine", "resume", "words"),
    [
        (["letter.txt"], False, "in use by something else"),
        (["letter.txt"], True, "in use by something else"),
        ([], True, "holds no run to resume"),
    ],
)
def test_a_folder_of_somebody_else_or_without_a_run_is_refused(
    tmp_path: Path, plan: Plan, mine: list[str], resume: bool, words: str
) -> None:
    for name in mine:
        (tmp_path / name).write_text("mine")
    with pytest.raises(InputError, match=words):
        claim(tmp_path, plan, MACHINE, resume)
    assert [file.name for file in tmp_path.iterdir()] == mine


@pytest.mark.parametrize(
    ("options", "machine", "words"),
    [
        ({"seeds": 1}, {}, r"another plan .*seeds was \[0, 1\], is \[0\]"),
        ({"budget_steps": 7}, {}, r"another plan .*budget\.steps was 60, is 7"),
        ({}, {"threads": 2}, r"machine\.threads was"),
        ({}, {"device": "cuda"}, r"machine\.device was"),
        ({}, {"workers": 1}, r"machine\.workers was"),
        ({}, {"workers": 64, "threads": 2, "executor": "ray"}, r"machine\.threads was"),
    ],
)
def test_another_plan_and_a_machine_with_other_clocks_are_refused(
    out: Path, options: dict[str, int], machine: dict[str, object], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        claim(out, planned("smoke", scenes=["lego"], **options), replace(MACHINE, **machine), resume=True)


def test_a_run_goes_on_on_a_cluster_of_any_size_and_back_here(out: Path, plan: Plan) -> None:
    cluster = Machine("cpu", 64, MACHINE.threads, "ray")
    for machine in (cluster, replace(cluster, workers=8), Machine("cpu", 1, MACHINE.threads, "local")):
        claim(out, plan, machine, resume=True)


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"seeds": 1'])
def test_a_lost_plan_is_written_again_from_options_that_match_the_cells(out: Path, plan: Plan, content: str) -> None:
    write_cell(out, replace(diverged("lego", "nerf", 0), settings={"budget": plan.budget.settings()}))
    (out / PLAN).write_text(content)
    other = planned("smoke", scenes=["lego"], budget_steps=7)
    with pytest.raises(InputError, match=r"plan\.json: .*cannot be made again.*lego\.nerf\.0: budget was"):
        claim(out, other, MACHINE, resume=True)
    assert (out / PLAN).read_text() == content
    resumed(out, plan)


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()
    (file / "letter.txt").write_text("mine")


@pytest.mark.parametrize(
    "damage",
    [
        lambda file: write_record(file, {**load_record(file), "machine": None}),
        lambda file: write_record(file, {**load_record(file), "machine": "cpu"}),
        lambda file: file.write_text(file.read_text().replace("digest", "dagest")),
        folder_instead,
    ],
)
def test_a_damaged_plan_is_reported_and_written_again(out: Path, plan: Plan, damage: Callable[[Path], object]) -> None:
    assert not any(PLAN in line for line in resumed(out, plan))
    damage(out / PLAN)
    assert resumed(out, plan)[0].startswith(f"{PLAN}: ")
    if damage is folder_instead:
        assert (out / "damaged" / "records.plan.json.1" / "letter.txt").read_text() == "mine"


def test_a_missing_record_is_made_again_only_if_it_was_quarantined(tmp_path: Path) -> None:
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "records.run.json.1").write_text("{")
    (part := tmp_path / ".speed.json.1234.part").write_text("{")
    lines: list[str] = []
    with pytest.raises(InputError, match=r"holds no speed\.json to resume"):
        resumable_record(tmp_path, "speed.json", True, load_record, lines.append)
    assert part.exists(), "leftovers are removed only from a known folder"
    (tmp_path / "damaged" / "speed.json.1").write_text("{")
    assert resumable_record(tmp_path, "speed.json", True, load_record, lines.append) is None
    assert lines == ["speed.json: missing: everything in it is measured again"]
    assert not part.exists()


def test_a_start_without_room_to_write_is_refused(tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as nearly_full:
        nearly_full.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=output_folder.LEAST_FREE_BYTES - 1))
        with pytest.raises(InputError, match="make room"):
            claim(tmp_path / "run", plan, MACHINE, resume=False)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        claim(tmp_path / "file" / "run", plan, MACHINE, resume=False)
    claim(tmp_path / "run", plan, MACHINE, resume=False)


def test_default_folders_are_fresh_each_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.strftime", lambda _: "20260102-030405")
    names = []
    for _ in range(3):
        folder = fresh_folder("smoke", resume=False)
        folder.mkdir(parents=True)
        names.append(folder.as_posix())
    stem = "out/smoke-20260102-030405"
    assert names == [stem, f"{stem}-2", f"{stem}-3"]


def test_latest_is_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("smoke-1", "smoke-2"):
        (tmp_path / "out" / name).mkdir(parents=True)
        point_latest_to(Path("out") / name)
    assert fresh_folder("smoke", resume=True) == (tmp_path / "out" / "smoke-2").resolve()
    assert not (tmp_path / "out" / "latest").readlink().is_absolute()
    (tmp_path / "elsewhere").mkdir()
    point_latest_to(tmp_path / "elsewhere")
    assert (tmp_path / "out" / "latest").resolve().name == "smoke-2"


# the lock


def holder(out: Path) -> int:
    """Return the process id of a fork that holds the lock until it is killed."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        lock_folder(out)
        os.write(theirs, b"x")
        time.sleep(60)
        os._exit(0)
    assert os.read(ours, 1) == b"x"
    return child


def test_the_second_is_refused_with_the_name_of_the_holder_and_a_killed_holder_leaves_nothing(tmp_path: Path) -> None:
    child = holder(tmp_path)
    try:
        with pytest.raises(InputError, match=rf"in use by process {child} on .*; let that end"):
            lock_folder(tmp_path)
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert is_held(tmp_path / LOCK_FILE) is False
    with locked_folder(tmp_path) as lock:
        assert lock.is_held
    assert list(tmp_path.iterdir()) == []


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
