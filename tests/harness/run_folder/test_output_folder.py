"""The folder that a run writes to: fresh, or gone on with, never one in use."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from harness.command.plan_options import planned
from harness.plan.profiles import Machine, Plan
from harness.records.cells import write_cell
from harness.records.json_record import load_record, write_json, write_record
from harness.run_folder.output_folder import (
    LEAST_FREE_BYTES,
    claim,
    claimed,
    fresh_folder,
    gone_on_with,
    point_latest_to,
    release,
)
from scenes.files.errors import InputError
from tests.harness.cells import diverged
from tests.replacing import replace

MACHINE = Machine("cpu", 2, 1)


@pytest.fixture
def plan() -> Plan:
    return planned("smoke", scenes=["lego"])


def with_results(out: Path, plan: Plan) -> Path:
    claim(out, plan, MACHINE, resume=False)
    write_json(out / "records" / "run.json", {})
    write_cell(out, diverged("lego", "nerf", 0))
    return out


def test_a_fresh_folder_holds_its_plan(tmp_path: Path, plan: Plan) -> None:
    claim(tmp_path / "a" / "b", plan, MACHINE, resume=False)
    stored = load_record(tmp_path / "a" / "b" / "records" / "plan.json")
    assert stored == json.loads(json.dumps({**plan.settings(), "machine": MACHINE.settings()}))


def test_results_are_kept_unless_they_are_gone_on_with(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    with pytest.raises(InputError, match="holds results already; name another folder, or go on with --resume"):
        claim(out, plan, MACHINE, resume=False)
    claim(out, plan, MACHINE, resume=True)


@pytest.mark.parametrize(
    ("mine", "resume", "words"),
    [
        (["letter.txt"], False, "in use by something else"),
        (["letter.txt"], True, "in use by something else"),
        ([], True, "holds no run to go on with"),
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


def test_another_plan_is_not_gone_on_with(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    other = planned("smoke", scenes=["lego"], seeds=1, budget_steps=7)
    with pytest.raises(InputError) as caught:
        claim(out, other, MACHINE, resume=True)
    assert "another plan" in str(caught.value)
    assert "seeds was [0, 1], is [0]" in str(caught.value)
    assert "budget.steps was 60, is 7" in str(caught.value)
    claim(out, plan, MACHINE, resume=True)


def test_another_machine_has_other_clocks(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    for other in (replace(MACHINE, threads=2), replace(MACHINE, device="cuda"), replace(MACHINE, workers=1)):
        with pytest.raises(InputError, match=r"machine\.\w+ was"):
            claim(out, plan, other, resume=True)


def test_a_run_goes_on_from_a_cluster_on_one_machine_and_back(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    for executor, workers in (("ray", 64), ("ray", 8), ("local", 1)):
        claim(out, plan, Machine("cpu", workers, MACHINE.threads, executor), resume=True)
    with pytest.raises(InputError, match=r"machine\.threads was 1, is 2"):
        claim(out, plan, Machine("cpu", 64, 2, "ray"), resume=True)


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"seeds": 1'])
def test_a_plan_that_is_lost_is_what_the_options_say_where_that_fits(tmp_path: Path, plan: Plan, content: str) -> None:
    out = with_results(tmp_path / "run", plan)
    sound = (out / "records" / "plan.json").read_text()
    write_cell(out, replace(diverged("lego", "nerf", 0), settings={"budget": plan.budget.settings()}))
    (out / "records" / "plan.json").write_text(content)
    other = planned("smoke", scenes=["lego"], budget_steps=7)
    with pytest.raises(InputError, match=r"plan\.json: .*cannot be made again.*lego\.nerf\.0: budget was"):
        claim(out, other, MACHINE, resume=True)
    assert (out / "records" / "plan.json").read_text() == content
    claim(out, plan, MACHINE, resume=True)
    assert (out / "records" / "plan.json").read_text() == sound


@pytest.mark.parametrize("machine", [None, [], "cpu", 7])
def test_a_machine_that_is_none_is_damage(tmp_path: Path, plan: Plan, machine: Any) -> None:
    out = with_results(tmp_path / "run", plan)
    file = out / "records" / "plan.json"
    sound = file.read_text()
    write_record(file, {**load_record(file), "machine": machine})
    claim(out, plan, MACHINE, resume=True)
    assert file.read_text() == sound


def test_a_folder_in_the_plans_place_is_moved_aside(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    file = out / "records" / "plan.json"
    sound = file.read_text()
    file.unlink()
    file.mkdir()
    (file / "letter.txt").write_text("mine")
    lines: list[str] = []
    with claimed(out, plan, MACHINE, True, lines.append):
        pass
    assert lines[0].startswith("records/plan.json: ")
    assert file.read_text() == sound
    assert (out / "damaged" / "records.plan.json.1" / "letter.txt").read_text() == "mine"


@pytest.mark.parametrize("key", ['"digest"', '"dagest"', '"Digest"'])
def test_a_flip_in_the_key_of_the_digest_is_damage(tmp_path: Path, plan: Plan, key: str) -> None:
    out = with_results(tmp_path / "run", plan)
    file = out / "records" / "plan.json"
    sound = file.read_text()
    file.write_text(sound.replace('"digest"', key))
    lines: list[str] = []
    with claimed(out, plan, MACHINE, True, lines.append):
        pass
    assert any("plan.json" in line for line in lines) == (key != '"digest"')
    assert file.read_text() == sound


@pytest.mark.parametrize("aside", ["speed.json.1", "records.run.json.1"])
def test_a_record_that_is_missing_is_made_again_where_it_was_moved_aside_and_nowhere_else(
    tmp_path: Path, aside: str
) -> None:
    ours = aside.startswith("speed")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / aside).write_text("{")
    part = tmp_path / ".speed.json.1234.part"
    part.write_text("{")
    lines: list[str] = []
    if not ours:
        with pytest.raises(InputError, match=r"holds no speed\.json to go on with"):
            gone_on_with(tmp_path, "speed.json", True, load_record, lines.append)
    else:
        assert gone_on_with(tmp_path, "speed.json", True, load_record, lines.append) is None
    assert lines == (["speed.json: missing: everything in it is measured again"] if ours else [])
    assert part.exists() != ours, "what a killed writer left in a folder of ours"


def test_a_start_that_is_refused_for_want_of_room_leaves_nothing(
    tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as nearly_full:
        nearly_full.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=LEAST_FREE_BYTES - 1))
        with pytest.raises(InputError, match="make room"):
            claim(tmp_path / "run", plan, MACHINE, resume=False)
    assert list(tmp_path.iterdir()) == []
    claim(tmp_path / "run", plan, MACHINE, resume=False)


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path, plan: Plan) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file; name a folder"):
        claim(tmp_path / "file", plan, MACHINE, resume=False)
    with pytest.raises(InputError, match="cannot be written"):
        claim(tmp_path / "file" / "run", plan, MACHINE, resume=False)


def test_a_claim_that_led_to_nothing_is_given_up(tmp_path: Path, plan: Plan) -> None:
    claim(tmp_path / "run", plan, MACHINE, resume=False)
    release(tmp_path / "run")
    assert list(tmp_path.iterdir()) == []


def test_results_are_never_given_up(tmp_path: Path, plan: Plan) -> None:
    out = with_results(tmp_path / "run", plan)
    before = sorted(out.rglob("*"))
    release(out)
    assert sorted(out.rglob("*")) == before


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


def test_latest_is_what_is_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("smoke-1", "smoke-2"):
        (tmp_path / "out" / name).mkdir(parents=True)
        point_latest_to(Path("out") / name)
    assert fresh_folder("smoke", resume=True) == (tmp_path / "out" / "smoke-2").resolve()
    assert not (tmp_path / "out" / "latest").readlink().is_absolute()
    (tmp_path / "elsewhere").mkdir()
    point_latest_to(tmp_path / "elsewhere")
    assert (tmp_path / "out" / "latest").resolve().name == "smoke-2"
