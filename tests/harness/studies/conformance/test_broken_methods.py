"""Each check detects a method that breaks it, and every check has such a method."""

import argparse
import math
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
from harness.execution.progress import Progress
from harness.studies.conformance.derivatives import BARS, DOUBLE, SINGLE, Ladder, difference
from harness.studies.conformance.method_checks import CHECKS, conformance
from harness.studies.conformance.subject import Subject


class Honest(NetworkField):
    """NeRF as the field of a user's package."""

    def __init__(self, spec: FieldSpec) -> None:
        super().__init__(NERF, spec.size, spec.box, spec.precision, spec.seed, spec.view_dependent)
        self.seed = spec.seed


def with_attributes(**attributes: Any) -> type:
    return type("Changed", (Honest,), attributes)


def with_output(change: Callable[[Any, Tensor, Tensor], Any], **attributes: Any) -> type:
    """A field whose density and colour are those of `change(field, density, colour)`."""

    def density_and_colour(self: Honest, x: Any, view: Any, ray: Any) -> Any:
        return change(self, *Honest.density_and_colour(self, x, view, ray))

    return with_attributes(density_and_colour=density_and_colour, **attributes)


def with_start(change: Callable[[Any], object]) -> type:
    """A field that is changed when it is made."""

    @torch.no_grad()
    def start(self: Honest, spec: FieldSpec) -> None:
        Honest.__init__(self, spec)
        change(self)

    return with_attributes(__init__=start)


def needing_directions(self: Honest, d: Any) -> Any:
    if not self.view_dependent:
        raise RuntimeError("what now?")
    return Honest.encode_directions(self, d)


def knows_no_second_pass(field: Any) -> None:
    if str(field.seed).endswith("/fine"):
        raise ValueError("one of me is enough")


