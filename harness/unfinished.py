"""A cell in the middle of its training, as a file: OUT/unfinished/<scene>.<method>.<seed>.safetensors.

What is drawn at random depends on a cell's seed and step alone (`harness.seeds`), so weights, optimiser, occupancy
grid, counters and what was scored so far are all that there is to keep. On a CPU, a cell that goes on from its file
ends in the bits of one that was never interrupted; its clock goes on as well, from where it stood.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.json_record import DamagedRecord, write_whole
from harness.listed_tensors import Tensors, sealed, unsealed
from harness.records import CellRecord

if TYPE_CHECKING:
    from harness.learner import Learner

FOLDER = "unfinished"
"""Under OUT."""
ENDED = ("done", "diverged")
"""Of such a cell nothing is kept here; one with an error is tried again from where it was."""
SCHEMA = 1
LISTING = "unfinished"
LARGEST_SHARE = 0.02
"""Of its time that a group spends on keeping: what takes long is kept less often."""
LARGEST_BYTES = 4 << 30
"""A larger file is not read."""


@dataclass(frozen=True)
class Unfinished:
    """Where a cell stood."""

    listing: dict[str, Any]
    tensors: Tensors

    def under(self, prefix: str) -> Tensors:
        """The tensors whose names begin with `prefix` and a dot, without these."""
        return {
            name.removeprefix(f"{prefix}."): one for name, one in self.tensors.items() if name.startswith(f"{prefix}.")
        }


def unfinished_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return out / FOLDER / f"{scene}.{method}.{seed}.safetensors"


def write_unfinished(path: Path, cell: Unfinished) -> None:
    """Whole or not at all. Raises `OSError`, naming the file."""
    write_whole(path, sealed(LISTING, {"schema": SCHEMA, **cell.listing}, cell.tensors))


def read_unfinished(path: Path) -> Unfinished:
    """Raises `DamagedRecord` for anything that `write_unfinished` does not write."""
    try:
        if not path.is_file():
            raise ValueError("is no file")
        if (size := path.stat().st_size) > LARGEST_BYTES:
            raise ValueError(f"has {size} bytes, more than any cell")
        listing, tensors = unsealed(LISTING, path.read_bytes())
        if listing.pop("schema") != SCHEMA:
            raise ValueError("is of another version")
        return Unfinished(listing, tensors)
    except (OSError, ValueError, KeyError) as error:
        said = " ".join(str(error).split())[:200]
        raise DamagedRecord(f"{path}: {said}; delete it and run again with --resume") from error


def drop_ended(out: Path, cell: CellRecord) -> None:
    """What is kept of a cell whose record is written."""
    if cell.status in ENDED:
        unfinished_path(out, cell.scene, cell.method, cell.seed).unlink(missing_ok=True)


def drop_folder(out: Path) -> None:
    """Once nothing is kept any more."""
    with suppress(OSError):
        (out / FOLDER).rmdir()


class Keeping:
    """When a group's cells are kept: every so many seconds, and seldom enough to cost little; with 0 always."""

    def __init__(self, every: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._every = every
        self._clock = clock
        self._due = clock() + every

    @property
    def is_due(self) -> bool:
        return self._clock() >= self._due

    @contextmanager
    def done(self) -> Iterator[None]:
        """Around the writing."""
        began = self._clock()
        yield
        ended = self._clock()
        self._due = ended + (max(self._every, (ended - began) / LARGEST_SHARE) if self._every else 0.0)


def training_state(learner: "Learner") -> Unfinished:
    """All that training has changed in a learner."""
    from harness.checkpoints import tensors_of

    tensors = {f"trained.{name}": one for name, one in tensors_of(learner).items()}
    tensors |= {f"optimiser.{name}": one for name, one in learner.optimiser_tensors().items()}
    listing: dict[str, Any] = {
        "step": learner.step,
        "seconds": learner.clock.seconds,
        "network_evaluations": learner.network_evaluations,
        "usual_norm": learner.clipping.usual_norm,
        "clipped_steps": learner.clipping.clipped_steps,
        "trace": learner.trace,
    }
    if learner.grid is not None:
        tensors["grid.density"] = learner.grid.density
        listing["grid_emptied"] = learner.grid.emptied
    return Unfinished(listing, {name: np.array(one.detach().cpu().numpy()) for name, one in tensors.items()})


def restore_training(learner: "Learner", kept: Unfinished) -> None:
    """Makes a fresh learner of the same settings what it was. Where it was another one, raises anything, and leaves the
    learner good for nothing."""
    import torch

    def tensors(prefix: str) -> dict[str, torch.Tensor]:
        return {name: torch.tensor(one, device=learner.device) for name, one in kept.under(prefix).items()}

    listing = kept.listing
    learner.restore(tensors("trained"), listing["step"])
    learner.restore_optimiser(tensors("optimiser"))
    if learner.grid is not None:
        learner.grid.density = tensors("grid")["density"]
        learner.grid.emptied = listing["grid_emptied"]
    learner.clock.seconds = listing["seconds"]
    learner.network_evaluations = listing["network_evaluations"]
    learner.clipping.usual_norm = listing["usual_norm"]
    learner.clipping.clipped_steps = listing["clipped_steps"]
    learner.trace = {name: list(series) for name, series in listing["trace"].items()}
