"""What training changed in a method, as a file: OUT/checkpoints/<scene>.<method>.<seed>.safetensors."""

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from harness.json_record import write_whole
from harness.records import checkpoint_name
from scenes.errors import InputError

if TYPE_CHECKING:
    from harness.learner import Learner

OCCUPIED = "occupied"
"""The mask of the occupancy grid, beside the weights: which points are evaluated is part of a picture."""


def checkpoint_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return out / checkpoint_name(scene, method, seed)


def tensors_of(learner: "Learner") -> dict[str, Tensor]:
    """Everything that training changed and a picture depends on, by name."""
    tensors = {name: value.contiguous() for name, value in learner.fields.state_dict().items()}
    if learner.grid is not None:
        tensors[OCCUPIED] = learner.grid.occupied
    return tensors


def save_checkpoint(learner: "Learner", path: Path) -> None:
    """Whole or not at all; raises `OSError`, naming the file, where it cannot be written."""
    # not by safetensors itself, whose own error would hide a full disk
    write_whole(path, save({name: value.cpu() for name, value in tensors_of(learner).items()}))


def load_checkpoint(learner: "Learner", path: Path, step: int, digest: str | None = None) -> None:
    """Makes a learner what it was after `step` steps. Raises `InputError` for a file that is missing, damaged, of
    another network, or of another SHA-256 than `digest`; nothing is unpickled.
    """
    if not path.is_file():
        raise InputError(f"{path}: this checkpoint is missing; train the cell again, or choose another one")
    try:
        content = path.read_bytes()
        if digest is not None and hashlib.sha256(content).hexdigest() != digest:
            raise ValueError("changed since it was written; --resume trains the cell again")
        tensors = {name: value.to(learner.device) for name, value in load(content).items()}
        if spoilt := [name for name, value in tensors.items() if not bool(torch.isfinite(value).all())]:
            raise ValueError(f"{' '.join(spoilt)}: not finite")
        learner.restore(tensors, step)
    except (SafetensorError, RuntimeError, KeyError, ValueError, OSError) as error:
        said = " ".join(str(error).split())[:300]
        raise InputError(f"{path}: not a checkpoint of {learner.method} as this run has it ({said})") from error


@torch.no_grad()
def weights_digest(learner: "Learner") -> str:
    """64 hexadecimal digits: equal where every tensor has the same name, type, shape and bits."""
    found = hashlib.blake2b(digest_size=32)
    for name, value in sorted(tensors_of(learner).items()):
        found.update(f"{name} {value.dtype} {tuple(value.shape)}\n".encode())
        found.update(value.detach().cpu().reshape(-1).view(torch.uint8).numpy().data)
    return found.hexdigest()
