"""The constants that the paper leaves open: the unit of density and the start of the field, chosen for each method by
the same search on validation views (`python -m harness study constants`), never on test views.
"""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("chosen.json")


@dataclass(frozen=True)
class DensityConstants:
    """The constants that map the raw output of a method's network to a density, per half of the box's longest side."""

    unit: float
    """The density where the amplifier gives 1."""
    start: float | None
    """The density of a fresh field; None: no shift of the raw output, as the paper's listings print it."""

    @property
    def fields(self) -> dict[str, Any]:
        return {"density_scale": self.unit, "start": self.start}


@cache
def chosen(profile: str) -> dict[str, DensityConstants]:
    """Map method → the constants chosen at the scale of a profile; empty if nothing was searched there."""
    choices = json.loads(FILE.read_text(encoding="utf-8")).get(profile, {})
    return {method: DensityConstants(**constants) for method, constants in choices.items()}


def parts_of(method: str) -> dict[str, Any]:
    return chosen("reduced")[method].fields


def adopt(profile: str, choice: dict[str, object]) -> None:
    """Write the constants of a profile, as plain data, into `FILE`."""
    choices = json.loads(FILE.read_text(encoding="utf-8"))
    FILE.write_text(json.dumps({**choices, profile: choice}, indent=2) + "\n", encoding="utf-8")
