"""The work of a node for a group: check its packages, fetch the view set, train, and send back each finished cell."""

import shutil
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.execution.cluster.mailbox import Handle, Key, Message
from harness.execution.cluster.view_set_files import Listing, node_folder, on_this_node
from harness.execution.group import run_group
from harness.machine.cores import own_cores
from harness.machine.device import available_cores
from harness.machine.provenance import differences, versions
from harness.plan.group_task import GroupTask
from harness.records.cells import CellRecord
from harness.records.snapshot import FOLDER as UNFINISHED
from scenes.files.errors import InputError

SENT = ("checkpoints", "records")
"""The folders of a node's output whose files are sent; records of cells travel as objects."""
LEAST_SECONDS_BETWEEN = 0.5
"""The minimum seconds between reports of progress."""


@dataclass(frozen=True)
class GroupOrder:
    """A group as it is sent to a node, with the driver's versions and commit, which sent sources do not contain."""

    task: GroupTask
    attempt: int
    view_set: Listing
    versions: dict[str, str]
    commit: str
    unfinished: dict[str, bytes] = field(default_factory=dict, repr=False)
    """Map path inside the output folder → content of a snapshot."""


def group_on_node(order: GroupOrder, mailbox: Handle, files: Handle) -> str | None:
    """Train the group; return why this node refuses it, or None. Raises `OSError` if its disk cannot be written."""
    import ray

    node = ray.get_runtime_context().get_node_id()[:8]
    if wrong := differences(order.versions, versions()):
        return wrong_node(node, wrong)
    key: Key = (order.task.scene, order.task.seed)

    def send(**news: Any) -> object:
        return mailbox.put.remote(Message(key, order.attempt, **news))

    def fetch(relative: str, offset: int) -> Any:
        return awaited(files.piece.remote(order.view_set.digest, relative, offset))

    last = 0.0
    times: dict[Path, int] = {}

    def on_progress(share: float) -> None:
        nonlocal last
        if kept := _kept_since(scratch, times):
            send(files=kept)
        if time.monotonic() - last >= LEAST_SECONDS_BETWEEN:
            last = time.monotonic()
            send(share=share)

    awaited(send(node=node))
    scratch = Path(tempfile.mkdtemp(prefix="group.", dir=node_folder()))
    try:
        view_set = on_this_node(order.view_set, fetch)
        for relative, content in order.unfinished.items():
            (scratch / UNFINISHED).mkdir(exist_ok=True)
            (scratch / relative).write_bytes(content)
        _kept_since(scratch, times)
        sent: set[Path] = set()

        def on_cell(cell: CellRecord) -> None:
            # wait until the driver's node has the cell, which is then never trained again
            awaited(send(cell=cell, files=_new_files(scratch, sent)))

        def on_notice(text: str) -> None:
            send(notice=f"{text} (node {node})")

        machine = available_cores()
        with own_cores(order.task.threads) as cores:
            placed = {"commit": order.commit, "node": node, "cores": machine, "own_cores": cores}
            run_group(replace(order.task, view_set=view_set, out=scratch), on_progress, on_cell, placed, on_notice)
    except InputError as error:
        return str(error)
    except OSError as error:
        raise OSError(error.errno, f"{error.strerror} on node {node}", error.filename) from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return None


def awaited(reference: object) -> Any:
    """Wait in another thread for `reference`: Ray lends a task's cores to other groups while its main thread waits."""
    import ray

    with ThreadPoolExecutor(1) as waiting:
        return waiting.submit(ray.get, reference).result()


def wrong_node(node: str, wrong: str) -> str:
    """Return the refusal of a node with other packages than the driver."""
    return (
        f"--executor ray: node {node} has {wrong}; install the same versions on every node (the same container image "
        "or environment), and start Ray there outside of any checkout of this program"
    )


def _kept_since(scratch: Path, times: dict[Path, int]) -> dict[str, bytes]:
    """Return the snapshots that were written since `times`, which is updated."""
    changed = {}
    for file in (scratch / UNFINISHED).glob("*.safetensors"):
        if times.get(file) != (now := file.stat().st_mtime_ns):
            times[file] = now
            changed[file.relative_to(scratch).as_posix()] = file.read_bytes()
    return changed


def _new_files(scratch: Path, sent: set[Path]) -> dict[str, bytes]:
    """Return the complete files that were not sent before, without records of cells."""
    files = {}
    for folder in SENT:
        for file in sorted((scratch / folder).rglob("*")):
            relative = file.relative_to(scratch)
            if file in sent or not file.is_file() or file.name.startswith(".") or relative.parts[1:2] == ("cells",):
                continue
            sent.add(file)
            files[relative.as_posix()] = file.read_bytes()
    return files
