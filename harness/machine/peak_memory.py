"""The peak memory of this process and of its GPU so far."""

import re
import resource
import sys
from contextlib import suppress
from pathlib import Path

import torch

STATUS = Path("/proc/self/status")


def peak_bytes(status: Path = STATUS) -> int:
    """Return the peak resident memory so far."""
    with suppress(OSError):
        if peak := re.search(r"VmHWM:\s+(\d+) kB", status.read_text(encoding="utf-8")):
            return 1024 * int(peak[1])
    # only the fallback, as it may be the parent's peak; bytes on macOS, kibibytes on Linux
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def peak_gpu_bytes(device: torch.device) -> int | None:
    """Return the peak memory that torch had allocated on a GPU; None on a CPU."""
    return torch.cuda.max_memory_allocated(device) if device.type == "cuda" else None
