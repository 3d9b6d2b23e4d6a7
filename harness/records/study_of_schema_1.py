"""Records of the studies as versions before one shape for all shelves wrote them, brought into that shape.

The three shelves had a schema 1 each: studies with lists of their findings by kind; cases with outcomes against one
bar; and measurements by the number of their question.
"""

from typing import Any

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


def converted(shelf: str, data: dict[str, Any]) -> dict[str, Any]:
    """Return the record of a shelf as plain data of schema 2; raises what a dictionary raises if something is
    missing.
    """
    made = {"evidence": _evidence, "stability": _stability, "speed": _speed}[shelf](data)
    common = {name: data[name] for name in ("provenance", "settings")}
    return {**common, "shelf": shelf, "schema": 2, "finished": data.get("finished", True), "studies": made}


def _of_kinds(row: dict[str, Any]) -> list[dict[str, Any]]:
    return [{"type": kind, **one} for name, kind in KINDS.items() for one in row.get(name, [])]


def _evidence(data: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "info": row["info"],
            "scale": row["scale"],
            "seconds": row["seconds"],
            "findings": [
                *({"type": "answer", "text": text} for text in row["findings"]),
                *map(_check, row["checks"]),
                *_of_kinds(row),
            ],
        }
        for row in data["studies"]
    ]


def _check(row: dict[str, Any]) -> dict[str, Any]:
    value, low, high = row["figure"], row["low"], row["high"]
    holds = value is not None and (low is None or value >= low) and (high is None or value <= high)
    return {
        "type": "check",
        **{name: row[name] for name in ("what", "low", "high", "unit", "why")},
        "value": value,
        "status": "pass" if holds else "fail",
    }


def _stability(data: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "info": {
                "id": row["info"]["id"],
                "title": row["info"]["title"],
                "facts": {name: row["info"][name] for name in ("input", "danger", "reference", "bar")},
            },
            "seconds": row["seconds"],
            "findings": [*map(_outcome, row["outcomes"]), *_of_kinds(row)],
        }
        for row in data["cases"]
    ]


def _outcome(row: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "check",
        **{name: row[name] for name in ("what", "unit", "why", "subject", "status")},
        "value": row["figure"],
        "owner": row["whose"],
        "high" if row["sense"] == "at_most" else "low": row["bar"],
    }


def _speed(data: dict[str, Any]) -> list[dict[str, Any]]:
    found = []
    items = [*QUESTIONS, *sorted({row["item"] for row in data["measurements"]} - set(QUESTIONS))]
    for item in items:
        findings = [_measurement(row) for row in data["measurements"] if row["item"] == item]
        findings += [one for one in _of_kinds(data) if one["item"] == item]
        if findings or str(item) in data["seconds"]:
            info = {"id": str(item), "title": QUESTIONS.get(item, f"Question {item}")}
            found.append({"info": info, "findings": findings, "seconds": data["seconds"].get(str(item), 0.0)})
    return found


def _measurement(row: dict[str, Any]) -> dict[str, Any]:
    value, target = row["value"], row["target"]
    at_least = row["sense"] == "at_least"
    if value is None:
        status = "fail"
    elif target is None:
        status = "measured"
    else:
        status = "pass" if (value >= target if at_least else value <= target) else "fail"
    return {
        "type": "check",
        "id": row["id"],
        "what": row["title"],
        "value": value,
        "low" if at_least else "high": target,
        "unit": row["unit"],
        "why": row["detail"],
        "owner": "machine",
        "status": status,
        "spread": None if row["low"] is None or row["high"] is None else [row["low"], row["high"]],
        "repeats": row["repeats"],
    }
