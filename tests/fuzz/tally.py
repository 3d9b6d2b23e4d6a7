"""What became of the inputs of a target, and the list of all targets."""

from collections import Counter
from dataclasses import dataclass, field, fields
from typing import Any

GUIDED = "-guided"
"""After a target's name: its inputs were guided by coverage."""


@dataclass
class Tally:
    """Of one target and way."""

    tried: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    refusals: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    features: list[int] = field(default_factory=list)
    """Coverage as libFuzzer counts it: when it had tried the inputs that it began with, and at the end."""

    def as_json(self) -> dict[str, Any]:
        return {**self.__dict__, "refusals": dict(self.refusals), "faults": dict(self.faults)}

    @staticmethod
    def of_json(data: dict[str, Any]) -> "Tally":
        return Tally(**{**data, "refusals": Counter(data["refusals"]), "faults": Counter(data["faults"])})


def added(one: Tally, other: Tally) -> Tally:
    """Both together; of two guided ones from the first's beginning to the second's end."""
    sums = {f.name: getattr(one, f.name) + getattr(other, f.name) for f in fields(Tally) if f.name != "features"}
    features = [*one.features, *other.features]
    return Tally(**sums, features=[features[0], features[-1]] if features else [])


def row(name: str, tally: Tally) -> str:
    grown = f", coverage {tally.features[0]} → {tally.features[-1]}" if tally.features else ""
    return (
        f"{name:26} {tally.tried:8} tried in {tally.seconds:6.0f} s {tally.accepted:8} accepted {tally.refused:8} "
        f"refused in {len(tally.refusals):4} ways {sum(tally.faults.values()):6} faults of {len(tally.faults):3} kinds"
        f"{grown}"
    )


def table(found: dict[str, Tally]) -> str:
    """A line for each target and way, their sum, and every fault."""
    whole = Tally()
    for one in found.values():
        whole = added(whole, one)
    whole.features = []
    rows = [row(name, one) for name, one in {**dict(sorted(found.items())), "all": whole}.items()]
    return "\n".join([*rows, *(f"{name}: {fault}: {n}" for name, t in found.items() for fault, n in t.faults.items())])
