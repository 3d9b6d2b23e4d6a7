"""The ledger's entries as a run record keeps them, and what becomes of one: a claim with its verdict.

`RunRecord.paper` holds the paper's tables and, under `ledger`, every printed number of it.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from harness.evidence_record import EvidenceRecord
from harness.json_record import DamagedRecord
from harness.serving_record import ServingRecord
from harness.targets_record import TargetsRecord
from reports.load import REMEDY, Records
from reports.scale import in_a_line, is_paper_scale
from reports.selection import Selection
from reports.wording import UNTESTED, Verdict

Number = int | float
Pair = tuple[float, float]

OWN_FIGURES = "the paper’s own figures"


@dataclass(frozen=True)
class Printed:
    """A printed number, as `harness.paper` lists it."""

    id: str
    where: tuple[str, ...]
    printed: Number | Pair | None
    statement: str
    rule: str
    unit: str = ""
    of: dict[str, str] = field(default_factory=dict)
    leaves_open: Pair | None = None

    @property
    def digits(self) -> int:
        """Decimals as printed."""
        return {"dB": 1, "h": 1}.get(self.unit, 3 if self.of.get("metric") == "ssim" else 0)


@dataclass(frozen=True)
class Claim:
    """A printed number with what was measured and a verdict."""

    id: str
    source: str
    """Every place of the paper that states it."""
    statement: str
    printed: Number | Pair | None
    measured: Number | Pair | None
    """A range as a pair: from the worst to the best scene."""
    interval: Pair | None
    """95 %, and the one that the verdict is taken from where there is one."""
    scale: str
    verdict: Verdict
    how: str
    """How it is measured here."""
    kind: str
    """What sort of statement it is: a key of `reports.claims.KINDS`."""
    unit: str = ""
    digits: int = 0
    """Decimals of the printed number."""
    note: str = ""
    """What qualifies the verdict; of what was not tested, what it needs."""
    runs: Selection | None = None
    """The runs of this report that the verdict is taken from; None where it is of something else, or there is none."""


@dataclass(frozen=True)
class Bench:
    """What claims are judged by."""

    records: Records
    evidence: EvidenceRecord | None
    targets: TargetsRecord | None
    serving: ServingRecord | None = None

    @property
    def paper(self) -> dict[str, Any]:
        return self.records.run.paper

    @cached_property
    def scale(self) -> str:
        """Of the run, in a line."""
        return in_a_line(self.records)

    def at_paper_scale(self, scene: str) -> bool:
        """Whether what was measured on a scene, or over `all`, can speak of the paper's own numbers."""
        return is_paper_scale(self.records, scene)

    def row(self, table: str, name: str) -> dict[str, Any]:
        """A row of one of the paper's tables; empty where the record has none."""
        found = self.paper.get(table)
        row = found.get(name) if isinstance(found, dict) else None
        return row if isinstance(row, dict) else {}

    def scenes_of_table2(self) -> dict[str, dict[str, float]]:
        """Scene → row, without the average."""
        table = self.paper.get("table2") or {}
        return {scene: row for scene, row in table.items() if isinstance(row, dict) and scene not in ("average", "all")}


@dataclass(frozen=True)
class Finding:
    """What a judge says of an entry."""

    verdict: Verdict
    how: str
    measured: Number | Pair | None = None
    interval: Pair | None = None
    scale: str = ""
    """Where it is not that of the run."""
    note: str = ""
    runs: Selection | None = None
    """Of this report, all that `measured` is taken from."""


def claim_of(entry: Printed, found: Finding, kind: str, scale: str) -> Claim:
    return Claim(
        entry.id,
        ", ".join(entry.where),
        entry.statement,
        entry.printed,
        found.measured,
        found.interval,
        found.scale or scale,
        found.verdict,
        found.how,
        kind,
        entry.unit,
        entry.digits,
        found.note,
        found.runs if found.verdict != UNTESTED else None,
    )


def entries(paper: dict[str, Any]) -> list[Printed]:
    """The ledger of a record, in the paper's order; raises `DamagedRecord` where it is not as the harness writes it."""
    try:
        return [
            Printed(
                **{
                    **row,
                    "where": tuple(row["where"]),
                    "printed": _pair(row["printed"]),
                    "leaves_open": _pair(row.get("leaves_open")),
                }
            )
            for row in paper.get("ledger") or []
        ]
    except (TypeError, KeyError) as error:
        raise DamagedRecord(f"run.json: the paper's ledger is not readable ({error}); {REMEDY}") from error


def _pair(value: Any) -> Any:
    return (value[0], value[1]) if isinstance(value, list | tuple) else value
