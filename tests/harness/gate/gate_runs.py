"""Limits, references and samples that make every gate pass, in the place of what measures them."""

from pathlib import Path

import numpy as np
import pytest

from harness.__main__ import main
from harness.gate import gate_run
from harness.gate.gates import KINDS, Gate, gates, settings_of
from harness.gate.limits import KindFacts, Limit, LimitsFile, write_limits
from harness.gate.outcome import GateContext, Pictures, Sample
from harness.gate.process import class_here
from harness.gate.references import Course, References, write_references

CENTRE = 25.0


def measured_values() -> dict[str, list[float]]:
    """As a renewal gives them of images."""
    generator = np.random.default_rng(1)
    return {
        gate.name: (CENTRE + 0.1 * generator.standard_normal(12)).tolist() for gate in gates() if gate.kind == "images"
    }


def facts(kind: str) -> KindFacts:
    return KindFacts(settings_of(kind), {}, 1.0)  # type: ignore[arg-type]


def references(name: str) -> References:
    return References(
        name,
        kinds={kind: facts(kind) for kind in ("changed", "worse", "speed")},
        courses={"double": {"nerf": Course([0.5], {"1": [0.25]})}},
        reordered={"double": {"two threads": 1e-14}},
        cells={"lego/nerf/1000": {"psnr": [20.0, 20.1, 20.2]}},
        statistics={"qnerf_nerf": [0.5, 0.25, 0.75]},
        speed={"speed.score": [2.0, 2.1]},
    )


@pytest.fixture
def limits(tmp_path: Path) -> Path:
    file = tmp_path / "gates" / "limits.json"
    write_limits(file, LimitsFile().renewed("images", measured_values(), facts("images"), gates()))
    write_references(tmp_path / "gates" / "classes", references(class_here()))
    return file


def sound(gate: Gate) -> Sample:
    """As each kind gives it: what depends on the class of the processor brings its limit along."""
    picture = np.full((4, 4, 3), 0.25)
    limit = Limit(CENTRE - 1.0, CENTRE + 1.0) if gate.rule == "of_class" else None
    value = 0.0 if gate.rule == "none_differs" else CENTRE
    return Sample([value] * gate.new, pictures=Pictures(picture, 2 * picture, picture), limit=limit)


@pytest.fixture
def measuring(monkeypatch: pytest.MonkeyPatch) -> dict[str, Sample]:
    """Gates that give something else than what is sound, by name."""
    changed: dict[str, Sample] = {}

    def measure(situation: GateContext, of_kind: tuple[Gate, ...]) -> dict[str, Sample]:
        return {gate.name: changed.get(gate.name, sound(gate)) for gate in of_kind}

    monkeypatch.setattr(gate_run, "MEASURES", dict.fromkeys(KINDS, measure))
    monkeypatch.setattr(gate_run, "INPUTS", {})
    return changed


def gate_line(limits: Path, out: Path, *others: str) -> int:
    return main(["gate", "--limits", str(limits), "--out", str(out), *others])
