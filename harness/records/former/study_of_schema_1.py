"""Records of the studies as versions before one shape for all shelves wrote them, brought into that shape.

The three shelves had a schema 1 each: studies with lists of their findings by kind; cases with outcomes against one
bar; and measurements by the number of their question.
"""

from typing import Any

Row = dict[str, Any]
KINDS = {"effects": "effect", "series": "series", "tables": "table", "pictures": "picture"}
QUESTIONS: dict[int, str] = {
    1: "Training throughput at the paper's network",
    2: "Share of the machine's matrix rate",
    3: "Time to a target PSNR",
    4: "Full-frame rendering",
    5: "Encodings",
    6: "Quadrature",
    7: "Ground truth by Mitsuba variant",
    8: "Peak memory",
    9: "How the cost grows",
    10: "Several processes on all cores",
    11: "What each acceleration gains",
}


def converted(shelf: str, data: Row) -> Row:
    """Return the record of a shelf as plain data of schema 2; raises what a dictionary does if something is missing."""
    studies = {"evidence": _evidence, "stability": _stability, "speed": _speed}[shelf](data)
    common = {name: data[name] for name in ("provenance", "settings")}
    return {**common, "shelf": shelf, "schema": 2, "finished": data.get("finished", True), "studies": studies}


def _of_kinds(row: Row) -> list[Row]:
    return [{"type": kind, **finding} for name, kind in KINDS.items() for finding in row.get(name, [])]


def _check(row: Row, value: str, limits: tuple[float | None, float | None], names: str, **others: Any) -> Row:
    """Return a check with what else stands in `row` under `names`; its status is computed unless it stands there."""
    figure, (low, high) = row[value], limits
    holds = figure is not None and (low is None or figure >= low) and (high is None or figure <= high)
    facts = {"value": figure, "low": low, "high": high, "status": "pass" if holds else "fail"}
    return {"type": "check", **facts, **{name: row[name] for name in names.split()}, **others}


def _limits(row: Row, name: str) -> tuple[float | None, float | None]:
    return (None, row[name]) if row["sense"] == "at_most" else (row[name], None)


def _evidence(data: Row) -> list[Row]:
    studies = []
    for row in data["studies"]:
        findings = [{"type": "answer", "text": text} for text in row["findings"]]
        for check in row["checks"]:
            findings.append(_check(check, "figure", (check["low"], check["high"]), "what unit why"))
        kept = {name: row[name] for name in ("info", "scale", "seconds")}
        studies.append({**kept, "findings": [*findings, *_of_kinds(row)]})
    return studies


def _stability(data: Row) -> list[Row]:
    studies = []
    for row in data["cases"]:
        info = row["info"]
        checks = [
            _check(check, "figure", _limits(check, "bar"), "what unit why subject status", owner=check["whose"])
            for check in row["outcomes"]
        ]
        facts = {name: info[name] for name in ("input", "danger", "reference", "bar")}
        about = {"id": info["id"], "title": info["title"], "facts": facts}
        studies.append({"info": about, "seconds": row["seconds"], "findings": [*checks, *_of_kinds(row)]})
    return studies


def _speed(data: Row) -> list[Row]:
    studies = []
    for item in [*QUESTIONS, *sorted({row["item"] for row in data["measurements"]} - set(QUESTIONS))]:
        findings = [_measurement(row) for row in data["measurements"] if row["item"] == item]
        findings += [finding for finding in _of_kinds(data) if finding["item"] == item]
        if findings or str(item) in data["seconds"]:
            info = {"id": str(item), "title": QUESTIONS.get(item, f"Question {item}")}
            studies.append({"info": info, "findings": findings, "seconds": data["seconds"].get(str(item), 0.0)})
    return studies


def _measurement(row: Row) -> Row:
    spread = None if row["low"] is None or row["high"] is None else [row["low"], row["high"]]
    words = {"what": row["title"], "why": row["detail"], "owner": "machine", "spread": spread}
    check = _check(row, "value", _limits(row, "target"), "id unit repeats", **words)
    measured = row["target"] is None and check["status"] == "pass"
    return {**check, "status": "measured"} if measured else check
