"""The context of the stability cases, the owner of a formula, and the checks that several cases build."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from baselines.catalog import CATALOG
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.records.study import Check, Owner, Status, check
from harness.studies.framework import StudyContext

METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_theorem", "qnerf_listing4", "qnerf_repaired", "voxels_drjit")

PRINTED = ("listing2", "equation4")
"""The amplifiers as the paper prints them; the others belong to this harness and must pass."""

_Error = TypeVar("_Error", bound=Exception)


@dataclass(frozen=True)
class StabilityContext(StudyContext):
    methods: tuple[str, ...]
    cases: tuple[str, ...] = ()
    """The cases of this run: those that share a training request all of its cells at once."""

    def settings(self) -> dict[str, object]:
        return {"methods": list(self.methods), "quick": self.quick, "precision": "float32"}

    def within(self, scratch: Path, missing: tuple[str, ...]) -> "StabilityContext":
        return replace(self, scratch=scratch, cases=missing)

    def plan(self, profile: str, scenes: list[str] | None = None) -> Plan:
        """Return `profile` with this run's methods, in float32, which every machine has."""
        plan = PROFILES[profile].without_extras().in_float32()
        plan = replace(plan, scenes=tuple(scenes or plan.scenes), methods=self.methods)
        if not self.quick:
            return plan
        views = replace(plan.views, resolution=16, train=6, val=0, test=2, spp_train=4, spp_test=4)
        return replace(plan, budget=replace(plan.budget, steps=4), views=views)


def owner_of_method(method: str) -> Owner:
    """Return the owner of a method: the paper if one of its parts is a listing as printed, else this harness."""
    parts = CATALOG[method].parts
    printed = parts is not None and (parts.amplifier in PRINTED or parts.quadrature == "listing4")
    return "paper" if printed else "ours"


def error_of(kind: type[_Error], attempt: Callable[..., object], *arguments: object) -> _Error | None:
    try:
        attempt(*arguments)
    except kind as error:
        return error
    return None


def not_judged(subject: str, why: str, status: Status = "not_applicable", owner: Owner = "ours") -> Check:
    return Check("", None, why=why, subject=subject, owner=owner, status=status)


def worst_of(errors: Iterable[float]) -> float:
    """Return the largest error; one that is not finite is the worst, as `max` can pass over a NaN."""
    return max(errors, key=lambda error: error if math.isfinite(error) else math.inf)


def none_of(what: str, offenders: Sequence[str], subject: str, owner: Owner = "ours") -> Check:
    return check(what, len(offenders), high=0, why="; ".join(offenders), subject=subject, owner=owner)


def ours_and_usual(what: str, figures: Mapping[str, float], high: float) -> Iterator[Check]:
    """Check a figure of this harness and the same figure of the usual form: two subjects, in that order."""
    owners: tuple[Owner, Owner] = ("ours", "usual")
    for (subject, figure), owner in zip(figures.items(), owners, strict=True):
        yield check(what, figure, high=high, subject=subject, owner=owner)
