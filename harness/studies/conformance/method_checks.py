"""All checks by name; a check is a function of a method that raises if it does not hold."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from harness.studies.conformance import derivatives, field_checks, learner_checks
from harness.studies.conformance.subject import Broken, Subject
from harness.training.make_learner import NotAvailable
from scenes.files.errors import named

FIELD_CHECKS: dict[str, Callable[[Subject], None]] = {
    "protocols": field_checks.keeps_the_protocols,
    "shapes": field_checks.gives_the_right_shapes,
    "ranges": field_checks.stays_in_range,
    "unit_of_density": field_checks.has_the_unit_of_the_box,
    "magnitudes": field_checks.survives_magnitudes,
    "gradients": field_checks.gradients_reach_everything,
    "derivatives": derivatives.gradients_are_derivatives,
    "first_weights": field_checks.weights_depend_on_the_seed_alone,
    "pairing": field_checks.is_paired_with_nerf,
    "rendering": field_checks.renders_in_range,
    "repeats": field_checks.renders_the_same_again,
    "pointwise": field_checks.pointwise_is_true,
    "two_passes": learner_checks.trains_with_two_passes,
}
"""The checks of methods whose field is a torch module that the renderer of this harness evaluates."""
LEARNER_CHECKS: dict[str, Callable[[Subject], None]] = {
    "record": learner_checks.can_be_recorded,
    "training_repeats": learner_checks.learns_the_same_again,
    "checkpoint": learner_checks.comes_back_from_its_checkpoint,
    "going_on": learner_checks.goes_on_in_the_middle,
    "learning": learner_checks.learns,
}
CHECKS = {**FIELD_CHECKS, **LEARNER_CHECKS}


@dataclass(frozen=True)
class CheckOutcome:
    method: str
    check: str
    verdict: Literal["held", "broken", "not applicable"]
    reason: str = ""


def meaning(check: str) -> str:
    return " ".join((CHECKS[check].__doc__ or "").split())


def conformance(subject: Subject) -> Iterator[CheckOutcome]:
    """Run every check in turn; an exception of the method counts as a broken check, and the next check runs."""
    for name, check in CHECKS.items():
        if name in FIELD_CHECKS and not subject.method.is_field:
            yield CheckOutcome(subject.name, name, "not applicable", "no torch field")
            continue
        try:
            check(subject)
        except NotAvailable as missing:
            yield CheckOutcome(subject.name, name, "not applicable", str(missing))
        except Exception as error:
            yield CheckOutcome(subject.name, name, "broken", str(error) if isinstance(error, Broken) else named(error))
        else:
            yield CheckOutcome(subject.name, name, "held")
