"""A real Ray cluster of a head and three nodes, of which one is killed while it trains."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.execution.cluster.connection import connect, disconnect, hardware
from harness.execution.cluster.node_work import GroupOrder
from harness.execution.group_loop import Event
from harness.execution.ray_executor import run_on_ray
from harness.machine.provenance import versions
from harness.records.cells import read_cells
from scenes.files.errors import InputError
from tests.harness.execution.on_two_executors import COMMIT, SLOW_SCORES, Told, require_the_bits_of_workers, tasks
from tests.harness.shell import refused
from tests.replacing import replace

pytestmark = pytest.mark.timeout(1800)
"""On a busy machine, Ray's processes and twelve trainings take many minutes."""


@pytest.mark.parametrize("package", ["ray", "submitit"])
def test_without_its_package_an_executor_says_how_to_install_it(
    package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    said = refused(capsys, "--profile", "smoke", "--executor", package, "--out", tmp_path / "run")
    assert f"--executor {package}: {package} is not installed; `python -m pip install {package}==" in said.lower()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a head that trains nothing and three nodes of one core, each with its own temporary folder."""
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    from ray._private import services
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # on a busy machine: workers would wait for everything else, and Ray gives a node half a minute to start
        patch.setenv("RAY_worker_niceness", "0")
        for limit in ("health_check_timeout", "agent_register_timeout"):
            patch.setenv(f"RAY_{limit}_ms", "300000")
        patch.setattr(services, "get_node", patient(services.get_node))
        found = Cluster()
        found.add_node(num_cpus=0, include_dashboard=False, wait=False)
        for number in range(3):
            scratch = tmp_path_factory.mktemp(f"node{number}")
            found.add_node(num_cpus=1, env_vars={"TMPDIR": str(scratch)}, wait=False)
        yield found
        disconnect()
        found.shutdown()


def patient(ask: Callable[..., Any]) -> Callable[..., Any]:
    """Return `ask`, which is repeated for some minutes."""

    def ask_again(*given: Any) -> Any:
        until = time.monotonic() + 300
        while True:
            try:
                return ask(*given)
            except RuntimeError:
                if time.monotonic() > until:
                    raise
                time.sleep(0.2)

    return ask_again


@pytest.fixture
def joined(cluster: Any) -> Iterator[Any]:
    before = signal.getsignal(signal.SIGTERM)
    connect(cluster.address)
    assert signal.getsignal(signal.SIGTERM) is before, "the handler of a run stays"
    yield cluster
    disconnect()


def not_on_the_drivers_disk(*parts: Any) -> GroupOrder:
    order = GroupOrder(*parts)
    return replace(order, view_set=replace(order.view_set, folder=Path("/not/on/this/node/ball")))


@pytest.mark.slow
@pytest.mark.cluster
def test_a_killed_node_costs_time_and_changes_no_bit(
    joined: Any, ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.execution.ray_executor.GroupOrder", not_on_the_drivers_disk)
    ours = tasks(ball_folder, tmp_path / "ray", 3, SLOW_SCORES, keep_every=0.0)
    events: list[Event] = []
    killed = ""
    kept: dict[Path, bytes] = {}
    for event in run_on_ray(ours, COMMIT):
        events.append(event)
        if event.cell is not None and not killed:
            killed = event.cell.provenance["node"]
            kept = {file: file.read_bytes() for file in (tmp_path / "ray/records/cells").iterdir()}
            (victim,) = [node for node in joined.worker_nodes if node.node_id.startswith(killed)]
            joined.remove_node(victim, allow_graceful=False)
    assert killed, "no cell ended"
    notice, going_on = [event for event in events if event.notice is not None]
    assert f"the node died (node {killed})" in notice.notice
    assert "1 of its cells had ended and are kept; 1 cells are trained again, 1 of them from" in notice.notice
    assert f"seed {notice.task.seed}: resumes at step " in going_on.notice
    cells = {(cell.method, cell.seed): cell for cell in read_cells(tmp_path / "ray")}
    assert {cell.status for cell in cells.values()} == {"done"}
    again = [cell for cell in cells.values() if cell.seed == notice.task.seed]
    assert sum(cell.provenance["node"] == killed for cell in again) == 1, "one cell from before its node died"
    assert sum(cell.provenance["node"] == killed for cell in cells.values()) == 1
    assert ["resumed_at" in cell.provenance for cell in again if cell.provenance["node"] != killed] == [True]
    assert len({cell.provenance["node"] for cell in cells.values()}) == 3
    assert all(file.read_bytes() == before for file, before in kept.items()), "what was finished stays as it was"
    told = Told(events)
    assert told.cells == sorted(cells), "each cell once"
    assert [told.shares[seed][-1] for seed in range(3)] == [1.0] * 3
    require_the_bits_of_workers(ball_folder, tmp_path / "ray", tmp_path / "here", 3)


@pytest.mark.slow
@pytest.mark.cluster
def test_a_node_with_another_torch_is_refused_by_name(
    joined: Any, ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert hardware(1).nodes >= 2
    with pytest.raises(InputError, match="--threads 2: no node of the Ray cluster has so many cores"):
        hardware(2)
    other = {**versions(), "torch": "99.0"}
    monkeypatch.setattr("harness.execution.cluster.connection.versions", lambda: other)
    with pytest.raises(InputError, match=r"node [0-9a-f]{8} has torch .* instead of 99\.0"):
        hardware(1)
    monkeypatch.setattr("harness.execution.ray_executor.versions", lambda: other)
    with pytest.raises(InputError, match=r"node [0-9a-f]{8} has torch .* instead of 99\.0"):
        list(run_on_ray(tasks(ball_folder, tmp_path, 1, SLOW_SCORES), "none"))
    assert not list(tmp_path.rglob("*.json"))


@pytest.mark.slow
@pytest.mark.cluster
def test_a_group_that_waits_for_the_driver_keeps_its_core(joined: Any) -> None:
    """Ray lends the cores of a task that waits to the next one, and two clocks would share a core."""
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    def waits_for(slow: Any, seconds: float) -> tuple[float, float]:
        from harness.execution.cluster.node_work import awaited

        began = time.time()
        awaited(slow.nap.remote(seconds))
        return began, time.time()

    class Slow:
        def nap(self, seconds: float) -> None:
            time.sleep(seconds)

    here = NodeAffinitySchedulingStrategy(next(iter(joined.worker_nodes)).node_id, soft=False)
    slow = ray.remote(num_cpus=0, max_concurrency=2)(Slow).remote()
    wait = ray.remote(max_retries=0)(waits_for)
    # two processes on the node first: a new one would take longer than the other waits
    ray.get([wait.options(num_cpus=0, scheduling_strategy=here).remote(slow, 5.0) for _ in range(2)])
    asked = [wait.options(num_cpus=1, scheduling_strategy=here).remote(slow, 3.0) for _ in range(2)]
    (first, first_end), (second, second_end) = ray.get(asked)
    assert second >= first_end or first >= second_end


@pytest.mark.slow
@pytest.mark.cluster
def test_a_group_that_no_node_can_hold_ends_the_run_in_words(
    joined: Any, ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.execution.cluster.room.LONGEST_WAIT_SECONDS", 0.5)
    for changes, lacks in (({"threads": 2}, "takes 2 cores"), ({"device": "cuda"}, "takes 1 cores and 1 GPUs")):
        events = run_on_ray(tasks(ball_folder, tmp_path, 1, SLOW_SCORES, **changes), "none")
        assert lacks in (next(events).notice or "")
        with pytest.raises(InputError, match=f"{lacks}, and none of the [34] nodes alive has that.*--resume"):
            list(events)


@pytest.mark.slow
@pytest.mark.cluster
def test_a_cluster_of_another_ray_is_refused(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ray.__version__", "1.0")
    with pytest.raises(InputError, match=r"another Ray or Python than this command .*Ray: 2.*Ray: 1\.0"):
        connect(cluster.address)
    disconnect()


def test_an_address_at_which_nothing_answers_is_named() -> None:
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    with pytest.raises(InputError, match=r"--ray-address 127\.0\.0\.1:1: no Ray cluster there \(.*refused\)"):
        connect("127.0.0.1:1")


@pytest.mark.slow
@pytest.mark.cluster
def test_where_no_cluster_is_it_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    with pytest.raises(InputError, match="a driver outside of the cluster is not supported"):
        connect("ray://head:10001")
    said = refused(capsys, "--profile", "smoke", "--executor", "ray", "--workers", "3")
    assert "--workers: on Ray the cluster decides" in said
