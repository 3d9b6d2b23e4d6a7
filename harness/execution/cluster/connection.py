"""Connects to and disconnects from a Ray cluster, and describes the hardware of its nodes."""

import contextlib
import io
import os
import platform
import signal
import socket
import sys
import threading
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import torch

from harness.execution.cluster.node_work import wrong_node
from harness.execution.cluster.room import fits, needs_of
from harness.execution.cluster.view_set_files import node_folder
from harness.machine.cores import own_siblings, physical_cores
from harness.machine.device import chosen_device, multiplies_bfloat16
from harness.machine.provenance import differences, our_folders, processor, versions
from harness.machine.wait_policy import wait_policy
from scenes.files.errors import InputError, short

HOW_TO_INSTALL = (
    "--executor ray: Ray is not installed; `python -m pip install ray==2.60.0` (or the extra `ray` of pyproject.toml) "
    "puts it into this environment, and every node of a cluster needs the same version"
)
CHECK_SECONDS = 300.0
"""The maximum seconds for the first process on a node, which imports torch, perhaps from a slow disk."""
ANSWER_SECONDS = 10.0
"""The maximum seconds for a head to accept a connection; Ray itself would retry for a minute, and log it."""
_given_up = False


class NodeAnswer(TypedDict):
    versions: dict[str, str]
    processor: str
    bfloat16: bool
    cores: list[tuple[int, ...]]
    """The numbers of the hardware threads of each core."""
    machine: str
    """An identity that all containers of a machine share."""


@dataclass(frozen=True)
class Hardware:
    """The hardware of the cluster, as far as a plan depends on it."""

    gpus: int
    cores: int
    """The number of cores that the nodes offer to Ray."""
    bfloat16: bool
    """Whether every node that can run a cell multiplies bfloat16."""
    nodes: int
    processors: tuple[str, ...]
    crowded: tuple[str, ...]
    """A line per machine that offers more cores than it has: cells that share a core slow each other's clocks."""

    def line(self) -> str:
        gpus = f", {self.gpus} GPUs" if self.gpus else ""
        return f"Ray cluster: {self.nodes} nodes, {self.cores} cores{gpus} ({'; '.join(self.processors)})"


def connect(address: str | None) -> None:
    """Join the cluster at `address`, by default that of `RAY_ADDRESS`, else a new Ray of one node that ends with this
    process. Raises `InputError` without Ray, and if there is no cluster.
    """
    try:
        import ray
    except ImportError as error:
        raise InputError(HOW_TO_INSTALL) from error
    if ray.is_initialized():
        return
    address = address or os.environ.get("RAY_ADDRESS") or None
    if address and address.startswith(("ray://", "http")):
        raise InputError(
            f"--ray-address {address}: a driver outside of the cluster is not supported; run this command on one of "
            "its nodes (`ray job submit`, or a shell there) with --ray-address auto"
        )
    # sources are sent, so that a node needs no checkout; without a working folder Ray would first look for them in a
    # folder with the name of this one, and an edit during a run would stop it
    nothing = node_folder() / "nothing"
    nothing.mkdir(exist_ok=True)
    environment = {
        "py_modules": [str(folder) for folder in our_folders()],
        "excludes": ["__pycache__"],
        "working_dir": str(nothing),
        "env_vars": wait_policy(os.environ),
    }
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    handler = signal.getsignal(signal.SIGTERM)
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            _check_head(address)
            ray.init(
                # None would join the cluster that was last started on this machine
                address=address or "local",
                runtime_env=environment,
                log_to_driver=False,
                logging_level="ERROR",
                **({} if address else {"include_dashboard": False, "num_cpus": physical_cores()}),
            )
        # Ray replaces the run's handler (`scenes.files.stopping`)
        if handler is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)
        # the executor reports a dead node in one line
        ray._private.worker._worker_logs_enabled = False
    except ray.exceptions.AuthenticationError as error:
        raise InputError(
            f"--ray-address {address or 'unset'}: the Ray cluster asks for a token; set RAY_AUTH_MODE=token, its token "
            "in ~/.ray/auth_token or RAY_AUTH_TOKEN (`ray get-auth-token` on a node of it prints it)"
        ) from error
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        message = short(error)
        if "Version mismatch" in message:
            raise InputError(
                f"--ray-address {address}: the cluster runs another Ray or Python than this command ({message}); "
                "install the same versions on every node"
            ) from error
        if address is None:
            raise InputError(f"--executor ray: Ray does not start on this machine ({message})") from error
        raise InputError(
            f"--ray-address {address}: no Ray cluster there ({message}); start one with `ray start --head`, "
            "or leave the option out for a Ray on this machine only"
        ) from error


