"""The stored results, `gates/references.json`, which this code must reproduce on every processor, and how well their
order of methods predicts that of a complete run.
"""

from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta, field

from harness.gate.gates import Kind
from harness.gate.limits import SCHEMA, KindFacts, read_stored
from harness.records.json_record import Record, load_json, write_json
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

if TYPE_CHECKING:
    import pandas as pd

Numbers = Annotated[list[float], Meta(min_length=1)]


class Course(Record, frozen=True):
    losses: Numbers
    """The loss before each step."""
    renders: dict[str, Numbers]
    """Number of steps → red, green, blue and depth of some pixels of a test view."""


Courses = dict[str, dict[str, Course]]
"""Precision → start → its record."""


class Quotients(Record, frozen=True):
    facts: KindFacts
    gates: dict[str, Numbers]
    """Gate → one quotient per process."""


class References(Record, frozen=True):
    kinds: dict[Kind, KindFacts] = field(default_factory=dict)
    profiles: dict[str, object] = field(default_factory=dict)
    courses: Courses = field(default_factory=dict)
    cells: dict[str, dict[str, Numbers]] = field(default_factory=dict)
    """"scene/method/seed" → score → one value for each draw of the rounding, or a single one."""
    statistics: dict[str, Numbers] = field(default_factory=dict)
    """Comparison of the cells above → its difference and the ends of its intervals."""
    speed: dict[str, Quotients] = field(default_factory=dict)
    schema: int = SCHEMA


REFERENCES_FILE = "references.json"
RANK_FILE = "rank.json"
FEWEST = 4
"""The minimum number of pairs of a scene and a method for a correlation."""


def ranks(both: "pd.DataFrame") -> dict[str, float]:
    """Compare the PSNR at two scales, the columns `gate` and `run` by scene and method: rank correlations over all
    `pairs`, and the number of `compared` pairs of methods on the same scene that are in the same order.
    """
    values = [(scene, gate, run) for (scene, _), gate, run in both.itertuples()]
    same = [
        (first[1] - second[1]) * (first[2] - second[2]) > 0
        for first, second in combinations(values, 2)
        if first[0] == second[0]
    ]
    correlations = {name: round(float(both["gate"].corr(both["run"], name)), 3) for name in ("spearman", "kendall")}
    return {**correlations, "pairs": len(both), "compared": len(same), "same_order": sum(same)}


def publish(run: Path, folder: Path) -> str:
    """Write `rank.json` next to the limits and return a line on it; raises `InputError` for a run without scores."""
    import pandas as pd

    def means(rows: list[tuple[str, str, float]]) -> "pd.Series[float]":
        table = pd.DataFrame(rows, columns=["scene", "method", "psnr"]).astype({"psnr": float})
        return table.groupby(["scene", "method"])["psnr"].mean()

    try:
        summary = load_json(run / "summary.json" if run.is_dir() else run)
        done = [cell for cell in summary["cells"] if cell["status"] == "done"]
        of_run = means([(cell["scene"], cell["method"], cell["psnr"]) for cell in done])
        plan = {"profile": str(summary["profile"]), "commit": str(summary["provenance"]["commit"])}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"--rank {run}: no summary of a finished run ({error}); give a run's output folder") from error
    stored = read_stored(folder / REFERENCES_FILE, References).cells
    keys = [(key.split("/"), scores["psnr"][0]) for key, scores in stored.items()]
    of_gate = means([(scene, method, psnr) for (scene, method, _), psnr in keys])
    both = pd.DataFrame({"gate": of_gate, "run": of_run}).dropna()
    if len(both) < FEWEST:
        raise InputError(
            f"--rank {run}: {len(both)} pairs of a scene and a method in common, {FEWEST} are needed; a default run "
            "has them"
        )
    rows = [
        {"scene": scene, "method": method, "gate": round(gate, 3), "run": round(psnr, 3)}
        for (scene, method), gate, psnr in both.itertuples()
    ]
    record = {"schema": 1, "run": plan, **ranks(both), "scores": rows}
    write_json(folder / RANK_FILE, record)
    return f"{folder / RANK_FILE}: {rank_line(record)}"


def rank_line(record: JsonObject) -> str:
    run = record["run"]
    return (
        f"Against the {run['profile']} run of commit {run['commit']}: Spearman {record['spearman']:.2f}, Kendall "
        f"{record['kendall']:.2f} over {record['pairs']} pairs of a scene and a method; {record['same_order']} of "
        f"{record['compared']} pairs of methods stand in the same order on their scene."
    )
