"""A published run and the replicates of its plan on other instruction sets: only words that all share are printed."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from harness.records.former.four_words import NO_INTERVAL
from harness.records.json_record import as_promised
from harness.records.verdict import Verdict, common
from reports.claims.headline import rising, title_of
from reports.data.outcome import Outcome, clauses
from tools.published.published_cells import Run

BASELINE, CONTROL, FAVOURITE, REPAIRED = "nerf", "nerf_matched", "qnerf", "qnerf_repaired"
FORMER_HEADLINE = re.compile(r"([+-][\d.]+) dB \((\w+)\)")
"""A difference with its word, in the sentences that an earlier `compare` wrote."""


def row(run: Run, scene: str, method: str, against: str, budget: str = "steps") -> Run | None:
    """Return the comparison of two methods by PSNR; None if there is no difference."""
    keys = {"scene": scene, "method": method, "against": against, "metric": "psnr", "budget": budget}
    rows = (comparison for comparison in run["comparisons"] if keys.items() <= comparison.items())
    return next((comparison for comparison in rows if comparison["difference"] is not None), None)


def verdict_in(known: Run) -> Verdict:
    return as_promised(known["verdict"], Verdict)


@dataclass(frozen=True)
class Replicated:
    """A difference in PSNR over all scenes at equal steps, in the published run and then in each replicate."""

    differences: tuple[float, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def repeated(self) -> bool:
        return common(self.verdicts) == self.verdicts[0]


def replicated(run: Run, replicates: Run) -> dict[tuple[str, str], Replicated]:
    """Map a pair of methods → its difference in the published run, counted once, and in any replicates."""
    by_pair = {}
    for first, second, differences, verdicts in _of_replicates(replicates):
        if duel := row(run, "all", first, second):
            others = [pair for pair in zip(differences, verdicts, strict=True) if pair[0] != duel["difference"]]
            values, words = zip((duel["difference"], verdict_in(duel)), *others, strict=True)
            by_pair[first, second] = Replicated(values, words)
    return by_pair


def _of_replicates(replicates: Run) -> Iterator[tuple[str, str, list[float], list[Verdict]]]:
    """Yield method, rival, differences and verdicts; an earlier version wrote them as a sentence."""
    for pair in replicates.get("over_all", ()):
        yield pair["method"], pair["against"], pair["differences"], as_promised(pair["verdicts"], list[Verdict])
    for line in replicates.get("headline", ()) if "over_all" not in replicates else ():
        names, words = line.split(": ", 1)
        both = FORMER_HEADLINE.findall(words)
        first, second = names.split(" − ")
        yield first, second, [float(value) for value, _ in both], [NO_INTERVAL[word] for _, word in both]


def answer(run: Run, replicates: Run) -> str:
    of_pairs = replicated(run, replicates)

    def outcome_of(first: str, second: str) -> Outcome | None:
        duel = row(run, "all", first, second)
        if duel is None:
            return None
        runs = of_pairs.get((first, second)) or Replicated((duel["difference"],), (verdict_in(duel),))
        values = (duel["difference"],) if runs.repeated else runs.differences
        scenes = (row(run, scene["scene"], first, second) for scene in run["scenes"])
        by_scene = tuple(known["difference"] for known in scenes if known)
        return Outcome(first, second, values, common(runs.verdicts), by_scene)

    title = title_of(outcome_of(FAVOURITE, BASELINE), outcome_of(FAVOURITE, CONTROL), CONTROL)
    if not title:
        return str(run["headline"])
    repaired = [outcome for rival in (BASELINE, CONTROL) if (outcome := outcome_of(REPAIRED, rival))]
    title = "; ".join(filter(None, [title, clauses(repaired)]))
    gains = {gained["method"]: gained["gain"] for gained in run.get("last_doubling", [])}
    more = rising(gains.get(method) for method in (FAVOURITE, BASELINE))
    return "; ".join(filter(None, [f"{title[0].upper()}{title[1:]} (at equal steps, on scenes like these)", more]))
