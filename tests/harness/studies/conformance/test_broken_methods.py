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


def seen(change: Callable[[Any, Tensor, Tensor], Any]) -> type[Honest]:
    """A field whose density and colour are changed: by (field, density, colour)."""

    class Seen(Honest):
        def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
            return change(self, *super().density_and_colour(x, view, ray))

    return Seen


def begun(change: Callable[[Any], object]) -> type[Honest]:
    """A field that is changed once it is made."""

    class Begun(Honest):
        def __init__(self, asked: FieldSpec) -> None:
            super().__init__(asked)
            with torch.no_grad():
                change(self)

    return Begun


def but(**changed: Any) -> type:
    """A field with other attributes."""
    return type("But", (Honest,), changed)


class NeedsDirections(Honest):
    def encode_directions(self, d: Any) -> Any:
        if not self.view_dependent:
            raise RuntimeError("what now?")
        return super().encode_directions(d)


def knows_no_second_pass(field: Any) -> None:
    if str(field.seed).endswith("/fine"):
        raise ValueError("one of me is enough")


class HidesWhatItLearnt(Honest):
    """A running value that is no buffer: the checkpoint does not have it."""

    shown_in_pictures = True

    def __init__(self, asked: FieldSpec) -> None:
        super().__init__(asked)
        self.calls = 0

    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        self.calls += torch.is_grad_enabled()
        sigma, colour = super().density_and_colour(x, view, ray)
        shown = torch.is_grad_enabled() or self.shown_in_pictures
        return sigma, colour / (1.0 + 0.01 * self.calls) if shown else colour


class HidesWhereItIs(HidesWhatItLearnt):
    """As above, in training alone: a picture does not show it, a cell that goes on in the middle does."""

    shown_in_pictures = False


def divided_by_weights(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    norm = field.density_head.weight.norm()
    return sigma, colour * norm / norm


def with_neighbours(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    return sigma, colour * 0.5 + 0.5 * colour.mean() if colour.numel() else colour


def by_chance_in_training(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    return sigma, colour * (1.0 - 1e-3 * torch.rand(())) if torch.is_grad_enabled() else colour


def flickering(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    return sigma, (colour + 1e-3 * torch.rand_like(colour)).clamp(0.0, 1.0)


def uphill(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    return sigma.detach() + 0.0 * sigma, 2.0 * colour.detach() - colour


def half_of_the_gradient(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    return sigma, 0.5 * (colour + colour.detach())


class HalfInSingle(Honest):
    """As above, with a kernel that knows single precision alone."""

    def density_and_colour(self, x: Any, view: Any, ray: Any) -> Any:
        if x.dtype != torch.float32:
            raise TypeError("float32 is wanted")
        return half_of_the_gradient(self, *super().density_and_colour(x, view, ray))


MISCOUNTING = but(parameter_counts=lambda self: {"total": 7})
BROKEN: list[Any] = [
    ("protocols", lambda asked: "a field", "torch.nn.Module"),
    ("protocols", lambda asked: nn.Linear(3, 4), "lacks"),
    ("protocols", MISCOUNTING, "7 in total"),
    ("shapes", but(density=lambda self, x: NetworkField.density(self, x).unsqueeze(-1)), "density of 0 points"),
    ("ranges", seen(lambda field, sigma, colour: (sigma - 1.0, colour)), "density is"),
    ("ranges", but(density_limit=1.0), "not 0 to 1"),
    (
        "unit_of_density",
        seen(lambda field, sigma, colour: (sigma * field.box.half_extent, colour)),
        "unit of length",
    ),
    ("magnitudes", seen(divided_by_weights), "not finite"),
    (
        "gradients",
        begun(lambda field: setattr(field, "spare", nn.Parameter(torch.zeros(3)))),
        "no gradient reaches spare",
    ),
    ("derivatives", seen(half_of_the_gradient), "by differences"),
    ("derivatives", HalfInSingle, "by differences"),
    ("derivatives", seen(lambda field, sigma, colour: (0.5 * (sigma + sigma.detach()), colour)), "by differences"),
    ("first_weights", begun(lambda field: nn.init.normal_(field.density_head.weight)), "uniform_weights"),
    ("pairing", begun(lambda field: field.density_head.weight.mul_(2.0)), "density_head.weight"),
    ("rendering", NeedsDirections, "what now"),
    ("repeats", seen(flickering), "another picture"),
    ("pointwise", seen(with_neighbours), "pointwise is True"),
    ("pointwise", but(pointwise=False), "pointwise is False"),
    ("two_passes", begun(knows_no_second_pass), "one of me is enough"),
    ("record", but(parameter_counts=lambda self: {"total": 7.0}), "parameter_counts"),
    pytest.param("training_repeats", seen(by_chance_in_training), "another one after", marks=pytest.mark.slow),
    pytest.param("checkpoint", HidesWhatItLearnt, "restored", marks=pytest.mark.slow),
    pytest.param("going_on", HidesWhereItIs, "after it went on", marks=pytest.mark.slow),
    pytest.param("learning", seen(uphill), "mean squared error", marks=pytest.mark.slow),
]


def outcome_of(check: str, monkeypatch: pytest.MonkeyPatch) -> tuple[str, str]:
    """Of one check alone."""
    monkeypatch.setattr("harness.studies.conformance.method_checks.CHECKS", {check: CHECKS[check]})
    (outcome,) = conformance(Subject("tried"))
    return outcome.verdict, outcome.reason


@pytest.mark.parametrize(("check", "field", "said"), BROKEN)
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
    assert [outcome for outcome in conformance(Subject("tried")) if outcome.verdict != "held"] == []


def test_every_check_has_a_method_that_it_finds() -> None:
    assert {getattr(row, "values", row)[0] for row in BROKEN} == set(CHECKS)


def test_the_command_says_it_and_ends_with_3(monkeypatch: pytest.MonkeyPatch) -> None:
    import argparse

    monkeypatch.setitem(CATALOG, "tried", Method(None, "a broken one", make_field=MISCOUNTING))
    monkeypatch.setattr("harness.studies.conformance.method_checks.CHECKS", {"protocols": CHECKS["protocols"]})
    monkeypatch.setattr("harness.plan.plugins.offered", dict)
    lines: list[str] = []
    show = Quiet()
    monkeypatch.setattr(show, "line", lines.append)
    options = argparse.Namespace(methods=["tried"], list=False)
    assert run_conformance(options, show) == 3
    assert any(line.startswith("  broken") and "7 in total" in line for line in lines)
    assert lines[-1] == "  1 broken"
