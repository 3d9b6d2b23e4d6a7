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
TRAIN = profiles.PROFILES["reduced"].train
Mutation = Callable[[pytest.MonkeyPatch], None]
Change = Callable[[Any], Any]


@dataclass(frozen=True)
class Row:
    part: str
    constant: str
    to: str
    found_by: list[str]
    deviation: float
    """The largest deviation of the first steps in double precision."""


def changed(owner: Any, name: str, change: Change) -> Mutation:
    return lambda patch: patch.setattr(owner, name, change(getattr(owner, name)))


def more(number: float) -> float:
    return MORE * number


def more_result(usual: Change) -> Change:
    """Scale the result of a function."""
    return lambda *given, **named: MORE * usual(*given, **named)


def more_at(place: int) -> Change:
    """Scale an argument of a function or a constructor."""
    return lambda usual: (
        lambda *given, **named: usual(*given[:place], MORE * given[place], *given[place + 1 :], **named)
    )


def more_of(record: Any, name: str) -> Any:
    return replace(record, **{name: MORE * getattr(record, name)})


def ladder(name: str) -> Mutation:
    return lambda patch: patch.setitem(composition.LADDERS, name, more_of(composition.LADDERS[name], "base"))


def cameras(side: str) -> Mutation:
    return changed(evaluate, "cameras_of", lambda usual: lambda *given: more_of(usual(*given), side))


def training(**settings: Any) -> Mutation:
    usual = profiles.PROFILES["reduced"]
    return lambda patch: patch.setitem(profiles.PROFILES, "reduced", replace(usual, train=replace(TRAIN, **settings)))


def betas(first: float, second: float) -> Mutation:
    return training(optimiser=replace(TRAIN.optimiser, betas=(first, second)))


def after_init(kind: Any, then: Callable[[Any], None]) -> Mutation:
    def change(usual: Change) -> Change:
        def init(self: Any, *given: Any, **named: Any) -> None:
            usual(self, *given, **named)
            with torch.no_grad():
                then(self)

        return init

    return changed(kind, "__init__", change)


def own(kind: Any, name: str) -> Mutation:
    """Scale an attribute that each instance of a class has."""
    return after_init(kind, lambda self: setattr(self, name, MORE * getattr(self, name)))


def points(random: float, middle: float) -> Mutation:
    def points_in_bins(t_edges: Tensor, generator: torch.Generator | None) -> Tensor:
        left, right = t_edges[:, :-1], t_edges[:, 1:]
        if generator is None:
            return torch.lerp(left, right, middle)
        return torch.lerp(left, right, random * torch.rand(left.shape, generator=generator, dtype=left.dtype))

    return changed(quadrature, "points_in_bins", lambda usual: points_in_bins)


def clamp(normalised: Tensor, mean: Tensor, alpha: Tensor, beta: Tensor) -> Tensor:
    amplified = amplifier.amplify_about_mean(normalised, mean, alpha)
    return torch.clamp(amplified * torch.where(normalised > 0.5, beta, 1.0), 0.0, MORE)


def normalised(self: Box, x: Tensor) -> Tensor:
    return (x - 0.5 * (self.lower + self.upper)) / (MORE * 0.5 * (self.upper - self.lower).max())


def default_share(update: Change) -> Change:
    """Scale the default of a parameter."""
    share = {"share": MORE * held_mean.MEAN_SHARE}
    return lambda self, *given, **named: update(self, *given, **(named if given or named else share))


