"""Probes of this machine: each yields findings, and an error that it raises is a finding too."""

import ctypes.util
import math
import os
import platform
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from harness.machine.cores import CONTROL_GROUPS, OWN_GROUPS, allowed_cpus, group_folders, own_cores, quota_cores
from harness.machine.wait_policy import SPINS, VARIABLE
from scenes.files.errors import named
from scenes.files.json_object import JsonObject
from scenes.rendering.variant import OLDEST_LLVM, llvm_libraries, probe

Verdict = Literal["ok", "limited", "missing"]
WORKER_GB = 1.0
"""The memory of a worker at reduced size (`docs/speed.json`), rounded up."""
LEAST_GB = 2.0
ROOMY_GB = 2.0
LEAST_DISK_GB = 0.3
"""Twice the disk space of a default run: eight view sets of 100 pixels, weights, records and the page."""
PROJECT = Path(__file__).parents[2] / "pyproject.toml"
RENEW = "start the command through nox, which installs tested versions, or install one that pyproject.toml allows"
EXTRAS = {
    "view": "`view`",
    "film": "`film`",
    "stability": "`study stability`",
    "ray": "--executor ray",
    "submitit": "--executor submitit",
    "tensorboard": "--tensorboard",
}
"""Map extra of `pyproject.toml` → the option that needs it."""
TOOLS: tuple[tuple[tuple[str, ...], str, str], ...] = (
    (("nox",), "`nox -s …` makes the environments", 'python -m pip install "nox[uv]"'),
    (("uv",), "nox makes its environments with it", 'python -m pip install "nox[uv]"'),
    (("git",), "records name their commit by it", "install git"),
    (
        ("chromium", "chromium-browser", "google-chrome"),
        "tests of the pages in a browser are skipped without it",
        "install it (Debian: apt install chromium)",
    ),
)
"""Names to try · purpose · remedy."""
FLAGS = ("avx2", "avx512f", "avx512_bf16", "amx_tile", "amx_bf16", "asimd", "bf16")
INSTALL_LLVM = (
    f"install the shared library of LLVM {OLDEST_LLVM} or newer (Debian: apt install libllvm19), or name it in "
    "DRJIT_LIBLLVM_PATH"
)


@dataclass(frozen=True)
class Finding:
    what: str
    found: str
    verdict: Verdict = "ok"
    to_do: str = ""
    """The remedy if the verdict is not ok."""
    needed: bool = False
    """True if nothing works without it: `missing` then ends with exit code 2."""


def judge(what: str, found: str, *faults: tuple[bool, Verdict, str]) -> Finding:
    """Return a finding with the first of `faults` (is it present, verdict, remedy) that is present."""
    for is_present, verdict, to_do in faults:
        if is_present:
            return Finding(what, found, verdict, to_do, needed=verdict == "missing")
    return Finding(what, found)


def core_findings() -> Iterator[Finding]:
    allowed, quota = len(allowed_cpus()), quota_cores()
    yield judge(
        "cores",
        f"{allowed} of {os.cpu_count() or 1} allowed" + (f", a quota of {quota}" if quota is not None else ""),
        ((quota or allowed) < allowed, "limited", f"workers would wait for each other: --workers {quota}"),
        (allowed < 2, "limited", "one cell at a time; a default run takes twice as long as with 2"),
    )


def memory_findings() -> Iterator[Finding]:
    limit = memory_bytes()
    gigabytes = (limit or 0) / 1e9
    fit = math.floor(gigabytes / WORKER_GB) - 1
    yield judge(
        "memory",
        "unknown" if limit is None else f"{gigabytes:.1f} GB",
        (limit is None, "limited", f"a worker takes {WORKER_GB:g} GB; choose --workers by that"),
        (gigabytes < LEAST_GB, "missing", f"a run needs {LEAST_GB:g} GB; --profile smoke may do"),
        (fit < len(allowed_cpus()), "limited", f"enough for {fit} workers: --workers {fit}"),
    )


def memory_bytes(
    root: Path = CONTROL_GROUPS, groups: Path = OWN_GROUPS, meminfo: Path = Path("/proc/meminfo")
) -> int | None:
    """Return the memory of the machine, or of a container or job around this process if that is less; None: unknown."""
    limits = []
    for folder in group_folders("memory", root, groups):
        for name in ("memory.max", "memory.limit_in_bytes"):
            with suppress(OSError, ValueError):  # "max" is no limit
                limits.append(int((folder / name).read_text(encoding="utf-8")))
    with suppress(OSError, ValueError, IndexError):
        lines = meminfo.read_text(encoding="utf-8").splitlines()
        limits += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemTotal:")]
    return min(limits, default=None)


