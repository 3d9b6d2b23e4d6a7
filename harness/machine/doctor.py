"""All probes by name; each yields findings, and an error that it raises is a finding too."""

import ctypes.util
import math
import os
import platform
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

from harness.machine.cores import quota_cores
from scenes.rendering.variant import OLDEST_LLVM, llvm_libraries, probe

Verdict = Literal["ok", "limited", "missing"]


@dataclass(frozen=True)
class Finding:
    what: str
    found: str
    verdict: Verdict = "ok"
    to_do: str = ""
    """The remedy if the verdict is not ok."""
    needed: bool = False
    """Whether nothing works without it: `missing` then ends with exit code 2."""


def one_line(text: object) -> str:
    return " ".join(str(text).split())[:300]


CGROUP = Path("/sys/fs/cgroup")
WORKER_GB = 1.0
"""The memory of a worker at reduced size (`docs/speed.json`), rounded up."""
LEAST_GB = 2.0
ROOMY_GB = 2.0
LEAST_DISK_GB = 0.3
"""The least disk space: eight view sets of 100 pixels, weights, records and the page of a default run
take half of it.
"""


def core_findings() -> list[Finding]:
    """Report the smallest of the machine's cores, those the process may run on, and those its container pays for."""
    machine = os.cpu_count() or 1
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else machine
    quota = quota_cores()
    said = f"{allowed} of {machine} allowed" + (f", a quota of {quota}" if quota is not None else "")
    if quota is not None and quota < allowed:
        return [Finding("cores", said, "limited", f"workers would wait for each other: --workers {quota}")]
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


def memory_bytes(root: Path = CGROUP, meminfo: Path = Path("/proc/meminfo")) -> int | None:
    """Return the memory, or the part of it that the container may use; None if neither can be read."""
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


PROJECT = Path(__file__).parents[2] / "pyproject.toml"
RENEW = "start it through nox, which installs the pinned ones, or install the one that pyproject.toml names"


def python_findings() -> list[Finding]:
    wanted = str(_project()["project"]["requires-python"]).removeprefix(">=")
    here = platform.python_version()
    if _numbers(here) < _numbers(wanted):
        return [Finding("Python", here, "missing", f"install Python {wanted} or newer", needed=True)]
    return [Finding("Python", f"{here} on {platform.system()} {platform.machine()}")]


def package_findings() -> list[Finding]:
    """Report the packages that a run needs: one line if all are as pinned, else a line each."""
    pins = pinned(_project()["project"]["dependencies"])
    findings = [_against_pin(name, pin, needed=True) for name, pin in pins.items()]
    odd = [finding for finding in findings if finding.verdict != "ok"]
    good = Finding("packages", f"{len(findings) - len(odd)} of {len(findings)} as pinned")
    return [good, *odd]


def optional_findings() -> list[Finding]:
    """Report packages that have a command of their own and that nothing else needs."""
    project = _project()
    extras = project["project"].get("optional-dependencies", {})
    found = []
    for extra, purpose in EXTRAS.items():
        for name, pin in pinned(extras.get(extra, [])).items():
            one = _against_pin(name, pin, needed=False)
            if one.verdict == "missing":
                one = Finding(one.what, "not installed", "missing", f"only for {purpose}: install {name}=={pin}")
            found.append(one)
    return found


EXTRAS = {"ray": "--executor ray", "tensorboard": "--tensorboard"}
"""Map extra of `pyproject.toml` → the option that needs it."""


def tool_findings() -> list[Finding]:
    """Report programs that are called by name."""
    found = []
    for names, purpose, to_do in TOOLS:
        path = next(filter(None, map(shutil.which, names)), None)
        if path is None:
            found.append(Finding(names[0], "not found", "limited", f"{purpose}: {to_do}"))
        else:
            found.append(Finding(names[0], Path(path).name))
    return found


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
"""The tools: names to try · what they are for · what to do."""


def pinned(requirements: list[str]) -> dict[str, str]:
    """Map name → version of lines `name==version`."""
    found = (re.match(r"\s*([A-Za-z0-9._-]+)(?:\[[^\]]*\])?==([^\s;]+)", one) for one in requirements)
    return {match.group(1): match.group(2) for match in found if match}


def _against_pin(name: str, pin: str, needed: bool) -> Finding:
    try:
        here = version(name)
    except PackageNotFoundError:
        return Finding(name, "not installed", "missing", f"{RENEW}: {name}=={pin}", needed=needed)
    if here.partition("+")[0] != pin:  # a local part is the build, as in 2.15.0+cpu
        return Finding(name, here, "limited", f"{pin} is what was tested; {RENEW}")
    return Finding(name, here)


def _project() -> dict[str, Any]:
    return tomllib.loads(PROJECT.read_text(encoding="utf-8"))


def _numbers(version_text: str) -> list[int]:
    return [int(part) for part in re.findall(r"\d+", version_text)[:3]]


FLAGS = ("avx2", "avx512f", "avx512_bf16", "amx_tile", "amx_bf16", "asimd", "bf16")


