"""The tables of `docs/gate-your-ci.md`, which `python -m tests.harness.gate.page` writes from measurements."""

import json
import re
from typing import Any

import numpy as np

from harness.gate import gate_speed
from harness.gate.gates import FALSE_ALARMS, LOSS_OF_ONE, LOSS_OVER_ALL, SLOWER_FOUND, Scatter
from harness.gate.limits import KindFacts, LimitsFile, read_stored
from harness.gate.quality.losses import FIGURES, SINGLE
from harness.gate.references import REFERENCES_FILE, References
from tests.harness.gate.gate_runs import GATES, usual_judge

PAGE = GATES.parent / "docs" / "gate-your-ci.md"
COLUMNS: dict[Scatter, str] = {"rounding": "same random numbers", "seeds": "other random numbers"}


def tables() -> dict[str, str]:
    """Return name of a marker → the text between it and its end."""
    mutations = json.loads((GATES / "mutations.json").read_text(encoding="utf-8"))
    stored = read_stored(GATES / REFERENCES_FILE, References)
    limits = read_stored(GATES / "limits.json", LimitsFile)
    return {
        "spread": spread_table(stored),
        "renewal": renewal(stored, limits),
        "mutations": mutation_table(mutations["rows"]),
    }


def spread_table(stored: References) -> str:
    rows: dict[str, list[str]] = {}
    for judge in (usual_judge(stored, scatter) for scatter in COLUMNS):
        over_all, alarms = judge.error(FIGURES["worse.all.psnr"]), judge.alarms
        ones = [judge.error(gate) for gate in SINGLE]
        chances, sizes = [e.power(LOSS_OF_ONE, alarms) for e in ones], [e.detects(alarms) for e in ones]
        limit = judge.limit(FIGURES["worse.all.psnr"])
        column = {
            f"mean PSNR over {limit.measured} cells: standard error, dB": f"{over_all.size:.4f}",
            "… `worse.all.psnr` fails below, dB": f"{limit.low:.3f}",
            "… a loss that is found in 80 %, dB": f"{over_all.detects(alarms):.3f}",
            f"… a loss of {LOSS_OVER_ALL} dB is found in": f"{over_all.power(LOSS_OVER_ALL, alarms):.0%}",
            "one method on one scene: a loss that is found in 80 %, dB": f"{min(sizes):.2f} to {max(sizes):.2f}",
            f"… a loss of {LOSS_OF_ONE} dB is found in, mean and least": f"{np.mean(chances):.0%}, {min(chances):.0%}",
            f"one of {len(FIGURES)} gates fails, of harmless changes, in at most": f"{FALSE_ALARMS[judge.scatter]:.0%}",
        }
        for what, value in column.items():
            rows.setdefault(what, []).append(value)
    head = ["| | " + " | ".join(COLUMNS.values()) + " |", "|---|" + "---|" * len(COLUMNS)]
    return "\n".join([*head, *(f"| {what} | {' | '.join(row)} |" for what, row in rows.items()), "", slower(stored)])


def renewal(stored: References, limits: LimitsFile) -> str:
    facts: dict[str, KindFacts] = dict(stored.kinds.items())
    facts |= {f"speed of {name}": speed.facts for name, speed in stored.speed.items()}
    facts |= dict(limits.kinds.items())
    rows = [f"| {kind} | {some.seconds / 60:.0f} min | {some.provenance['commit']} |" for kind, some in facts.items()]
    return "\n".join(["| | took | commit |", "|---|---|---|", *rows])


def slower(stored: References) -> str:
    found = {
        name: max(gate_speed.limit_of(ratios).detects or 0.0 for ratios in speed.gates.values())
        for name, speed in stored.speed.items()
    }
    words = ", ".join(f"{factor:.2f} times as long on {name}" for name, factor in found.items())
    return f"Speed: found in nine of ten runs is what takes {words} (at most {SLOWER_FOUND})."


def mutation_table(rows: list[dict[str, Any]]) -> str:
    seen = sum(bool(row["found_by"]) for row in rows)
    lines = [
        f"{seen} of {len(rows)} are found:",
        "",
        "| part | constant | change | first steps move by | seen by |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        deviation = f"{row['deviation']:.0e}"
        lines.append(f"| {row['part']} | {row['constant']} | {row['to']} | {deviation} | {seen_by(row['found_by'])} |")
    return "\n".join(lines)


def seen_by(names: list[str]) -> str:
    """Return the number of gates of each kind; a dash without a gate."""
    counts = {kind: sum(name.startswith(kind) for name in names) for kind in ("changed.double", "changed.single")}
    words = [f"{many} × `{kind}`" for kind, many in counts.items() if many]
    return ", ".join([*words, *(["`changed.settings`"] if "changed.settings" in names else [])]) or "—"


def between(name: str) -> re.Pattern[str]:
    return re.compile(f"(<!-- {name} -->\n)(?:(?!<!-- end -->).)*(<!-- end -->)", re.DOTALL)


def main() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name, table in tables().items():
        text = between(name).sub(lambda match, table=table: f"{match[1]}{table}\n{match[2]}", text)  # type: ignore[misc]
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
