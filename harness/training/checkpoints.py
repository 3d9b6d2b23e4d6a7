"""The tensors that training changed in a method, as a file: OUT/checkpoints/<scene>.<method>.<seed>.safetensors.

An unfinished cell has a snapshot (`harness.records.snapshot`): weights, optimiser, occupancy grid, counters and scores
so far suffice, as random draws depend only on seed and step (`harness.plan.seeds`). On a CPU a resumed cell is
bit-identical to an uninterrupted one; its clocks continue.
"""

import hashlib
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from harness.records.cells import checkpoint_name
from harness.records.snapshot import Unfinished
from harness.training.learner import Learner
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError, short

OCCUPIED = "occupied"
"""The mask of the occupancy grid, stored with the weights: a picture depends on the choice of evaluated points."""


def checkpoint_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return out / checkpoint_name(scene, method, seed)


def tensors_of(learner: Learner) -> dict[str, Tensor]:
    """Return everything that training changed and a picture depends on, by name."""
    tensors = {name: value.contiguous() for name, value in learner.fields.state_dict().items()}
    if learner.grid is not None:
        tensors[OCCUPIED] = learner.grid.occupied
    return tensors


def save_checkpoint(learner: Learner, path: Path) -> None:
    """Write a checkpoint atomically; raises `OSError` naming the file."""
    # not by safetensors itself, whose own error would hide a full disk
    write_atomically(path, save({name: value.cpu() for name, value in tensors_of(learner).items()}))


def load_checkpoint(learner: Learner, path: Path, step: int, digest: str | None = None) -> None:
    """Restore a learner to its state after `step` steps. Raises `InputError` for a file that is missing, damaged, of
    another network, or whose SHA-256 is not `digest`; nothing is unpickled.
    """
    if not path.is_file():
        raise InputError(f"{path}: this checkpoint is missing; train the cell again, or choose another one")
    try:
        content = path.read_bytes()
        if digest is not None and hashlib.sha256(content).hexdigest() != digest:
            raise ValueError("changed since it was written; --resume trains the cell again")
        tensors = {name: value.to(learner.device) for name, value in load(content).items()}
        if bad := [name for name, value in tensors.items() if not bool(torch.isfinite(value).all())]:
            raise ValueError(f"{' '.join(bad)}: not finite")
        learner.restore(tensors, step)
    except (SafetensorError, RuntimeError, KeyError, ValueError, OSError) as error:
        raise InputError(f"{path}: not a checkpoint of {learner.method} as this run has it ({short(error)})") from error


@torch.no_grad()
def weights_digest(learner: Learner) -> str:
    """Return 64 hexadecimal digits: equal if every tensor has the same name, type, shape and bits."""
    digest = hashlib.blake2b(digest_size=32)
    for name, value in sorted(tensors_of(learner).items()):
        digest.update(f"{name} {value.dtype} {tuple(value.shape)}\n".encode())
        digest.update(value.detach().cpu().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


LARGEST_SHARE = 0.02
"""The maximum share of a group's time for snapshots: if writing takes long, they are written less often."""


class Keeping:
    """The schedule of a group's snapshots: due every `every` seconds (0: always), or less often if they cost much."""

    def __init__(self, every: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._every = every
        self._clock = clock
        self._due = clock() + every

    @property
    def is_due(self) -> bool:
        return self._clock() >= self._due

    @contextmanager
    def done(self) -> Iterator[None]:
        began = self._clock()
        yield
        ended = self._clock()
        self._due = ended + (max(self._every, (ended - began) / LARGEST_SHARE) if self._every else 0.0)


def training_state(learner: Learner) -> Unfinished:
    tensors = {f"trained.{name}": value for name, value in tensors_of(learner).items()}
    tensors |= {f"optimiser.{name}": value for name, value in learner.optimiser_tensors().items()}
    listing: dict[str, object] = {
        "step": learner.step,
        "seconds": learner.clock.seconds,
        "core_seconds": learner.clock.core_seconds,
        "network_evaluations": learner.network_evaluations,
        "usual_norm": learner.clipping.usual_norm,
        "clipped_steps": learner.clipping.clipped_steps,
        "trace": learner.trace,
    }
    if learner.grid is not None:
        tensors["grid.density"] = learner.grid.density
        listing["grid_emptied"] = learner.grid.emptied
    return Unfinished(listing, {name: np.array(value.detach().cpu().numpy()) for name, value in tensors.items()})


def restore_training(learner: Learner, kept: Unfinished) -> None:
    """Restore a fresh learner of the same settings; the state of another raises any error and spoils this one."""

    def tensors(prefix: str) -> dict[str, Tensor]:
        return {name: torch.tensor(value, device=learner.device) for name, value in kept.under(prefix).items()}

    listing = kept.listing
    learner.restore(tensors("trained"), listing["step"])
    learner.restore_optimiser(tensors("optimiser"))
    if learner.grid is not None:
        learner.grid.density = tensors("grid")["density"]
        learner.grid.emptied = listing["grid_emptied"]
    learner.clock.seconds = listing["seconds"]
    learner.clock.core_seconds = listing["core_seconds"]
    learner.network_evaluations = listing["network_evaluations"]
    learner.clipping.usual_norm = listing["usual_norm"]
    learner.clipping.clipped_steps = listing["clipped_steps"]
    learner.trace = {name: list(series) for name, series in listing["trace"].items()}
