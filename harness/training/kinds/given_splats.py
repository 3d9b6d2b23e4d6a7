"""Gaussians that another program trained, as a learner that is scored as it was given."""

from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, Rays
from baselines.methods.explicit import GivenSettings
from baselines.splats.gaussians import Gaussians
from baselines.splats.ply import BLURRED, DEGREES, read_ply
from baselines.splats.rasteriser import COLUMNS
from harness.machine.stopwatch import Stopwatch
from harness.training.kinds.splat_trainer import DrawingTrainer
from harness.training.learner import Job
from scenes.files.digest import file_digest
from scenes.files.errors import InputError


def given_gaussians(file: Path, focal: float) -> Gaussians:
    """Read a .ply, to be drawn at a focal length in pixels. Raises `InputError`."""
    try:
        return read_ply(file, focal)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise InputError(f"{file}: {error}; give the .ply of 3D Gaussian Splatting, or pictures") from error


class GivenSplats(DrawingTrainer):
    """The Gaussians of a .ply file. It takes no step and no time."""

    own: GivenSettings

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        unit = Box(-torch.ones(3), torch.ones(3))
        self.field = Gaussians(unit, 0, torch.zeros(0, sum(COLUMNS.values())), 0.0, 0.0, BLURRED / self.own.focal**2)

    @property
    def progress(self) -> float:
        return 1.0

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Read the Gaussians, and compile the kernels. Raises `InputError`."""
        file = Path(self.own.file)
        self.field = given_gaussians(file, self.own.focal)
        if file_digest(file) != self.own.sha256:
            raise InputError(f"{file}: changed since the run began; put it back as it was")
        self.field.render(rays)

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None:
        """Leave everything as it is; making the batch is not counted."""
        self.clock = Stopwatch(self.device)

    def rendered_by(self) -> dict[str, Any]:
        return {**self._rendered_by(), "degree": self.field.degree, "blurred": self.field.blurred}

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        values = tensors["gaussians"]
        harmonics = values.shape[-1] - sum(COLUMNS.values())
        if values.ndim != 2 or harmonics not in DEGREES:
            raise ValueError(f"Gaussians of shape {tuple(values.shape)}")
        self.field.values, self.field.degree = values, DEGREES[harmonics]

    def optimiser_tensors(self) -> dict[str, Tensor]:
        return {}

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None: ...