def _check_head(address: str | None) -> None:
    """Raise `OSError` if nothing accepts connections at an address of host and port; Ray checks other addresses."""
    host, _, port = (address or "").rpartition(":")
    if host and port.isdecimal() and int(port) < 1 << 16:
        socket.create_connection((host.strip("[]"), int(port)), timeout=ANSWER_SECONDS).close()


def disconnect() -> None:
    """End what `connect` started, unless the cluster was given up."""
    if not _given_up and (ray := sys.modules.get("ray")) is not None:
        ray.shutdown()  # also after a refused connection


def give_up() -> None:
    """Give up a cluster without a head: Ray would wait for it when leaving, and end this process."""
    global _given_up
    _given_up = True


def hardware(threads: int) -> Hardware:
    """Ask each node with `threads` cores. Raises `InputError` without one, for other packages, and for no answer."""
    import ray
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    alive = [node for node in ray.nodes() if node["Alive"]]
    able = [node for node in alive if fits(needs_of(threads, "cpu"), node)]
    if not able:
        most = max((node["Resources"].get("CPU", 0) for node in alive), default=0)
        raise InputError(f"--threads {threads}: no node of the Ray cluster has so many cores (the largest: {most:g})")
    ask = ray.remote(num_cpus=0, max_retries=0)(_this_node)
    places = [NodeAffinitySchedulingStrategy(node["NodeID"], soft=False) for node in able]
    references = [ask.options(scheduling_strategy=place).remote() for place in places]
    answers: list[NodeAnswer] = []
    offered: dict[str, float] = defaultdict(float)
    for node, reference in zip(able, references, strict=True):
        name = node["NodeID"][:8]
        answer: NodeAnswer = _answer_of(reference, f"node {name} runs nothing")
        if wrong := differences(versions(), answer["versions"]):
            raise InputError(wrong_node(name, wrong))
        answers.append(answer)
        offered[answer["machine"]] += node["Resources"]["CPU"]
    return Hardware(
        gpus=sum(int(node["Resources"].get("GPU", 0)) for node in able),
        cores=int(sum(node["Resources"].get("CPU", 0) for node in able)),
        bfloat16=all(answer["bfloat16"] for answer in answers),
        nodes=len(able),
        processors=tuple(sorted({answer["processor"] for answer in answers})),
        crowded=crowded(offered, answers),
    )


def crowded(offered: Mapping[str, float], answers: list[NodeAnswer]) -> tuple[str, ...]:
    """Describe the machines whose nodes, perhaps containers, offer more cores to Ray (`offered`) than they have."""
    own: dict[str, set[tuple[int, ...]]] = defaultdict(set)
    for answer in answers:
        own[answer["machine"]] |= set(answer["cores"])
    return tuple(
        f"{amount:g} cores are offered to Ray where there are {len(own[machine])}; cells that share a core are not "
        "timed alike (`ray start --num-cpus`)"
        for machine, amount in offered.items()
        if amount > len(own[machine])
    )


def gpus_multiply_bfloat16() -> bool:
    """Ask one GPU of the cluster whether it multiplies bfloat16; raises `InputError` if torch does not find it."""
    import ray

    reference = ray.remote(num_gpus=1, num_cpus=0, max_retries=0)(_gpu_multiplies_bfloat16).remote()
    answer: bool | str = _answer_of(reference, f"no GPU of the cluster was free for {CHECK_SECONDS:g} s")
    if isinstance(answer, str):
        raise InputError(answer)
    return answer


def _answer_of(reference: object, otherwise: str) -> Any:
    import ray

    try:
        return ray.get(reference, timeout=CHECK_SECONDS)
    except ray.exceptions.RayError as error:
        ray.cancel(reference, force=True)
        raise InputError(f"--executor ray: {otherwise} ({short(error)})") from error


def _this_node() -> NodeAnswer:
    boot = Path("/proc/sys/kernel/random/boot_id")
    return {
        "versions": versions(),
        "processor": processor(),
        "bfloat16": multiplies_bfloat16(torch.device("cpu")),
        "cores": own_siblings(),
        "machine": boot.read_text(encoding="utf-8").strip() if boot.exists() else platform.node(),
    }


def _gpu_multiplies_bfloat16() -> bool | str:
    import ray

    try:
        return multiplies_bfloat16(chosen_device("cuda"))
    except InputError as error:
        node = ray.get_runtime_context().get_node_id()[:8]
        return f"--executor ray: node {node} offers a GPU to Ray, but {str(error).removeprefix('--device cuda: ')}"
