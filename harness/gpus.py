"""One GPU a worker: which of a machine's GPUs a process sees, for either vendor."""

from collections.abc import Mapping

NVIDIA = ("CUDA_VISIBLE_DEVICES",)
AMD = ("HIP_VISIBLE_DEVICES", "CUDA_VISIBLE_DEVICES")
"""HIP reads the first, else the second; both count what `ROCR_VISIBLE_DEVICES` has left, which therefore stays as it
is."""


def only_gpu(number: int, count: int, amd: bool, environment: Mapping[str, str]) -> dict[str, str]:
    """Changes to the environment after which a new process sees GPU `number` (modulo `count`) of the `count` that this
    one sees; none where there is nothing to choose.
    """
    if count < 2:
        return {}
    names = AMD if amd else NVIDIA
    given = next((name for name in names if environment.get(name)), names[0])
    listed = environment.get(given, "").split(",") if environment.get(given) else [str(one) for one in range(count)]
    return {given: listed[number % count].strip()}


def gpu_masks(workers: int, device: str) -> list[dict[str, str]]:
    """For each worker, what `only_gpu` says; asks torch where cells run on a GPU."""
    if device != "cuda":
        return [{}] * workers
    import os

    import torch

    count = torch.cuda.device_count()
    return [only_gpu(number, count, bool(torch.version.hip), os.environ) for number in range(workers)]
