"""A published run and the replicates of its plan on other instruction sets: only words that all share are printed.

python -m tools.published.replicates SUMMARY... prints the file of replicates from `summary.json` of runs.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from harness.records.json_record import as_promised
from harness.records.metric_table import PRIMARY
from harness.records.verdict import Verdict, common
from reports.claims.headline import rising, title_of
from reports.data.outcome import Outcome
from tools.published.published_cells import Run

BASELINE, CONTROL, FAVOURITE, REPAIRED = "nerf", "nerf_matched", "qnerf", "qnerf_repaired"
ORIGIN = ("commit", "processor", "instruction_set")
KEPT = ("method", "against", "budget", "difference", "on_these_scenes", "scenes_like_these")


def row(run: Run, scene: str, method: str, against: str, budget: str = "steps") -> Run | None:
    """Return the comparison of two methods by PSNR; None if there is no difference."""
    keys = {"scene": scene, "method": method, "against": against, "metric": PRIMARY, "budget": budget}
    rows = (comparison for comparison in run["comparisons"] if keys.items() <= comparison.items())
    return next((comparison for comparison in rows if comparison["difference"] is not None), None)


def verdict_in(known: Run) -> Verdict:
    return as_promised(known["verdict"], Verdict)


@dataclass(frozen=True)
class Replicated:
    """A difference in PSNR over all scenes, in the published run and then in each replicate."""

    differences: tuple[float, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def repeated(self) -> bool:
        return common(self.verdicts) == self.verdicts[0]


def replicated(duel: Run, sense: str, replicates: Run) -> Replicated:
    """Return a comparison of the published run, counted once, and those of the same pair and budget in `replicates`."""
    same = {name: duel[name] for name in ("method", "against", "budget")}.items()
    others = [
        other
        for run in replicates.get("runs", ())
        for other in run["comparisons"]
        if same <= other.items() and other[sense] and other["difference"] != duel["difference"]
    ]
    differences, verdicts = zip(
        *((each["difference"], verdict_in(each[sense])) for each in (duel, *others)), strict=True
    )
    return Replicated(differences, verdicts)


def answer(run: Run, replicates: Run) -> str:
    def outcome_of(first: str, second: str) -> Outcome | None:
        duel = row(run, "all", first, second)
        if duel is None:
            return None
        runs = replicated(duel, "scenes_like_these", replicates)
        values = (duel["difference"],) if runs.repeated else runs.differences
        scenes = (row(run, scene["scene"], first, second) for scene in run["scenes"])
        by_scene = tuple(known["difference"] for known in scenes if known)
        return Outcome(first, second, values, common(runs.verdicts), by_scene)

    pairs = ((method, rival) for method in (FAVOURITE, REPAIRED) for rival in (BASELINE, CONTROL))
    judged = [outcome for pair in pairs if (outcome := outcome_of(*pair))]
    gains = {gained["method"]: gained["gain"] for gained in run["last_doubling"]}
    more = rising(gains.get(method) for method in (FAVOURITE, BASELINE))
    if not any((each.method, each.against) == (FAVOURITE, BASELINE) for each in judged):
        return str(run["headline"])
    return title_of(judged, FAVOURITE, BASELINE, CONTROL, "at equal steps, on scenes like these", [more])


def replicate(run: Run) -> Run:
    """Return what a replicate states: its origin, and the comparisons of PSNR over all scenes."""
    over_all = {"scene": "all", "metric": PRIMARY}.items()
    rows = [{name: each[name] for name in KEPT} for each in run["comparisons"] if over_all <= each.items()]
    return {name: run["provenance"][name] for name in ORIGIN} | {"comparisons": rows}


if __name__ == "__main__":
    summaries = (json.loads(Path(name).read_text(encoding="utf-8")) for name in sys.argv[1:])
    sys.stdout.write(json.dumps({"runs": [replicate(summary) for summary in summaries]}, indent=1) + "\n")
