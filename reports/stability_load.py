"""OUT/stability.json → a record of which every figure may be trusted to be what its type says."""

from collections import Counter
from pathlib import Path

from harness.stability_record import STABILITY_FILE, StabilityRecord, read_stability
from reports.load import find_record, uneven

REMEDY = "run `nox -s stability` again"


def find_stability(out: Path) -> StabilityRecord | None:
    """The stability record under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(out / STABILITY_FILE, StabilityRecord, read_stability, _contradiction, REMEDY)


def _contradiction(record: StabilityRecord) -> str | None:
    """The first thing that no run writes, though every type is right."""
    twice = [name for name, many in Counter(case.info.id for case in record.cases).items() if many > 1]
    if twice:
        return f"case {twice[0]!r} is there twice"
    for case in record.cases:
        stray = next((one.case for one in case.outcomes if one.case != case.info.id), None)
        if stray is not None:
            return f"case {case.info.id!r} holds an outcome of case {stray!r}"
        wrong = uneven(case.series, case.tables)
        if wrong is not None:
            return f"case {case.info.id!r}: {wrong}"
    return None
