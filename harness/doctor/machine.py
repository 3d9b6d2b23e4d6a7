"""Cores, memory and disk that this process may use, limits of a container included."""

import math
import os
import shutil
from pathlib import Path

from harness.doctor.finding import Finding

CGROUP = Path("/sys/fs/cgroup")
WORKER_GB = 1.0
"""Memory of a worker at reduced size (`docs/speed.json`), rounded up."""
LEAST_GB = 2.0
ROOMY_GB = 2.0
LEAST_DISK_GB = 0.3
"""Eight view sets of 100 pixels, weights, records and the page of a default run take half of it."""


def core_findings() -> list[Finding]:
    """The smallest of what the machine has, what the process may run on, and what its container pays for."""
    machine = os.cpu_count() or 1
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else machine
    quota = cpu_quota()
    said = f"{allowed} of {machine} allowed" + (f", a quota of {quota:g}" if quota is not None else "")
    if quota is not None and quota < allowed:
        workers = max(1, math.floor(quota))
        return [Finding("cores", said, "limited", f"workers would wait for each other: --workers {workers}")]
    if allowed < 2:
        return [Finding("cores", said, "limited", "one cell at a time; a default run takes twice as long as with 2")]
    return [Finding("cores", said)]


def memory_findings() -> list[Finding]:
    limit, cores = memory_bytes(), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
    if limit is None:
        return [Finding("memory", "unknown", "limited", f"a worker takes {WORKER_GB:g} GB; choose --workers by that")]
    gigabytes = limit / 1e9
    said = f"{gigabytes:.1f} GB"
    if gigabytes < LEAST_GB:
        return [Finding("memory", said, "missing", f"a run needs {LEAST_GB:g} GB; --profile smoke may do", needed=True)]
    fit = math.floor(gigabytes / WORKER_GB) - 1
    if fit < cores:
        return [Finding("memory", said, "limited", f"enough for {fit} workers: --workers {fit}")]
    return [Finding("memory", said)]


def disk_findings(out: Path = Path("out")) -> list[Finding]:
    place = next(folder for folder in (out, *out.resolve().parents) if folder.is_dir())
    if not os.access(place, os.W_OK):
        return [Finding("disk at out/", "not writable", "missing", "give --out a folder of yours", needed=True)]
    free = shutil.disk_usage(place).free / 1e9
    said = f"{free:.1f} GB free"
    if free < LEAST_DISK_GB:
        return [Finding("disk at out/", said, "missing", "make room, or --out on another disk", needed=True)]
    if free < ROOMY_GB:
        return [Finding("disk at out/", said, "limited", "enough for a default run; make room for larger pictures")]
    return [Finding("disk at out/", said)]


def cpu_quota(root: Path = CGROUP) -> float | None:
    """Cores that the container pays for; None without such a limit."""
    try:
        allowed, period = (root / "cpu.max").read_text(encoding="utf-8").split()[:2]
        return None if allowed == "max" else int(allowed) / int(period)
    except (OSError, ValueError, ZeroDivisionError):
        pass
    try:
        microseconds = int((root / "cpu" / "cpu.cfs_quota_us").read_text(encoding="utf-8"))
        period_1 = int((root / "cpu" / "cpu.cfs_period_us").read_text(encoding="utf-8"))
        return microseconds / period_1 if microseconds > 0 else None
    except (OSError, ValueError, ZeroDivisionError):
        return None


def memory_bytes(root: Path = CGROUP, meminfo: Path = Path("/proc/meminfo")) -> int | None:
    """What there is, or what the container may use of it; None where neither can be read."""
    found = []
    for file in (root / "memory.max", root / "memory" / "memory.limit_in_bytes"):
        try:
            found.append(int(file.read_text(encoding="utf-8")))
        except (OSError, ValueError):  # "max" is no limit
            continue
    try:
        lines = meminfo.read_text(encoding="utf-8").splitlines()
        found += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemTotal:")]
    except (OSError, ValueError, IndexError):
        pass
    return min(found) if found else None
