"""The record of a cell that never trained: the method cannot run here, or its group failed."""

from harness.records import CellRecord, Status


def unscored(scene: str, method: str, seed: int, status: Status, reason: str) -> CellRecord:
    """A record without a step, a score or a weight, that says why."""
    return CellRecord(
        scene=scene,
        method=method,
        seed=seed,
        status=status,
        reason=reason,
        steps=0,
        train_seconds=0.0,
        scores={},
        curve=[],
        views=[],
        trace={},
        parameters={},
        properties={},
        warnings=[],
        settings={},
        provenance={},
    )
