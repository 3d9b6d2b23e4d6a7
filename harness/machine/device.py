"""The device of tensors, and the switches that make a run repeatable; one GPU per worker. ROCm is torch's `cuda`."""

import ctypes
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import torch

from harness.machine.cores import allowed_cpus, quota_cores
from scenes.files.errors import InputError


def chosen_device(name: str) -> torch.device:
    """Return the device for `auto`, `cpu` or `cuda`; raises `InputError` if a GPU is asked for and there is none."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    if name == "cuda" and not torch.cuda.is_available():
        cuda, rocm = torch.version.cuda, torch.version.hip
        built = f"CUDA {cuda}" if cuda else f"ROCm {rocm}" if rocm else "CPU only"
        raise InputError(
            f"--device cuda: torch {torch.__version__} (built for {built}) sees no GPU; "
            "use --device cpu, or install the torch build of your GPU (UV_TORCH_BACKEND, see README)"
        )
    return torch.device(name)


def use_threads(count: int) -> None:
    """Fix the number of threads and the order of sums: the same seed gives the same bits on the same CPU."""
    torch.set_num_threads(count)
    # the same as use_deterministic_algorithms, which would also import the compiler: seconds in each process
    torch.set_deterministic_debug_mode("warn")
    # deterministic mode would fill every new tensor with NaN first, which is a second pass over all memory
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    torch.backends.cuda.matmul.allow_tf32 = False
    torch.backends.cudnn.allow_tf32 = False


def keep_freed_memory() -> None:
    """Let this process keep freed blocks below 1 GB: training asks for the same sizes at every step, and each page that
    is handed back has to be zeroed again. Does nothing if the C library has no such setting.
    """
    _set_thresholds(1 << 30, 1 << 30)


def return_freed_memory() -> None:
    """Undo `keep_freed_memory`, for comparisons, and release free memory now."""
    _set_thresholds(32 << 20, 64 << 20)
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def _set_thresholds(mmap: int, trim: int) -> None:
    trim_threshold, mmap_threshold = -1, -3
    with suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(mmap_threshold, mmap)
        mallopt(trim_threshold, trim)


def rendering_threads() -> int:
    """Return the default number of threads for interactive rendering. One core is left for the browser: threads that
    waited for each other on a busy core made a view of 100 × 100 pixels take seconds instead of half a second.
    """
    return max(1, available_cores() - 1)


def available_cores() -> int:
    """Count the cores that this process may run on, each hardware thread as one; no more than its quota."""
    cores = len(allowed_cpus())
    return min(cores, quota_cores() or cores)


def multiplies_bfloat16(device: torch.device) -> bool:
    """Return whether the processor has matrix units for bfloat16; without them float32 is faster: with AVX-512's vector
    multiplications a step took 1.6 (6 × 64) to 1.7 times (8 × 256) as long.
    """
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    return "amx_bf16" in processor_flags()


def processor_flags(cpuinfo: Path = Path("/proc/cpuinfo")) -> set[str]:
    """Return the instruction sets of the processor by the names of the system; an empty set if it lists none."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8").splitlines()
    except OSError:
        return set()
    return {flag for line in lines if line.startswith(("flags", "Features")) for flag in line.split(":", 1)[1].split()}


AMD = ("HIP_VISIBLE_DEVICES", "CUDA_VISIBLE_DEVICES")
"""HIP reads the first, else the second. Both number the devices that `ROCR_VISIBLE_DEVICES`, left unchanged, allows."""


def only_gpu(number: int, count: int, amd: bool, environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment in which a new process sees only GPU `number` (modulo `count`) of those seen here."""
    if count < 2:
        return {}
    names = AMD if amd else AMD[1:]
    given = next((name for name in names if environment.get(name)), names[0])
    listed = environment.get(given, "").split(",") if environment.get(given) else [str(index) for index in range(count)]
    return {given: listed[number % count].strip()}


def gpu_masks(workers: int, device: str) -> list[dict[str, str]]:
    """Return the environment of each worker: one GPU each if cells run on GPUs."""
    if device != "cuda":
        return [{}] * workers
    count = torch.cuda.device_count()
    return [only_gpu(number, count, bool(torch.version.hip), os.environ) for number in range(workers)]
