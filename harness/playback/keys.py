"""Everything that a picture depends on, as one digest.

The paper's key is a hash of only the pose (Listing 5), which would return a wrong picture after more training.
"""

import hashlib
import json
import platform
import struct
from functools import cache
from typing import Any

import torch

from harness.machine.provenance import installed, processor, versions
from harness.plan.plugins import origins
from harness.training.batches import Camera
from harness.training.checkpoints import weights_digest
from harness.training.learner import Learner


def plain_calls(chunk: int) -> str:
    """Describe how `harness.training.scoring.evaluate.render_view` puts rays into chunks."""
    return f"pixels in the fixed random order, {chunk} rays a call"


def method_digest(learner: Learner) -> bytes:
    """Return the digest of everything that a picture depends on, except camera and chunks."""
    facts = {
        "learner": learner.rendered_by(),
        **origins([learner.method]),
        "weights": weights_digest(learner),
        "machine": machine(learner),
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True, allow_nan=False).encode()).digest()


def camera_key(method: bytes, camera: Camera, calls: str) -> str:
    """Return the key of a view, 64 hexadecimal digits; `calls` describes how rays are put into chunks."""
    digest = hashlib.sha256(method)
    digest.update(camera.camera_to_world.tobytes())
    digest.update(struct.pack("<qqddd", camera.width, camera.height, camera.focal, camera.near, camera.far))
    digest.update(calls.encode())
    return digest.hexdigest()


def machine(learner: Learner) -> dict[str, object]:
    """Return the facts that determine arithmetic: this program's sources, and the libraries, which choose the order of
    sums by processor, threads and matmul precision, and by the processor's model, which they inspect themselves.
    """
    on_gpu = learner.device.type == "cuda"
    return {
        "versions": versions(),
        "drjit": _drjit() if learner.method in ("voxels_drjit", "ellipsoids") else None,
        "processor": [platform.machine(), processor(), torch.backends.cpu.get_cpu_capability()],
        "device": torch.cuda.get_device_name(learner.device) if on_gpu else "cpu",
        "switches": list(switches(on_gpu)),
    }


def switches(on_gpu: bool) -> tuple[int | bool | str, ...]:
    """Return the settings that the process, or for autocast the thread, can change at any time; takes microseconds.
    Precisions are read per library: torch's common setting raises an error once one was set separately.
    """
    libraries: Any = torch.backends
    kind = "cuda" if on_gpu else "cpu"
    always = (
        torch.get_num_threads(),
        torch.are_deterministic_algorithms_enabled(),
        str(torch.get_default_dtype()),
        str(torch.get_autocast_dtype(kind)) if torch.is_autocast_enabled(kind) else "no autocast",
    )
    if not on_gpu:
        return *always, libraries.mkldnn.enabled, libraries.mkldnn.matmul.fp32_precision
    matmul = libraries.cuda.matmul
    return (
        *always,
        matmul.fp32_precision,
        matmul.allow_fp16_reduced_precision_reduction,
        matmul.allow_bf16_reduced_precision_reduction,
        matmul.allow_fp16_accumulation,
        libraries.cudnn.conv.fp32_precision,
    )


@cache
def _drjit() -> list[object]:
    """Return the versions of Mitsuba and of LLVM, which compiles Dr.Jit's kernels for a processor."""
    import drjit

    return [installed("mitsuba"), list(drjit.detail.llvm_version())]
