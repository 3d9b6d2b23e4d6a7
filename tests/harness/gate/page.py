"""The tables of `docs/gate-your-ci.md`, from what was measured: `python -m tests.harness.gate.page` writes them."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from harness.gate import early, gate_speed, worse
from harness.gate.gates import SLOWER_FOUND
from harness.gate.references import References, rank_line, read_references

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "gate-your-ci.md"
CLASSES = ("avx2", "avx512")


def tables() -> dict[str, str]:
    """Name of a marker → what stands between it and its end."""
    mutations = json.loads((ROOT / "gates" / "mutations.json").read_text(encoding="utf-8"))
    rank = json.loads((ROOT / "gates" / "rank.json").read_text(encoding="utf-8"))
    stored = [read_references(ROOT / "gates" / "classes", name) for name in CLASSES]
    return {"spread": spread_table(stored), "mutations": mutation_table(mutations["rows"]), "rank": rank_line(rank)}


def spread_table(stored: list[References]) -> str:
    """What rounding makes, what is allowed, and what is found."""
    rows: list[tuple[str, list[str]]] = []
    for precision in early.PRECISIONS:
        moved = [f"{max(references.reordered[precision].values()):.0e}" for references in stored]
        rows.append((f"first steps in {precision} precision: sums in another order move them by", moved))
        rows.append(
            ("… a gate fails beyond", [f"{early.tolerance(precision, references):.0e}" for references in stored])
        )
    limits = [worse.loss_limit("all", "psnr", references) for references in stored]
    what = f"mean PSNR over {limits[0].measured} cells: standard error by rounding alone, dB"
    rows.append((what, [f"{limit.spread:.4f}" for limit in limits]))
    what = "… a loss that is found in nine of ten draws of the rounding, dB"
    rows.append((what, [f"{limit.detects:.2f}" for limit in limits]))
    apart = f"{between_classes(*stored):.3f}"
    rows.append(("… cells of the two classes differ by, dB RMS", [apart] * len(stored)))
    slow = [
        max(gate_speed.limit_of(ratios).detects or 0.0 for ratios in references.speed.values()) for references in stored
    ]
    what = f"slower by a factor that is found in nine of ten runs (at most {SLOWER_FOUND})"
    rows.append((what, [f"{factor:.2f}" for factor in slow]))
    head = ["| | " + " | ".join(CLASSES) + " |", "|---|" + "---|" * len(CLASSES)]
    return "\n".join([*head, *(f"| {what} | {' | '.join(values)} |" for what, values in rows)])


def between_classes(first: References, second: References) -> float:
    """By how much the same cells differ, by the order of sums alone."""
    differences = [
        np.mean(first.cells[key]["psnr"]) - np.mean(second.cells[key]["psnr"])
        for key in first.cells
        if key in second.cells
    ]
    return float(np.sqrt(np.mean(np.square(differences))))


def mutation_table(rows: list[dict[str, Any]]) -> str:
    """Every mutation with the gates that see it."""
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
    """How many gates of each kind; a dash where there is none."""
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
