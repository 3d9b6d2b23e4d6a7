"""Cores that two workers never share, GPUs of either vendor, and warnings about shared clocks."""

import os
from argparse import Namespace
from contextlib import ExitStack
from pathlib import Path

import pytest
import torch
from msgspec.structs import replace

from harness.command.machine_options import chosen_machine, shared_by, unused_by
from harness.command.main import parsed
from harness.machine.cores import _taken, chosen_cores, own_cores, physical_cores, quota_cores, siblings
from harness.machine.device import available_cores, only_gpu
from harness.machine.mixed_cells import mixed_hardware
from harness.plan.run_plan import Machine
from harness.records.cells import empty_cell

FOUR: list[tuple[int, ...]] = [(0, 4), (1, 5), (2, 6), (3, 7)]
"""Cores of two hardware threads each."""
ALL = set(range(8))
NAME = f"radiance-verdict-test-{os.getpid()}-"


def test_unused_cores_come_first_and_their_second_threads_last() -> None:
    assert chosen_cores(1, FOUR, ALL) == [0]
    assert chosen_cores(1, FOUR, ALL - {0}) == [1], "the other thread of a busy core is no core of its own"
    assert chosen_cores(3, FOUR, ALL - {0}) == [1, 2, 3]
    assert chosen_cores(2, FOUR, {4, 5, 3, 7}) == [3, 7], "both threads of one core rather than of two busy ones"
    assert chosen_cores(1, FOUR, {4}) == [], "the core of another worker is no core of its own"
    assert chosen_cores(3, FOUR, {0, 4}) == [], "too few"


linux = pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="only Linux binds processes to cores")


@linux
def test_a_taken_core_is_free_again_only_when_it_is_released() -> None:
    cores = [cpu for core in siblings(list(range(4))) for cpu in core]
    with ExitStack() as first, ExitStack() as second, ExitStack() as third:
        a, b = _taken(first, 2, cores, NAME), _taken(second, 1, cores, NAME)
        assert (len(a), len(b)) == (2, 1)
        assert not set(a) & set(b)
        assert _taken(third, 2, cores, NAME) == [], "one is left"
        first.close()
        assert _taken(third, 2, cores, NAME) == a


@linux
def test_a_process_is_bound_within_the_context() -> None:
    before = os.sched_getaffinity(0)
    with own_cores(1, NAME) as cores:
        assert cores is not None
        assert os.sched_getaffinity(0) == set(cores) <= before
        assert len(cores) == 1
    assert os.sched_getaffinity(0) == before
    with own_cores(len(before) + 1, NAME) as cores:
        assert cores == []
        assert os.sched_getaffinity(0) == before


@pytest.mark.parametrize(
    ("number", "count", "amd", "environment", "changed"),
    [
        (0, 1, False, {}, {}),
        (1, 4, False, {}, {"CUDA_VISIBLE_DEVICES": "1"}),
        (1, 2, False, {"CUDA_VISIBLE_DEVICES": "5, 7"}, {"CUDA_VISIBLE_DEVICES": "7"}),
        (5, 4, False, {}, {"CUDA_VISIBLE_DEVICES": "1"}),
        (2, 4, True, {}, {"HIP_VISIBLE_DEVICES": "2"}),
        (2, 4, True, {"ROCR_VISIBLE_DEVICES": "4,5,6,7"}, {"HIP_VISIBLE_DEVICES": "2"}),
        (0, 2, True, {"CUDA_VISIBLE_DEVICES": "2,3"}, {"CUDA_VISIBLE_DEVICES": "2"}),
        (1, 2, True, {"HIP_VISIBLE_DEVICES": "0,3", "CUDA_VISIBLE_DEVICES": "1"}, {"HIP_VISIBLE_DEVICES": "3"}),
        (1, 2, False, {"HIP_VISIBLE_DEVICES": "0,3"}, {"CUDA_VISIBLE_DEVICES": "1"}),
    ],
)
def test_a_worker_sees_one_gpu_of_those_that_its_user_allows(
    number: int, count: int, amd: bool, environment: dict[str, str], changed: dict[str, str]
) -> None:
    assert only_gpu(number, count, amd, environment) == changed


def test_more_threads_than_cores_and_more_workers_than_gpus_are_warned_of() -> None:
    assert shared_by(Machine("cpu", 4, 2), 8, 0) == shared_by(Machine("cuda", 2, 1), 8, 2) == []
    (warning,) = shared_by(Machine("cpu", 4, 2), 7, 0)
    assert "share 7 cores" in warning
    assert "--workers 3" in warning
    assert "3 workers share 2 GPUs" in shared_by(Machine("cuda", 3, 1), 8, 2)[0]


