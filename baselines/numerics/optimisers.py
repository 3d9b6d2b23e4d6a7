"""The optimisers by name. Each takes a step from the gradients stored in the weights; a snapshot keeps its state."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from baselines.numerics.soap import Soap

OptimiserName = Literal["adam", "soap", "muon"]
OPTIMISER_TITLES: dict[OptimiserName, str] = {"adam": "Adam", "soap": "SOAP (arXiv 2409.11321)", "muon": "Muon"}


@dataclass(frozen=True)
class OptimiserSettings:
    """The optimiser of the networks, the same for every method."""

    name: OptimiserName = "adam"
    betas: tuple[float, float] = (0.9, 0.999)
    """The decay of the means of gradients and of their squares, per step. The first is Muon's momentum for matrices."""
    renewed_every: int = 10
    """The steps from one renewal of SOAP's bases to the next."""


LARGEST_SIDE = 1024
"""The maximum side of a matrix of a network; a matrix with a longer side is a table of features."""


@runtime_checkable
class Optimiser(Protocol):
    def step(self, rate: float | Tensor) -> None:
        """Take one step with that learning rate. Gradients of zero leave the weights finite. With a rate on the device
        of the weights, Adam waits for nothing.
        """

    def tensors(self) -> dict[str, Tensor]:
        """Return the complete state by name, in any order."""

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `tensors` returned; raises any error for the state of other weights."""


class TorchOptimisers:
    def __init__(self, *parts: torch.optim.Optimizer) -> None:
        self.parts = parts

    def step(self, rate: float | Tensor) -> None:
        for part in self.parts:
            for group in part.param_groups:
                group["lr"] = rate
            part.step()

    @torch.no_grad()
    def prepare(self) -> None:
        """Allocate the state, so that no step does; a state that exists stays as it is."""
        if self.tensors():
            return
        weights = [weight for part in self.parts for group in part.param_groups for weight in group["params"]]
        before = [weight.grad for weight in weights]
        for weight in weights:
            weight.grad = torch.zeros_like(weight)
        self.step(0.0)
        for value in self.tensors().values():
            value.zero_()
        for weight, gradient in zip(weights, before, strict=True):
            weight.grad = gradient

    def tensors(self) -> dict[str, Tensor]:
        return {
            f"{number}.{weight}.{name}": value
            for number, part in enumerate(self.parts)
            for weight, state in part.state_dict()["state"].items()
            for name, value in state.items()
        }

    def restore(self, tensors: dict[str, Tensor]) -> None:
        for number, part in enumerate(self.parts):
            weights = [weight for group in part.param_groups for weight in group["params"]]
            state: dict[int, dict[str, Tensor]] = {}
            for key, value in tensors.items():
                of, place, name = key.split(".")
                if int(of) == number:
                    weight = weights[int(place)]
                    # with the strides of the weight: a fused step ignores them
                    moment = torch.empty_like(weight).copy_(value) if value.shape == weight.shape != () else value
                    state.setdefault(int(place), {})[name] = moment
            if len({frozenset(named) for named in state.values()}) > 1:
                raise ValueError("the state of some weights lacks what that of others has")
            part.load_state_dict({"state": state, "param_groups": part.state_dict()["param_groups"]})


def _adam(weights: list[nn.Parameter], settings: OptimiserSettings) -> Optimiser:
    on_a_gpu = any(weight.is_cuda for weight in weights)  # there a graph may contain the step
    adam = torch.optim.Adam(weights, betas=settings.betas, fused=True, capturable=on_a_gpu)
    adam._warned_capturable_if_run_uncaptured = True  # single steps are no mistake
    return TorchOptimisers(adam)


def _is_table(weight: nn.Parameter) -> bool:
    """Return whether a weight is a table of features and not of a network: it has more than two axes, or a long one."""
    return weight.ndim > 2 or max(weight.shape, default=0) > LARGEST_SIDE


def _muon(weights: list[nn.Parameter], settings: OptimiserSettings) -> Optimiser:
    """Return Muon, which accepts only matrices, and Adam for the other weights, with steps of about the same size."""
    matrices = [weight for weight in weights if weight.ndim == 2 and not _is_table(weight)]
    others = [weight for weight in weights if weight.ndim != 2 or _is_table(weight)]
    muon = torch.optim.Muon(matrices, momentum=settings.betas[0], weight_decay=0.0, adjust_lr_fn="match_rms_adamw")
    return TorchOptimisers(muon, torch.optim.Adam(others, betas=settings.betas, fused=True))


class Together:
    """Several optimisers, each for other weights, as one optimiser."""

    def __init__(self, **parts: Optimiser) -> None:
        self.parts = parts

    def step(self, rate: float | Tensor) -> None:
        for part in self.parts.values():
            part.step(rate)

    def tensors(self) -> dict[str, Tensor]:
        return {f"{of}/{name}": value for of, part in self.parts.items() for name, value in part.tensors().items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        for of, part in self.parts.items():
            mine = {name.removeprefix(f"{of}/"): value for name, value in tensors.items() if name.startswith(f"{of}/")}
            part.restore(mine)


def _soap(weights: list[nn.Parameter], settings: OptimiserSettings) -> Optimiser:
    tables = [weight for weight in weights if _is_table(weight)]
    networks = Soap([weight for weight in weights if not _is_table(weight)], settings.betas, settings.renewed_every)
    return Together(networks=networks, tables=_adam(tables, settings)) if tables else networks


OPTIMISERS: dict[OptimiserName, Callable[[list[nn.Parameter], OptimiserSettings], Optimiser]] = {
    "adam": _adam,
    "soap": _soap,
    "muon": _muon,
}


def optimiser_of(weights: Iterable[nn.Parameter], settings: OptimiserSettings) -> Optimiser:
    return OPTIMISERS[settings.name](list(weights), settings)
