"""Cores that are reserved for one worker: workers that share a core would measure each other.

A taken core is an abstract socket with its number, which the system frees with the process that holds it. So workers of
several runs, and of several Ray nodes on one machine, avoid each other; containers with separate networks do not.
"""

import os
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

NAME = "radiance-verdict-core-"
CHOOSING = "choosing"
"""The name held while a worker chooses, so that two do not take half of what each needs."""
LONGEST_CHOICE_SECONDS = 5.0


@contextmanager
def own_cores(count: int, name: str = NAME) -> Iterator[list[int] | None]:
    """Bind all threads of this process, within the context, to `count` cores that no other worker of this program has.
    Hardware threads of one core stay together, and are left idle if there are enough cores. Yields the numbers of the
    cores: none, binding nothing, if too few are free or a quota gives time on any core; None if the system cannot bind
    (all but Linux).
    """
    if not hasattr(os, "sched_setaffinity"):
        yield None
        return
    allowed, quota = os.sched_getaffinity(0), quota_cores()
    with ExitStack() as held:
        is_shared = quota is not None and quota < len(allowed)
        chosen = [] if is_shared else _taken(held, count, sorted(allowed), name)
        if chosen:
            _bind(set(chosen))
            held.callback(_bind, allowed)
        yield chosen


def physical_cores() -> int:
    """Count the cores that this process may run on, hardware threads of one core once; no more than its quota."""
    cores = len(own_siblings())
    return min(cores, quota_cores() or cores)


def allowed_cpus() -> list[int]:
    """Return the numbers of the hardware threads that this process may run on."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def own_siblings() -> list[tuple[int, ...]]:
    """Return the cores that this process may run on, each as the numbers of its hardware threads."""
    return siblings(allowed_cpus())


CONTROL_GROUPS, OWN_GROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")


def quota_cores(root: Path = CONTROL_GROUPS, groups: Path = OWN_GROUPS) -> int | None:
    """Return this process's quota of processor time (`docker run --cpus`) in whole cores, at least 1; None without."""
    quotas = []
    for folder in group_folders("cpu", root, groups):
        quota_and_period = _words(folder / "cpu.max")
        quota_and_period += _words(folder / "cpu.cfs_quota_us") + _words(folder / "cpu.cfs_period_us")
        # without a quota "max 100000", in the first version -1
        if len(quota_and_period) == 2 and all(word.isdecimal() for word in quota_and_period):
            quota, period = map(int, quota_and_period)
            quotas += [max(1, quota // period)] if period else []
    return min(quotas, default=None)


def group_folders(controller: str, root: Path = CONTROL_GROUPS, groups: Path = OWN_GROUPS) -> Iterator[Path]:
    """Yield the folders of this process's control groups for a controller, of either version, and those around them."""
    for line in _words(groups, "\n"):
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if controllers and controller not in controllers.split(","):
            continue
        top = root / controllers
        inside = top / path.strip("/")
        yield from {top, *(folder for folder in (inside, *inside.parents) if folder.is_relative_to(top))}


def _words(file: Path, between: str | None = None) -> list[str]:
    try:
        return file.read_text(encoding="utf-8").split(between)
    except (OSError, ValueError):
        return []


def siblings(cpus: list[int]) -> list[tuple[int, ...]]:
    """Group `cpus` by the core whose hardware threads they are; each is a core if the system does not report it."""
    by_core: dict[str, list[int]] = {}
    for cpu in cpus:
        listed = _words(Path(f"/sys/devices/system/cpu/cpu{cpu}/topology/thread_siblings_list"))
        by_core.setdefault(" ".join(listed) or str(cpu), []).append(cpu)
    return [tuple(group) for group in by_core.values()]


def chosen_cores(count: int, cores: list[tuple[int, ...]], free: set[int]) -> list[int]:
    """Choose `count` threads of cores that are entirely `free`, first one per core; return [] if there are too few."""
    unused = [core for core in cores if set(core) <= free]
    chosen = [*(core[0] for core in unused), *(cpu for core in unused for cpu in core[1:])][:count]
    return sorted(chosen) if len(chosen) == count else []


def _taken(held: ExitStack, count: int, allowed: list[int], name: str) -> list[int]:
    with ExitStack() as choosing:
        until = time.monotonic() + LONGEST_CHOICE_SECONDS
        while not _take(choosing, f"{name}{CHOOSING}"):
            if time.monotonic() > until:
                return []
            time.sleep(0.01)
        trial = ExitStack()
        with trial:
            free = {cpu for cpu in allowed if _take(trial, f"{name}{cpu}")}
        chosen = chosen_cores(count, siblings(allowed), free)
        return chosen if all(_take(held, f"{name}{cpu}") for cpu in chosen) else []


def _take(held: ExitStack, name: str) -> bool:
    taken = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        taken.bind(f"\0{name}")
    except OSError:
        taken.close()
        return False
    held.callback(taken.close)
    return True


def _bind(cpus: set[int]) -> None:
    """Bind every thread, including those that torch started before."""
    for thread in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # it has ended meanwhile
            os.sched_setaffinity(int(thread.name), cpus)