@pytest.mark.parametrize("mine", [[], None], ids=["shared", "a system without binding"])
def test_cells_that_shared_their_cores_are_counted(mine: list[int] | None, monkeypatch: pytest.MonkeyPatch) -> None:
    if mine is None:
        monkeypatch.delattr(os, "sched_setaffinity", raising=False)
        with own_cores(1, NAME) as cores:
            assert cores is None
    cells = [
        replace(empty_cell("a", method, 0, "done", ""), train_seconds=1.0, provenance={"own_cores": cores})
        for method, cores in (("nerf", [0]), ("qnerf", mine))
    ]
    (sentence,) = mixed_hardware(cells)
    assert sentence.endswith("1 of 2 could not be bound to any, so that their training seconds may be long.")


def test_idle_cores_are_reported() -> None:
    assert unused_by(Machine("cpu", 1, parsed(["run"]).threads), 2) == "; 1 of 2 cores idle, --threads 2 uses more"
    assert unused_by(Machine("cpu", 3, 1), 8) == "; 5 of 8 cores idle, --threads 2 uses more"
    for busy in (Machine("cpu", 2, 1), Machine("cpu", 1, 2), Machine("cuda", 1, 1), Machine("cpu", 1, 1, "ray")):
        assert unused_by(busy, 2) == ""
    assert unused_by(Machine("cpu", 3, 1), 4) == "", "three workers cannot share one more core"


EIGHT: list[tuple[int, ...]] = [(core, core + 8) for core in range(8)]


@pytest.mark.parametrize(
    ("asked", "groups", "machine", "warned"),
    [
        ({}, 100, Machine("cpu", 8, 1), False),
        ({}, 3, Machine("cpu", 3, 1), False),
        ({"workers": 8, "threads": 2}, 100, Machine("cpu", 8, 2), True),
        ({"workers": 4}, 100, Machine("cpu", 4, 1), False),
        ({"threads": 3}, 100, Machine("cpu", 2, 3), False),
    ],
)
def test_workers_of_a_machine_with_hardware_threads_have_cores_of_their_own(
    asked: dict[str, int], groups: int, machine: Machine, warned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.machine.cores.siblings", lambda cpus: EIGHT)
    monkeypatch.setattr("harness.machine.device.available_cores", lambda: 16)
    given = {"executor": "local", "workers": None, "threads": 1, "keep_every": machine.keep_every}
    options = Namespace(**{**given, **asked})
    warnings: list[str] = []
    assert chosen_machine(options, torch.device("cpu"), groups, warnings.append) == machine
    assert bool(warnings) == warned
    free, mine = set(range(16)), []
    for _ in range(machine.workers):
        mine.append(chosen_cores(machine.threads, EIGHT, free))
        free -= set(mine[-1])
    core_of = [{cpu % 8 for cpu in cpus} for cpus in mine]
    assert sum(map(len, core_of)) == len(set().union(*core_of)), "no two on one core"
    assert any(not cpus for cpus in mine) == warned


@pytest.mark.parametrize(
    ("groups", "files", "cores"),
    [
        ("0::/", {"cpu.max": "200000 100000\n"}, 2),
        ("0::/", {"cpu.max": "max 100000\n"}, None),
        ("0::/a/b", {"a/cpu.max": "350000 100000", "a/b/cpu.max": "max 100000"}, 3),
        ("0::/../x", {"cpu.max": "50000 100000"}, 1),
        (
            "3:cpuset:/\n1:cpu,cpuacct:/docker/1\n0::/",
            {"cpu,cpuacct/cpu.cfs_quota_us": "400000\n", "cpu,cpuacct/cpu.cfs_period_us": "100000\n"},
            4,
        ),
        ("1:cpu:/", {"cpu/cpu.cfs_quota_us": "-1", "cpu/cpu.cfs_period_us": "100000"}, None),
        ("", {}, None),
    ],
)
def test_a_time_quota_bounds_the_cores(groups: str, files: dict[str, str], cores: int | None, tmp_path: Path) -> None:
    for name, text in files.items():
        (tmp_path / "cgroup" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "cgroup" / name).write_text(text)
    (tmp_path / "own").write_text(groups)
    assert quota_cores(tmp_path / "cgroup", tmp_path / "own") == cores


def test_cores_under_a_quota_are_not_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(64)), raising=False)
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: pytest.fail("bound"), raising=False)
    for module in ("cores", "device"):
        monkeypatch.setattr(f"harness.machine.{module}.quota_cores", lambda: 2)
    assert (available_cores(), physical_cores()) == (2, 2)
    with own_cores(1, NAME) as cores:
        assert cores == []