def torch_findings() -> list[Finding]:
    import torch

    build = f"ROCm {torch.version.hip}" if torch.version.hip else f"CUDA {torch.version.cuda}"
    build = build if torch.version.hip or torch.version.cuda else "CPU"
    found = [Finding("torch", f"{torch.__version__}, built for {build}")]
    product = torch.ones(3, 3) @ torch.ones(3, 3)
    if not bool((product == 3.0).all()):
        found.append(Finding("matrix product", f"wrong: {product.tolist()}", "missing", "reinstall torch", needed=True))
    if torch.cuda.is_available():
        names = [torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())]
        found.append(Finding("GPU", ", ".join(names)))
    elif torch.version.hip or torch.version.cuda:
        to_do = "--device cpu works; for a GPU look at its driver, or take its build of torch (UV_TORCH_BACKEND)"
        found.append(Finding("GPU", f"none that {build} sees", "limited", to_do))
    else:
        to_do = "nothing, or torch for your GPU: UV_TORCH_BACKEND=rocm7.1 nox … (or as your driver has it)"
        found.append(Finding("GPU", "none: this torch is for processors", "limited", to_do))
    return found


def product_findings() -> list[Finding]:
    """Report AMX, AVX-512 and what torch makes of them."""
    import torch

    from harness.machine.device import multiplies_bfloat16, processor_flags

    flags = processor_flags()
    here = " ".join(name for name in FLAGS if name in flags) or "none of " + " ".join(FLAGS)
    said = f"{here}; torch uses {torch.backends.cpu.get_cpu_capability()}"
    if multiplies_bfloat16(torch.device("cpu")):
        return [Finding("processor's products", f"{said}; bfloat16")]
    to_do = "nothing: --precision auto takes float32; with AMX a run is faster"
    return [Finding("processor's products", f"{said}; no matrix units for bfloat16", "limited", to_do)]


INSTALL_LLVM = f"install the shared library of LLVM {OLDEST_LLVM} or newer (Debian: apt install libllvm19), or name it "
INSTALL_LLVM += "in DRJIT_LIBLLVM_PATH"


def scalar_findings() -> list[Finding]:
    """Report the scalar variant, with which everything works."""
    failure = probe("scalar_rgb", "")
    if failure is None:
        return [Finding("Mitsuba scalar_rgb", "renders")]
    return [Finding("Mitsuba scalar_rgb", failure, "missing", "reinstall mitsuba as pinned", needed=True)]


def llvm_findings() -> list[Finding]:
    """Report the newest library that works, and those that do not."""
    found = []
    users = os.environ.get("DRJIT_LIBLLVM_PATH")
    libraries = [str(path) for path in llvm_libraries()]
    if users and users not in libraries:
        to_do = f"name a file of LLVM {OLDEST_LLVM} or newer, or unset it"
        found.append(Finding("DRJIT_LIBLLVM_PATH", f"{users} is no such library", "limited", to_do))
    if not libraries:
        to_do = f"rendering is two to three times as fast with it, and voxels_drjit needs it: {INSTALL_LLVM}"
        return [*found, Finding("Mitsuba llvm_ad_rgb", "no libLLVM was found", "limited", to_do)]
    for library in libraries:
        failure = probe("llvm_ad_rgb", library)
        if failure is None:
            return [*found, Finding("Mitsuba llvm_ad_rgb", f"renders with {library}")]
        found.append(Finding("Mitsuba llvm_ad_rgb", f"{library}: {failure}", "limited", INSTALL_LLVM))
    return found


def cuda_findings() -> list[Finding]:
    """Report CUDA, for NVIDIA alone: Dr.Jit has no backend for other GPUs."""
    if not (ctypes.util.find_library("cuda") or ctypes.util.find_library("nvcuda")):
        return [Finding("Mitsuba cuda_ad_rgb", "no CUDA driver", "limited", "nothing: processors render as well")]
    failure = probe("cuda_ad_rgb", "")
    if failure is None:
        return [Finding("Mitsuba cuda_ad_rgb", "renders")]
    return [Finding("Mitsuba cuda_ad_rgb", failure, "limited", "look at the driver; processors render as well")]


PROBES: dict[str, Callable[[], list[Finding]]] = {
    "python": python_findings,
    "packages": package_findings,
    "cores": core_findings,
    "memory": memory_findings,
    "disk": disk_findings,
    "torch": torch_findings,
    "products": product_findings,
    "scalar_rgb": scalar_findings,
    "llvm_ad_rgb": llvm_findings,
    "cuda_ad_rgb": cuda_findings,
    "tools": tool_findings,
    "optional": optional_findings,
}
ESSENTIAL = ("python", "packages", "torch", "scalar_rgb")
"""The probes without whose success nothing works; a failure to run them counts the same."""


def findings() -> Iterator[Finding]:
    """Yield findings in the order of `PROBES`, each as soon as it is known; a missing package is reported once."""
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
            said = one_line(f"{type(error).__name__}: {error}")
            yield Finding(name, said, "missing", "mend what it says", needed=name in ESSENTIAL)
