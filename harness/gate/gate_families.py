"""Is one of the other families worse? A short training of each, compared with trainings of other seeds.

A family's kernels sum in another order on each processor, and a change of the program may draw other numbers. Both are
like another seed here, so that one limit holds for every processor.
"""

from collections.abc import Iterator

from msgspec import structs

from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import FAMILIES, FAMILY_RENEWAL, FAMILY_SCENE, FAMILY_SEEDS
from harness.gate.limits import judge
from harness.gate.quality.short_trainings import ended, trained
from harness.records.study import Check


@complete("families")
def measure(context: GateContext) -> Iterator[Check]:
    """Train the families of the chosen gates; a family that this machine cannot train is not available."""
    gates = context.of_kind("families")
    names = tuple(name for name in FAMILIES if f"families.{name}" in gates)
    cells = trained(context, names, scenes=(FAMILY_SCENE,), seeds=FAMILY_SEEDS)
    for name, gate in gates.items():
        own = [cell for cell in cells if name == f"families.{cell.method}"]
        scores = [cell.scores.get("psnr") if cell.status == "done" else None for cell in own]
        why = "; ".join(dict.fromkeys(cell.reason or cell.status for cell in own if cell.status != "done"))
        check = judge(gate, scores, context.limits.limit_of(gate), why)
        missing = bool(own) and all(cell.status == "not_available" for cell in own)
        yield structs.replace(check, status="not_available") if missing else check


def renew(context: GateContext) -> dict[str, list[float]]:
    """Return the scores of other seeds, from which limits are made; raises `InputError` if a training did not end."""
    cells = ended(trained(context, FAMILIES, scenes=(FAMILY_SCENE,), seeds=FAMILY_RENEWAL), "limits")
    scores: dict[str, list[float]] = {}
    for cell in cells:
        if (score := cell.scores["psnr"]) is not None:
            scores.setdefault(f"families.{cell.method}", []).append(score)
    return scores
