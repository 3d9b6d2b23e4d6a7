"""Each check finds the method that it is there for; none of these is found by nobody."""

from collections.abc import Callable
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from baselines.catalog import CATALOG, Method
from baselines.contract import FieldSpec
from baselines.field import NetworkField
from baselines.methods.nerf import NERF
from harness.command.study_commands import run_conformance
from harness.execution.progress import Quiet
from harness.studies.conformance.method_checks import CHECKS, conformance
from harness.studies.conformance.subject import Subject


class Honest(NetworkField):
    """NeRF as a package's own field."""

    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(NERF, asked.size, asked.box, asked.precision, asked.seed, asked.view_dependent)
        self.seed = asked.seed


class MiscountsItself(Honest):
    def parameter_counts(self) -> dict[str, int]:
        return {"total": 7}


class GivesColumns(Honest):
    def density(self, x: Tensor) -> Any:
        return super().density(x).unsqueeze(-1)


class ClaimsToBeBounded(Honest):
    density_limit = 1.0  # type: ignore[assignment]


class CountsByTheMetre(Honest):
    """Its density does not know how long the box is."""

    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma * self.box.half_extent, colour


class GoesNegative(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma - 1.0, colour


class DividesByItsWeights(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma, colour * self.density_head.weight.norm() / self.density_head.weight.norm()


class HasAnUnusedWeight(Honest):
    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        self.spare = nn.Parameter(torch.zeros(3))


class DrawsFromTheGlobalGenerator(Honest):
    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        nn.init.normal_(self.density_head.weight)


class HasFirstWeightsOfItsOwn(Honest):
    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        with torch.no_grad():
            self.density_head.weight.mul_(2.0)


class NeedsDirections(Honest):
    def encode_directions(self, d: Any) -> Any:
        if not self.view_dependent:
            raise RuntimeError("what now?")
        return super().encode_directions(d)


class Flickers(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma, (colour + 1e-3 * torch.rand_like(colour)).clamp(0.0, 1.0)


class LooksAtItsNeighbours(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma, colour * 0.5 + 0.5 * colour.mean() if colour.numel() else colour


class DoubtsItself(Honest):
    pointwise = False  # type: ignore[assignment]


class KnowsNoSecondPass(Honest):
    def __init__(self, asked: FieldSpec) -> None:
        if str(asked.seed).endswith("/fine"):
            raise ValueError("one of me is enough")
        super().__init__(asked)


class CountsInFloats(Honest):
    def parameter_counts(self) -> Any:
        return {name: float(count) for name, count in super().parameter_counts().items()}


class TrainsByChance(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma, colour * (1.0 - 1e-3 * torch.rand(())) if torch.is_grad_enabled() else colour


class HidesWhatItLearnt(Honest):
    """A running value that is no buffer: the checkpoint does not have it."""

    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        self.calls = 0

    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        self.calls += torch.is_grad_enabled()
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma, colour / (1.0 + 0.01 * self.calls)


class HidesWhereItIs(Honest):
    """As above, in training alone: a picture does not show it, a cell that goes on in the middle does."""

    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        self.calls = 0

    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        if not torch.is_grad_enabled():
            return sigma, colour
        self.calls += 1
        return sigma, colour / (1.0 + 0.01 * self.calls)


class LearnsUphill(Honest):
    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        sigma, colour = super().density_and_colour(x, view, ray)
        return sigma.detach() + 0.0 * sigma, 2.0 * colour.detach() - colour


BROKEN: list[Any] = [
    ("protocols", lambda asked: "a field", "torch.nn.Module"),
    ("protocols", lambda asked: nn.Linear(3, 4), "lacks"),
    ("protocols", MiscountsItself, "7 in total"),
    ("shapes", GivesColumns, r"density of 0 points"),
    ("ranges", GoesNegative, "density is"),
    ("ranges", ClaimsToBeBounded, "not 0 to 1"),
    ("unit_of_density", CountsByTheMetre, "unit of length"),
    ("magnitudes", DividesByItsWeights, "not finite"),
    ("gradients", HasAnUnusedWeight, "no gradient reaches spare"),
    ("first_weights", DrawsFromTheGlobalGenerator, "uniform_weights"),
    ("pairing", HasFirstWeightsOfItsOwn, "density_head.weight"),
    ("rendering", NeedsDirections, "what now"),
    ("repeats", Flickers, "another picture"),
    ("pointwise", LooksAtItsNeighbours, "pointwise is True"),
    ("pointwise", DoubtsItself, "pointwise is False"),
    ("two_passes", KnowsNoSecondPass, "one of me is enough"),
    ("record", CountsInFloats, "parameter_counts"),
    pytest.param("training_repeats", TrainsByChance, "another one after", marks=pytest.mark.slow),
    pytest.param("checkpoint", HidesWhatItLearnt, "restored", marks=pytest.mark.slow),
    pytest.param("going_on", HidesWhereItIs, "after it went on", marks=pytest.mark.slow),
    pytest.param("learning", LearnsUphill, "mean squared error", marks=pytest.mark.slow),
]


def outcome_of(check: str, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    """Of one check alone."""
    monkeypatch.setattr("harness.studies.conformance.method_checks.CHECKS", {check: CHECKS[check]})
    (outcome,) = conformance(Subject("tried"))
    return outcome.verdict, outcome.reason


@pytest.mark.parametrize(("check", "field", "said"), BROKEN, ids=lambda value: getattr(value, "__name__", None))
def test_a_broken_method_is_found_with_the_reason(
    check: str, field: Callable[[FieldSpec], Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(None, "a broken one", make_field=field))
    verdict, reason = outcome_of(check, monkeypatch)
    assert verdict == "broken"
    assert said in reason
    assert "\n" not in reason


@pytest.mark.slow
def test_the_honest_one_that_they_are_made_of_conforms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(None, "NeRF by other means", make_field=Honest))
    assert [one for one in conformance(Subject("tried")) if one.verdict != "held"] == []


def test_every_check_has_a_method_that_it_finds() -> None:
    assert {getattr(row, "values", row)[0] for row in BROKEN} == set(CHECKS)


def test_the_command_says_it_and_ends_with_3(monkeypatch: pytest.MonkeyPatch) -> None:
    import argparse

    monkeypatch.setitem(CATALOG, "tried", Method(None, "a broken one", make_field=MiscountsItself))
    monkeypatch.setattr("harness.studies.conformance.method_checks.CHECKS", {"protocols": CHECKS["protocols"]})
    monkeypatch.setattr("harness.plan.plugins.offered", dict)
    lines: list[str] = []
    show = Quiet()
    monkeypatch.setattr(show, "line", lines.append)
    options = argparse.Namespace(methods=["tried"], list=False)
    assert run_conformance(options, show) == 3
    assert any(line.startswith("  broken") and "7 in total" in line for line in lines)
    assert lines[-1] == "  1 broken"
