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
    """Return the record of a shelf as plain data of schema 2; raises what a dictionary raises if something is
    missing.
    """
    studies = {"evidence": _evidence, "stability": _stability, "speed": _speed}[shelf](data)
    common = {name: data[name] for name in ("provenance", "settings")}
    return {**common, "shelf": shelf, "schema": 2, "finished": data.get("finished", True), "studies": studies}


def _of_kinds(row: Row) -> list[Row]:
    return [{"type": kind, **one} for name, kind in KINDS.items() for one in row.get(name, [])]


def _check(row: Row, value: str, same: tuple[str, ...], **others: Any) -> Row:
    return {"type": "check", "value": row[value], **{name: row[name] for name in same}, **others}


def _status(value: float | None, low: float | None, high: float | None) -> str:
    holds = value is not None and (low is None or value >= low) and (high is None or value <= high)
    return "pass" if holds else "fail"


def _evidence(data: Row) -> list[Row]:
    studies = []
    for row in data["studies"]:
        checks = [
            _check(
                check, "figure", ("what", "low", "high", "unit", "why"),
                status=_status(check["figure"], check["low"], check["high"]),
            )
            for check in row["checks"]
        ]  # fmt: skip
        findings = [*({"type": "answer", "text": text} for text in row["findings"]), *checks, *_of_kinds(row)]
        studies.append({**{name: row[name] for name in ("info", "scale", "seconds")}, "findings": findings})
    return studies


def _stability(data: Row) -> list[Row]:
    studies = []
    for row in data["cases"]:
        info = row["info"]
        checks = [
            _check(
                one, "figure", ("what", "unit", "why", "subject", "status"), owner=one["whose"],
                **{"high" if one["sense"] == "at_most" else "low": one["bar"]},
            )
            for one in row["outcomes"]
        ]  # fmt: skip
        facts = {name: info[name] for name in ("input", "danger", "reference", "bar")}
        about = {"id": info["id"], "title": info["title"], "facts": facts}
        studies.append({"info": about, "seconds": row["seconds"], "findings": [*checks, *_of_kinds(row)]})
    return studies


def _speed(data: Row) -> list[Row]:
    studies = []
    for item in [*QUESTIONS, *sorted({row["item"] for row in data["measurements"]} - set(QUESTIONS))]:
        findings = [_measurement(row) for row in data["measurements"] if row["item"] == item]
        findings += [one for one in _of_kinds(data) if one["item"] == item]
        if findings or str(item) in data["seconds"]:
            info = {"id": str(item), "title": QUESTIONS.get(item, f"Question {item}")}
            studies.append({"info": info, "findings": findings, "seconds": data["seconds"].get(str(item), 0.0)})
    return studies


def _measurement(row: Row) -> Row:
    end = "low" if row["sense"] == "at_least" else "high"
    limit = {"low": None, "high": None, end: row["target"]}
    status = _status(row["value"], **limit)
    return _check(
        row, "value", ("id", "unit", "repeats"), what=row["title"], why=row["detail"], owner="machine", **limit,
        status="measured" if status == "pass" and row["target"] is None else status,
        spread=None if row["low"] is None or row["high"] is None else [row["low"], row["high"]],
    )  # fmt: skip
