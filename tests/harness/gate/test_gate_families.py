"""The gates of the other families are judged by the spread of seeds; families that cannot run are not available."""

from pathlib import Path

import pytest
from msgspec import structs

from harness.gate import gate_families
from harness.gate.gates import FAMILIES, FAMILY_RENEWAL, FAMILY_SEEDS, gates
from harness.records.cells import CellRecord
from harness.records.study import Check
from scenes.files.errors import InputError
from tests.harness.cells import cell, checkpoint
from tests.harness.gate.gate_runs import CENTRE, context_of


def cells(seeds: tuple[int, ...], psnr: float = CENTRE, **others: object) -> list[CellRecord]:
    made = [cell("lego", name, seed, [checkpoint(150, 1.0, psnr)]) for name in FAMILIES for seed in seeds]
    return [structs.replace(one, scores={"psnr": psnr}, **others) for one in made]


def checks(limits: Path, monkeypatch: pytest.MonkeyPatch, trained: list[CellRecord]) -> dict[str, Check]:
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: trained)
    chosen = tuple(gate for gate in gates() if gate.kind == "families")
    found = gate_families.measure(context_of(chosen, limits))
    return {check.id: check for check in found if isinstance(check, Check)}


def test_a_family_within_the_spread_of_seeds_passes_and_a_worse_one_fails(
    limits: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert {check.status for check in checks(limits, monkeypatch, cells(FAMILY_SEEDS)).values()} == {"pass"}
    found = checks(limits, monkeypatch, cells(FAMILY_SEEDS, CENTRE - 1.0))
    assert set(found) == {f"families.{name}" for name in FAMILIES}
    assert {check.status for check in found.values()} == {"fail"}


def test_what_diverged_fails_with_its_reason_and_what_cannot_run_here_is_not_available(
    limits: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    diverged = checks(limits, monkeypatch, cells(FAMILY_SEEDS, status="diverged", reason="step 3: loss"))
    assert {(check.status, check.why.split(";")[0]) for check in diverged.values()} == {("fail", "step 3: loss")}
    missing = checks(limits, monkeypatch, cells(FAMILY_SEEDS, status="not_available", reason="needs LLVM"))
    assert {check.status for check in missing.values()} == {"not_available"}
    assert not any(check.is_broken for check in missing.values())


def test_limits_are_made_of_trainings_that_ended(limits: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    context = context_of((), limits)
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: cells(FAMILY_RENEWAL))
    assert gate_families.renew(context) == {f"families.{name}": [CENTRE] * len(FAMILY_RENEWAL) for name in FAMILIES}
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: cells(FAMILY_RENEWAL, status="diverged"))
    with pytest.raises(InputError, match="trainings that did not end"):
        gate_families.renew(context)


def test_no_seed_of_a_gate_is_one_of_its_limits() -> None:
    assert not set(FAMILY_SEEDS) & set(FAMILY_RENEWAL)