def disk_findings(out: Path = Path("out")) -> Iterator[Finding]:
    place = next(folder for folder in (out, *out.resolve().parents) if folder.is_dir())
    writable, free = os.access(place, os.W_OK), shutil.disk_usage(place).free / 1e9
    yield judge(
        "disk at out/",
        f"{free:.1f} GB free" if writable else "not writable",
        (not writable, "missing", "give --out a folder of yours"),
        (free < LEAST_DISK_GB, "missing", "make room, or --out on another disk"),
        (free < ROOMY_GB, "limited", "enough for a default run; make room for larger pictures"),
    )


def python_findings() -> Iterator[Finding]:
    oldest = str(_project()["project"]["requires-python"]).removeprefix(">=")
    here = platform.python_version()
    is_old = _numbers(here)[:2] < _numbers(oldest)[:2]
    text = here if is_old else f"{here} on {platform.system()} {platform.machine()}"
    yield judge("Python", text, (is_old, "missing", f"install Python {oldest} or newer"))


def package_findings() -> Iterator[Finding]:
    ranges = _ranges(_project()["project"]["dependencies"])
    findings = [_within(name, tested, f"{RENEW}: {name}{tested}", needed=True) for name, tested in ranges.items()]
    odd = [finding for finding in findings if finding.verdict != "ok"]
    yield Finding("packages", f"{len(findings) - len(odd)} of {len(findings)} as tested")
    yield from odd


def optional_findings() -> Iterator[Finding]:
    extras = _project()["project"].get("optional-dependencies", {})
    for extra, purpose in EXTRAS.items():
        for name, tested in _ranges(extras.get(extra, [])).items():
            yield _within(name, tested, f"only for {purpose}: install {name}{tested}", needed=False)


def _ranges(requirements: list[str]) -> dict[str, str]:
    """Map name → range, such as `>=2.11,<2.16`."""
    matches = (re.match(r"([A-Za-z0-9._-]+)(>=[\d.]+,<[\d.]+)$", line) for line in requirements)
    return {match.group(1): match.group(2) for match in matches if match}


def _within(name: str, tested: str, to_do: str, needed: bool) -> Finding:
    try:
        here = version(name)
    except PackageNotFoundError:
        return Finding(name, "not installed", "missing", to_do, needed)
    # without the local part, which names the build, as in 2.15.0+cpu
    low, high, installed = (_numbers(text) for text in (*tested.removeprefix(">=").split(",<"), here))
    return judge(name, here, (not low <= installed < high, "limited", f"tested versions: {tested}; {RENEW}"))


def _numbers(version: str) -> list[int]:
    return [int(part) for part in re.match(r"\d+(\.\d+)*|", version)[0].split(".") if part]  # type: ignore[index]


def _project() -> JsonObject:
    return tomllib.loads(PROJECT.read_text(encoding="utf-8"))


def tool_findings() -> Iterator[Finding]:
    for names, purpose, to_do in TOOLS:
        path = next(filter(None, map(shutil.which, names)), None)
        text = "not found" if path is None else Path(path).name
        yield judge(names[0], text, (path is None, "limited", f"{purpose}: {to_do}"))


def torch_findings() -> Iterator[Finding]:
    import torch

    built = torch.version.hip or torch.version.cuda
    build = f"{'ROCm' if torch.version.hip else 'CUDA'} {built}" if built else "CPU"
    yield Finding("torch", f"{torch.__version__}, built for {build}")
    names = [torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())]
    driver = "--device cpu works; for a GPU check its driver, or install its build of torch (UV_TORCH_BACKEND)"
    other = "optional: torch for your GPU: UV_TORCH_BACKEND=rocm7.1 nox … (or the version that your driver has)"
    none = f"none that {build} sees" if built else "none: this build of torch has no GPU support"
    yield judge("GPU", ", ".join(names) or none, (not names, "limited", driver if built else other))


