"""Mutations, each of which changes a constant of the program by 1 %, and the gates that find them.

`python -m tests.harness.gate.mutations` writes `gates/mutations.json`, which the documentation shows.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from baselines import amplifiers, composition, contract, held_mean, occupancy, rendering
from baselines.contract import Box
from baselines.numerics import amplifier, encoding, quadrature, soap
from harness.gate import early
from harness.gate.gates import STARTS, TOLERANCES
from harness.gate.references import Courses
from harness.plan import profiles
from harness.training import trainer
from harness.training.learner import Clipping
from harness.training.scoring import evaluate

ROOT = Path(__file__).parents[3]
FILE = ROOT / "gates" / "mutations.json"
MORE = 1.01
Patch = pytest.MonkeyPatch


@dataclass(frozen=True)
class Row:
    """A mutation, and the gates that find it."""

    part: str
    constant: str
    to: str
    found_by: list[str]
    deviation: float
    """The largest deviation of the first steps in double precision."""


def _scaled(patch: Patch, owner: Any, name: str) -> None:
    """Scale a number of a module."""
    patch.setattr(owner, name, MORE * getattr(owner, name))


def _result_scaled(patch: Patch, owner: Any, name: str) -> None:
    """Scale the result of a function."""
    usual = getattr(owner, name)
    patch.setattr(owner, name, lambda *given, **named: MORE * usual(*given, **named))


def _argument(patch: Patch, owner: Any, name: str, place: int) -> None:
    """Scale an argument of a function or a constructor."""
    usual = getattr(owner, name)

    def changed(*given: Any, **named: Any) -> Any:
        return usual(*given[:place], MORE * given[place], *given[place + 1 :], **named)

    patch.setattr(owner, name, changed)


def _ladder(patch: Patch, name: str) -> None:
    usual = composition.LADDERS[name]
    patch.setitem(composition.LADDERS, name, replace(usual, base=MORE * usual.base))


def _after_init(patch: Patch, kind: Any, then: Callable[[Any], None]) -> None:
    usual = kind.__init__

    def init(self: Any, *given: Any, **named: Any) -> None:
        usual(self, *given, **named)
        with torch.no_grad():
            then(self)

    patch.setattr(kind, "__init__", init)


def _cameras(patch: Patch, side: str) -> None:
    usual = evaluate.cameras_of

    def moved(*given: Any) -> Any:
        cameras = usual(*given)
        return replace(cameras, **{side: MORE * getattr(cameras, side)})

    patch.setattr(evaluate, "cameras_of", moved)


def _training(patch: Patch, **changed: Any) -> None:
    """Change a setting of the default profile."""
    usual = profiles.PROFILES["reduced"]
    patch.setitem(profiles.PROFILES, "reduced", replace(usual, train=replace(usual.train, **changed)))


def _grid(patch: Patch, **changed: Any) -> None:
    _training(patch, grid=replace(profiles.PROFILES["reduced"].train.grid, **changed))


def _network(patch: Patch, **changed: Any) -> None:
    _training(patch, network=replace(profiles.PROFILES["reduced"].train.network, **changed))


def _betas(patch: Patch, *betas: float) -> None:
    _training(patch, optimiser=replace(TRAIN.optimiser, betas=betas))


def _points(patch: Patch, random: float, middle: float) -> None:
    def points_in_bins(t_edges: Tensor, generator: torch.Generator | None) -> Tensor:
        left, right = t_edges[:, :-1], t_edges[:, 1:]
        if generator is None:
            return torch.lerp(left, right, middle)
        return torch.lerp(left, right, random * torch.rand(left.shape, generator=generator, dtype=left.dtype))

    patch.setattr(quadrature, "points_in_bins", points_in_bins)


def _clamp(normalised: Tensor, mean: Tensor, alpha: Tensor, beta: Tensor) -> Tensor:
    amplified = amplifier.amplify_about_mean(normalised, mean, alpha)
    return torch.clamp(amplified * torch.where(normalised > 0.5, beta, 1.0), 0.0, MORE)


def _normalised(self: Box, x: Tensor) -> Tensor:
    return (x - 0.5 * (self.lower + self.upper)) / (MORE * 0.5 * (self.upper - self.lower).max())


TRAIN = profiles.PROFILES["reduced"].train
BETAS = TRAIN.optimiser.betas
MUTATIONS: dict[tuple[str, str, str], Callable[[Patch], None]] = {
    ("encoding", "base φ", "× 1.01"): lambda patch: _ladder(patch, "phi"),
    ("encoding", "base 2", "× 1.01"): lambda patch: _ladder(patch, "base2"),
    ("encoding", "π", "× 1.01"): lambda patch: _result_scaled(patch, encoding, "_angular_frequencies"),
    ("encoding", "half extent of the box", "× 1.01"): lambda patch: patch.setattr(Box, "normalised", _normalised),
    ("encoding", "bands of directions", "4 → 5"): lambda patch: _network(patch, direction_bands=5),
    ("density", "unit", "× 1.01"): lambda patch: _result_scaled(patch, composition.Parts, "density_unit"),
    ("density", "shift before softplus", "× 1.01"): lambda patch: patch.setitem(
        amplifiers.AMPLIFIERS, "none", lambda start: amplifiers.NoAmplifier(start and MORE * start)
    ),
    ("amplifier", "φ of Eq. 4", "× 1.01"): lambda patch: _scaled(patch, amplifier, "PHI"),
    ("amplifier", "first α", "× 1.01"): lambda patch: _after_init(
        patch, amplifiers.Listing2Amplifier, lambda self: self.alpha.mul_(MORE)
    ),
    ("amplifier", "first β", "× 1.01"): lambda patch: _after_init(
        patch, amplifiers.Listing2Amplifier, lambda self: self.beta.mul_(MORE)
    ),
    ("amplifier", "threshold of β", "× 1.01"): lambda patch: patch.setattr(
        amplifiers, "amplify_listing2", partial(amplifier.amplify_listing2, threshold=0.5 * MORE)
    ),
    ("amplifier", "upper limit of the clamp", "× 1.01"): lambda patch: patch.setattr(
        amplifiers, "amplify_listing2", _clamp
    ),
    ("amplifier", "share by which a held mean moves", "× 1.01"): lambda patch: _held_mean(patch),
    ("weights", "bound of the first weights", "× 1.01"): lambda patch: _argument(patch, contract, "uniform_weights", 1),
    ("optimiser", "learning rate", "× 1.01"): lambda patch: _argument(patch, trainer, "learning_rate", 2),
    ("optimiser", "last learning rate", "× 1.01"): lambda patch: _argument(patch, trainer, "learning_rate", 3),
    ("optimiser", "steps of the warm-up", "× 1.01"): lambda patch: _argument(patch, trainer, "learning_rate", 4),
    ("optimiser", "SOAP's β₁", "× 1.01"): lambda patch: _betas(patch, MORE * BETAS[0], BETAS[1]),
    ("optimiser", "SOAP's 1 − β₂", "× 1.01"): lambda patch: _betas(patch, BETAS[0], 1.0 - MORE * (1.0 - BETAS[1])),
    ("optimiser", "SOAP's ε", "× 1.01"): lambda patch: _scaled(patch, soap, "EPSILON"),
    ("optimiser", "least eigenvalue of SOAP's factors", "× 1.01"): lambda patch: _scaled(patch, soap, "LEAST"),
    ("optimiser", "norm that is clipped to", "× 1.01"): lambda patch: _after_init(
        patch, Clipping, lambda self: setattr(self, "norm", MORE * self.norm)
    ),
    ("optimiser", "multiple of the usual norm", "× 1.01"): lambda patch: _after_init(
        patch, Clipping, lambda self: setattr(self, "ratio", MORE * self.ratio)
    ),
    ("optimiser", "power of the mean of the weights", "× 1.01"): lambda patch: _training(
        patch, average=MORE * TRAIN.average
    ),
    ("sampling", "near", "× 1.01"): lambda patch: _cameras(patch, "near"),
    ("sampling", "far", "× 1.01"): lambda patch: _cameras(patch, "far"),
    ("sampling", "bins a ray", "+ 1"): lambda patch: _training(
        patch, bins=TRAIN.bins + 1, first_bins=TRAIN.first_bins + 1
    ),
    ("sampling", "random place in a bin", "× 1.01"): lambda patch: _points(patch, MORE, 0.5),
    ("sampling", "exploration", "× 1.01"): lambda patch: _grid(patch, exploration=MORE * TRAIN.grid.exploration),
    ("sampling", "occupancy threshold", "× 1.01"): lambda patch: _argument(patch, trainer, "OccupancyGrid", 2),
    ("sampling", "share of the rays through covered pixels", "× 1.01"): lambda patch: _training(
        patch, covered_share=MORE * TRAIN.covered_share
    ),
    ("sampling", "depth that hides what is behind", "× 1.01"): lambda patch: _scaled(patch, occupancy, "HIDDEN"),
    ("sampling", "decay of the occupancy", "× 1.01"): lambda patch: _scaled(patch, occupancy, "DECAY"),
    ("quadrature", "middle of a bin", "× 1.01"): lambda patch: _points(patch, 1.0, 0.5 * MORE),
    ("quadrature", "optical depth", "× 1.01"): lambda patch: _depth(patch),
    ("quadrature", "transmittance that ends a ray", "× 1.01"): lambda patch: _scaled(patch, rendering, "OPAQUE"),
    ("compositing", "background", "÷ 1.01"): lambda patch: _after_init(
        patch, trainer.Trainer, lambda self: setattr(self, "background", self.background / MORE)
    ),
}
"""(part of the program, constant, change) → the function that makes it."""


def _held_mean(patch: Patch) -> None:
    """Scale the default of a parameter."""
    usual = held_mean.RunningMean.update
    share = MORE * held_mean.MEAN_SHARE

    def update(self: held_mean.RunningMean, *given: Any, **named: Any) -> None:
        usual(self, *given, **(named if given or named else {"share": share}))

    patch.setattr(held_mean.RunningMean, "update", update)


def _depth(patch: Patch) -> None:
    """Scale the argument of a function that the rules call, as the rules themselves are bound."""
    _argument(patch, quadrature, "_of_depth", 0)


def seen(usual: Courses, key: tuple[str, str, str], names: tuple[str, ...] = tuple(STARTS)) -> Row:
    """Return a mutation with the gates that find it."""
    settings = early.profile_settings()
    with pytest.MonkeyPatch.context() as patch:
        MUTATIONS[key](patch)
        found_by = ["changed.settings"] if early.profile_settings() != settings else []
        changed = early.courses(names)
    sizes = {}
    for precision, courses in changed.items():
        for start, course in courses.items():
            size = sizes[precision, start] = early.deviation(course, usual[precision][start])[0] or 0.0
            if size > TOLERANCES[precision]:
                found_by.append(f"changed.{precision}.{start}")
    largest = max(size for (precision, _), size in sizes.items() if precision == "double")
    return Row(*key, found_by, float(f"{largest:.2g}"))


def main() -> None:
    torch.set_num_threads(1)
    usual = early.courses()
    rows: list[Row] = []
    for key in MUTATIONS:
        rows.append(seen(usual, key))
        print(rows[-1], flush=True)  # noqa: T201
    data = {"schema": 1, "tolerances": TOLERANCES, "rows": [asdict(row) for row in rows]}
    FILE.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
