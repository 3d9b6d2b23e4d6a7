"""What the made-up records of all shelves share: their provenance, their lines, their files, and hostile ones."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.study import SHELVES, Check, Picture, Series, Studies, StudyInfo, StudyRecord, Table, write_studies

PROVENANCE: dict[str, Any] = {"commit": "0123456789ab", "python": "3.11.2", "cores": 2, "packages": {"torch": "2.15.0"}}


def shelf(name: str, studies: list[StudyRecord], settings: dict[str, Any], changes: dict[str, Any]) -> Studies:
    """Return a finished record, but for its changes."""
    facts = {"provenance": PROVENANCE, "settings": settings, "studies": studies, "finished": True, **changes}
    return Studies(shelf=name, **facts)


def write_shelf(out: Path, record: Studies) -> Path:
    """Write the record under `out`, and return `out`."""
    out.mkdir(parents=True, exist_ok=True)
    write_studies(out / SHELVES[record.shelf], record)
    return out


def lines(
    panel: str, item: int, axes: tuple[str, str], x: list[float], y_of: Callable[..., float],
    names: dict[str, tuple[float, ...]], log: str = "xy",
) -> list[Series]:  # fmt: skip
    """A line for each name: `y_of` of x and what stands behind the name; `log` are the logarithmic axes."""
    return [
        Series(panel, item, name, *axes, x, [y_of(at, *more) for at in x], log_x="x" in log, log_y="y" in log)
        for name, more in names.items()
    ]


def hostile(record: Studies, word: str) -> Studies:
    """`record` with `word` wherever it holds text of its own."""

    def spoiled(finding: Any) -> Any:
        match finding:
            case Check():
                return replace(finding, subject=f"{word} {finding.subject}", what=word, why=word, unit=word, id=word)
            case Series():
                return replace(finding, panel=word, name=f"{word} {finding.name}", x_label=word, y_label=word)
            case Table():
                columns = [word for _ in finding.columns]
                return replace(finding, title=word, columns=columns, rows=[columns for _ in finding.rows])
            case Picture():
                return replace(finding, title=word, caption=word)
        return finding

    facts = dict.fromkeys(("input", "danger", "reference", "bar"), word)
    studies = []
    for study in record.studies:
        info = StudyInfo(f"{word} {study.info.id}", word, facts=facts)
        studies.append(StudyRecord(info, findings=[spoiled(finding) for finding in study.findings], seconds=1.0))
    provenance = {word: word, "processor": word, "device": word}
    return replace(record, studies=studies, provenance=provenance, settings={word: [word]})