def clock_findings() -> Iterator[Finding]:
    """Yield the spread of the same work's core seconds, and whether those of two threads count waiting under a load."""
    import torch

    from harness.machine.clock_check import NOISY, SPINNING, busy_programs, multiplications, noise, spinning
    from harness.machine.device import use_threads
    from harness.machine.stopwatch import Stopwatch

    watch = Stopwatch(torch.device("cpu"))
    use_threads(1)  # as in training
    spread, waits = noise(watch, multiplications)
    text = f"core seconds differ by {100 * spread:.1f} % (middle half), waiting adds {100 * max(waits, 0.0):.1f} %"
    to_do = "stop other programs before anything is timed"
    yield judge("repeated work", text, (max(spread, waits) > NOISY, "limited", to_do))
    if len(allowed_cpus()) < 2:
        return
    with own_cores(2):  # which the busy programs inherit
        times = spinning(watch, 2, busy_programs)
    text = f"{times:.2f} times those of one thread for the same work, with 2 busy programs on the same cores"
    to_do = f"keep --threads 1, or unset {VARIABLE} and {SPINS}: threads that wait use processor time"
    yield judge("core seconds of 2 threads", text, (times > SPINNING, "limited", to_do))


def matmul_findings() -> Iterator[Finding]:
    import torch

    from harness.machine.device import multiplies_bfloat16, processor_flags

    flags, has_units = processor_flags(), multiplies_bfloat16(torch.device("cpu"))
    here = " ".join(name for name in FLAGS if name in flags) or "none of " + " ".join(FLAGS)
    units = "bfloat16" if has_units else "no matrix units for bfloat16"
    yield judge(
        "processor's matrix multiplications",
        f"{here}; torch uses {torch.backends.cpu.get_cpu_capability()}; {units}",
        (not has_units, "limited", "optional: --precision auto takes float32; with AMX a run is faster"),
    )


def mitsuba_findings() -> Iterator[Finding]:
    """Yield findings on the scalar variant, which suffices, and on what faster ones need: a working LLVM, or CUDA."""
    failure = probe("scalar_rgb", "")
    yield judge("Mitsuba scalar_rgb", failure or "renders", (bool(failure), "missing", "reinstall mitsuba as pinned"))
    users, libraries = os.environ.get("DRJIT_LIBLLVM_PATH"), [str(path) for path in llvm_libraries()]
    if users and users not in libraries:
        to_do = f"name a file of LLVM {OLDEST_LLVM} or newer, or unset it"
        yield Finding("DRJIT_LIBLLVM_PATH", f"{users} is no such library", "limited", to_do)
    if not libraries:
        to_do = f"rendering is two to three times as fast with it, and voxels_drjit needs it: {INSTALL_LLVM}"
        yield Finding("Mitsuba llvm_ad_rgb", "no libLLVM was found", "limited", to_do)
    for library in libraries:
        failure = probe("llvm_ad_rgb", library)
        text = f"renders with {library}" if failure is None else f"{library}: {failure}"
        yield judge("Mitsuba llvm_ad_rgb", text, (failure is not None, "limited", INSTALL_LLVM))
        if failure is None:
            break
    has_driver = ctypes.util.find_library("cuda") or ctypes.util.find_library("nvcuda")
    failure = probe("cuda_ad_rgb", "") if has_driver else "no CUDA driver"
    to_do = "check the driver; the CPU renders too" if has_driver else "optional: the CPU renders too"
    yield judge("Mitsuba cuda_ad_rgb", failure or "renders", (bool(failure), "limited", to_do))


PROBES: dict[str, Callable[[], Iterator[Finding]]] = {
    "python": python_findings,
    "packages": package_findings,
    "cores": core_findings,
    "memory": memory_findings,
    "disk": disk_findings,
    "torch": torch_findings,
    "clock": clock_findings,
    "matmul": matmul_findings,
    "mitsuba": mitsuba_findings,
    "tools": tool_findings,
    "optional": optional_findings,
}
ESSENTIAL = ("python", "packages", "torch", "mitsuba")
"""The probes whose failure means that nothing works."""


def findings() -> Iterator[Finding]:
    """Yield findings in the order of `PROBES`, each as soon as it is known. A missing package is reported only once."""
    missing = set()
    for name, look in PROBES.items():
        try:
            for finding in look():
                if finding.verdict == "missing":
                    missing.add(finding.what)
                yield finding
        except Exception as error:
            if isinstance(error, ModuleNotFoundError) and error.name in missing:
                continue
            yield Finding(name, named(error), "missing", "repair what it names", needed=name in ESSENTIAL)
