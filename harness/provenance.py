"""Where and with what a record was made."""

import platform
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import torch

from harness.cluster.sources import CHECKED, PROGRAM, installed, versions
from harness.device import available_cores, multiplies_bfloat16

PACKAGES = (*CHECKED, "mitsuba", "colour-science")


def provenance(device: torch.device) -> dict[str, Any]:
    """Versions, processor, device, commit and a digest of our sources; no user names, no paths."""
    return {
        **code_here(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": processor(),
        "instruction_set": torch.backends.cpu.get_cpu_capability(),
        "cores": available_cores(),
        "threads": torch.get_num_threads(),
        "device": torch.cuda.get_device_name() if device.type == "cuda" else "cpu",
        "torch_build": f"ROCm {torch.version.hip}" if torch.version.hip else f"CUDA {torch.version.cuda}",
        "bfloat16_products": multiplies_bfloat16(device),
    }


def code_here() -> dict[str, Any]:
    """Commit, digest of our sources and packages, as they were when this process first asked: what it has imported
    does not change any more.
    """
    return {
        "commit": commit(),
        "sources": versions()[PROGRAM],
        "packages": {name: installed(name) for name in PACKAGES},
    }


@cache
def processor() -> str:
    """Its model, as the system names it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or "unknown"


@cache
def commit() -> str:
    """As git names it, `-dirty` where files were changed since; "unknown" without git."""
    here = Path(__file__).parent
    try:
        found = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=here,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()