CHANGES = {"bands of directions": "4 → 5", "bins a ray": "+ 1", "background": "÷ 1.01"}
"""All other constants are multiplied by 1.01."""
OF_CONSTANTS: dict[tuple[str, str], Mutation] = {
    ("encoding", "base φ"): ladder("phi"),
    ("encoding", "base 2"): ladder("base2"),
    ("encoding", "π"): changed(encoding, "_angular_frequencies", more_result),
    ("encoding", "half extent of the box"): changed(Box, "normalised", lambda usual: normalised),
    ("encoding", "bands of directions"): training(network=replace(TRAIN.network, direction_bands=5)),
    ("density", "unit"): changed(composition.Parts, "density_unit", more_result),
    ("density", "shift before softplus"): lambda patch: patch.setitem(
        amplifiers.AMPLIFIERS, "none", lambda start: amplifiers.NoAmplifier(start and MORE * start)
    ),
    ("amplifier", "φ of Eq. 4"): changed(amplifier, "PHI", more),
    ("amplifier", "first α"): after_init(amplifiers.Listing2Amplifier, lambda self: self.alpha.mul_(MORE)),
    ("amplifier", "first β"): after_init(amplifiers.Listing2Amplifier, lambda self: self.beta.mul_(MORE)),
    ("amplifier", "threshold of β"): changed(
        amplifiers, "amplify_listing2", lambda usual: partial(usual, threshold=0.5 * MORE)
    ),
    ("amplifier", "upper limit of the clamp"): changed(amplifiers, "amplify_listing2", lambda usual: clamp),
    ("amplifier", "share by which a held mean moves"): changed(held_mean.RunningMean, "update", default_share),
    ("weights", "bound of the first weights"): changed(contract, "uniform_weights", more_at(1)),
    ("optimiser", "learning rate"): changed(trainer, "learning_rate", more_at(2)),
    ("optimiser", "last learning rate"): changed(trainer, "learning_rate", more_at(3)),
    ("optimiser", "steps of the warm-up"): changed(trainer, "learning_rate", more_at(4)),
    ("optimiser", "SOAP's β₁"): betas(MORE * TRAIN.optimiser.betas[0], TRAIN.optimiser.betas[1]),
    ("optimiser", "SOAP's 1 − β₂"): betas(TRAIN.optimiser.betas[0], 1.0 - MORE * (1.0 - TRAIN.optimiser.betas[1])),
    ("optimiser", "SOAP's ε"): changed(soap, "EPSILON", more),
    ("optimiser", "least eigenvalue of SOAP's factors"): changed(soap, "LEAST", more),
    ("optimiser", "norm that is clipped to"): own(Clipping, "norm"),
    ("optimiser", "multiple of the usual norm"): own(Clipping, "ratio"),
    ("optimiser", "power of the mean of the weights"): training(average=MORE * TRAIN.average),
    ("sampling", "near"): cameras("near"),
    ("sampling", "far"): cameras("far"),
    ("sampling", "bins a ray"): training(bins=TRAIN.bins + 1, first_bins=TRAIN.first_bins + 1),
    ("sampling", "random place in a bin"): points(MORE, 0.5),
    ("sampling", "exploration"): training(grid=more_of(TRAIN.grid, "exploration")),
    ("sampling", "occupancy threshold"): changed(trainer, "OccupancyGrid", more_at(2)),
    ("sampling", "share of the rays through covered pixels"): training(covered_share=MORE * TRAIN.covered_share),
    ("sampling", "depth that hides what is behind"): changed(occupancy, "HIDDEN", more),
    ("sampling", "decay of the occupancy"): changed(occupancy, "DECAY", more),
    ("quadrature", "middle of a bin"): points(1.0, 0.5 * MORE),
    # the function that the rules call, as the rules themselves are bound
    ("quadrature", "optical depth"): changed(quadrature, "_of_depth", more_at(0)),
    ("quadrature", "transmittance that ends a ray"): changed(rendering, "OPAQUE", more),
    ("compositing", "background"): after_init(
        trainer.Trainer, lambda self: setattr(self, "background", self.background / MORE)
    ),
}
MUTATIONS = {(part, name, CHANGES.get(name, "× 1.01")): change for (part, name), change in OF_CONSTANTS.items()}
"""(part of the program, constant, change) → its mutation."""


def seen(usual: Courses, key: tuple[str, str, str], names: tuple[str, ...] = tuple(STARTS)) -> Row:
    """Return a mutation with the gates that find it."""
    settings = early.profile_settings()
    with pytest.MonkeyPatch.context() as patch:
        MUTATIONS[key](patch)
        found_by = ["changed.settings"] if early.profile_settings() != settings else []
        mutated = early.courses(names)
    sizes = {}
    for precision, courses in mutated.items():
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