def with_hidden_calls(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    """A running value that is not a buffer, and so not in the checkpoint. Unless `shown_in_pictures`, only a resumed
    cell shows that it is lost.
    """
    field.calls += torch.is_grad_enabled()
    shown = torch.is_grad_enabled() or field.shown_in_pictures
    return sigma, colour / (1.0 + 0.01 * field.calls) if shown else colour


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


def half_in_single(field: Any, sigma: Tensor, colour: Tensor) -> Any:
    """As above, with a kernel of single precision only."""
    if sigma.dtype != torch.float32:
        raise TypeError("float32 only")
    return half_of_the_gradient(field, sigma, colour)


HIDING = {shown: with_output(with_hidden_calls, calls=0, shown_in_pictures=shown) for shown in (True, False)}
MISCOUNTING = with_attributes(parameter_counts=lambda self: {"total": 7})
BROKEN: list[Any] = [
    ("protocols", lambda spec: "a field", "torch.nn.Module"),
    ("protocols", lambda spec: nn.Linear(3, 4), "lacks"),
    ("protocols", MISCOUNTING, "7 in total"),
    ("shapes", with_attributes(density=lambda self, x: Honest.density(self, x).unsqueeze(-1)), "density of 0 points"),
    ("ranges", with_output(lambda field, sigma, colour: (sigma - 1.0, colour)), "density is"),
    ("ranges", with_attributes(density_limit=1.0), "not 0 to 1"),
    ("unit_of_density", with_output(lambda field, sigma, c: (sigma * field.box.half_extent, c)), "unit of length"),
    ("magnitudes", with_output(divided_by_weights), "not finite"),
    ("gradients", with_start(lambda field: setattr(field, "spare", nn.Parameter(torch.zeros(3)))), "reaches spare"),
    ("derivatives", with_output(half_of_the_gradient), "by differences"),
    ("derivatives", with_output(half_in_single), "by differences"),
    ("derivatives", with_output(lambda field, sigma, c: (0.5 * (sigma + sigma.detach()), c)), "by differences"),
    ("first_weights", with_start(lambda field: nn.init.normal_(field.density_head.weight)), "uniform_weights"),
    ("pairing", with_start(lambda field: field.density_head.weight.mul_(2.0)), "density_head.weight"),
    ("rendering", with_attributes(encode_directions=needing_directions), "what now"),
    ("repeats", with_output(flickering), "another picture"),
    ("pointwise", with_output(with_neighbours), "pointwise is True"),
    ("pointwise", with_attributes(pointwise=False), "pointwise is False"),
    ("two_passes", with_start(knows_no_second_pass), "one of me is enough"),
    ("record", with_attributes(parameter_counts=lambda self: {"total": 7.0}), "parameter_counts"),
    pytest.param("training_repeats", with_output(by_chance_in_training), "differs after", marks=pytest.mark.slow),
    pytest.param("checkpoint", HIDING[True], "restored", marks=pytest.mark.slow),
    pytest.param("going_on", HIDING[False], "after it was resumed", marks=pytest.mark.slow),
    pytest.param("learning", with_output(uphill), "mean squared error", marks=pytest.mark.slow),
]


def only(check: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.studies.conformance.method_checks.CHECKS", {check: CHECKS[check]})


@pytest.mark.parametrize(("check", "field", "said"), BROKEN)
def test_a_broken_method_is_detected_with_the_reason(
    check: str, field: Callable[[FieldSpec], Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(None, "a broken one", make_field=field))
    only(check, monkeypatch)
    (outcome,) = conformance(Subject("tried"))
    assert outcome.verdict == "broken"
    assert said in outcome.reason
    assert "\n" not in outcome.reason


@pytest.mark.slow
def test_the_valid_method_that_they_are_made_of_conforms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(None, "NeRF by other means", make_field=Honest))
    assert [outcome for outcome in conformance(Subject("tried")) if outcome.verdict != "held"] == []


def test_every_check_has_a_method_that_breaks_it() -> None:
    assert {getattr(row, "values", row)[0] for row in BROKEN} == set(CHECKS)


def test_the_command_reports_a_broken_check_and_ends_with_3(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(None, "a broken one", make_field=MISCOUNTING))
    only("protocols", monkeypatch)
    monkeypatch.setattr("harness.plan.plugins.offered", dict)
    lines: list[str] = []
    show = Progress()
    monkeypatch.setattr(show, "line", lines.append)
    options = argparse.Namespace(methods=["tried"], list=False)
    assert run_conformance(options, show) == 3
    assert any(line.startswith("  broken") and "7 in total" in line for line in lines)
    assert lines[-1] == "  1 broken"


# differences over a ladder of steps against known derivatives

E1 = torch.tensor([1.0, 0.0])


@pytest.mark.parametrize("ladder", [DOUBLE, SINGLE])
def test_the_bar_holds_the_error_of_a_smooth_function(ladder: Ladder) -> None:
    parameter = torch.tensor([0.7, -0.2], dtype=ladder.dtype)
    eps = torch.finfo(ladder.dtype).eps
    value, bar = difference(lambda: torch.exp(parameter).sum(), parameter, E1.to(ladder.dtype), ladder.steps, 4 * eps)
    assert abs(value - math.exp(0.7)) <= BARS * bar
    assert bar < 1e4 * eps**0.5
    assert parameter.tolist() == torch.tensor([0.7, -0.2], dtype=ladder.dtype).tolist()


def test_a_step_function_is_not_resolved() -> None:
    parameter = torch.tensor([0.0, 1.0], dtype=torch.float64)
    value, bar = difference(lambda: (parameter[0] > 0).double(), parameter, E1.double(), DOUBLE.steps, 1e-16)
    assert bar > 0.4 * abs(value) > 0.0


def test_rounding_widens_the_bar() -> None:
    parameter = torch.tensor([0.7, 0.1], dtype=torch.float64)
    bars = [
        difference(lambda: torch.sin(parameter).sum(), parameter, E1.double(), DOUBLE.steps, error).bar
        for error in (1e-16, 1e-10)
    ]
    assert bars[1] > 100 * bars[0]
