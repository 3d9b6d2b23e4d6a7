"""The ledger's entries as a run record keeps them, and what becomes of one: a claim with its verdict.

`RunRecord.paper` holds the paper's tables and, under `ledger`, every printed number of it. Runs recorded before the
ledger was kept have the tables alone: of those the differences, savings and weights are read.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from harness.evidence_record import EvidenceRecord
from harness.json_record import DamagedRecord
from harness.serving_record import ServingRecord
from harness.targets_record import TargetsRecord
from reports.load import REMEDY, Records
from reports.selection import Selection

Verdict = Literal["holds", "does not hold", "inconclusive", "not tested at this scale"]
UNTESTED: Verdict = "not tested at this scale"
VERDICTS: tuple[Verdict, ...] = ("holds", "does not hold", "inconclusive", UNTESTED)

Number = int | float
Pair = tuple[float, float]

OWN_FIGURES = "the paper’s own figures"
SMALLER_SCALE = "a verdict is about the scale of this run"


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
    runs: Selection | None = None
    """The runs of this report that the verdict is taken from; None where it is of something else, or there is none."""


@dataclass(frozen=True)
class Bench:
    """What claims are judged by."""

    records: Records
    evidence: EvidenceRecord | None
    targets: TargetsRecord | None
    scale: str
    """Of the run, in a line."""
    at_paper_scale: bool
    serving: ServingRecord | None = None

    @property
    def paper(self) -> dict[str, Any]:
        return self.records.run.paper

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
    if "ledger" not in paper:
        return _from_tables(paper)
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
            for row in paper["ledger"]
        ]
    except (TypeError, KeyError) as error:
        raise DamagedRecord(f"run.json: the paper's ledger is not readable ({error}); {REMEDY}") from error


def _pair(value: Any) -> Any:
    return (value[0], value[1]) if isinstance(value, list | tuple) else value


def _from_tables(paper: dict[str, Any]) -> list[Printed]:
    """What older records allow to judge: gains, savings, weights."""
    found = []
    for component, weights in (paper.get("table1") or {}).items():
        of = {"component": component}
        found.append(
            Printed(f"table1-{component}", ("Table 1",), weights, f"Weights, {component}", "weights", "weights", of)
        )
    for scene, row in (paper.get("table2") or {}).items():
        whole = scene == "average"
        of = {"scene": "all" if whole else scene, "method": "qnerf", "against": "nerf", "metric": "psnr"}
        words = "Q-NeRF gains over NeRF on " + scene
        gain = round(row["qnerf"] - row["nerf"], 1)
        found.append(Printed(f"table2-{scene}", ("Table 2",), gain, words, "gain", "dB", of))
    for name, axis in (("iterations", "steps"), ("hours", "seconds")):
        row = (paper.get("table3") or {}).get(f"{name}_to_30_db")
        if row:
            saved = round(100 * (1 - row["qnerf"] / row["nerf"]))
            words = f"Q-NeRF needs this much fewer {name} to reach 30 dB"
            found.append(Printed(f"table3-{name}", ("Table 3",), saved, words, "saving", "%", {"axis": axis}))
    return found
