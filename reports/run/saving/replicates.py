"""A published run and the replicates of its plan on other instruction sets: only words that all repeat are printed."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from harness.records.former.four_words import NO_INTERVAL
from harness.records.json_record import as_promised
from harness.records.verdict import Verdict, common
from reports.claims.headline import rising, title_of
from reports.data.outcome import Outcome, clauses
from reports.run.saving.published_cells import Run

BASELINE, CONTROL, FAVOURITE, REPAIRED = "nerf", "nerf_matched", "qnerf", "qnerf_repaired"
"""The methods that README and docs speak of."""
FORMER_HEADLINE = re.compile(r"([+-][\d.]+) dB \((\w+)\)")
"""A difference with its word, as `compare` wrote them in a sentence alone."""


def row(run: Run, scene: str, method: str, against: str, budget: str = "steps") -> Run | None:
    """Return the comparison of two methods by PSNR; None if there is no difference."""
    asked = {"scene": scene, "method": method, "against": against, "metric": "psnr", "budget": budget}
    rows = (comparison for comparison in run["comparisons"] if asked.items() <= comparison.items())
    return next((effect for effect in rows if effect["difference"] is not None), None)


def verdict_in(known: Run) -> Verdict:
    return as_promised(known["verdict"], Verdict)


@dataclass(frozen=True)
class Replicated:
    """A published difference in PSNR over all scenes at equal steps, and the same in each replicate of its plan."""

    differences: tuple[float, ...]
    verdicts: tuple[Verdict, ...]

    @property
    def repeated(self) -> bool:
        """Return whether all replicates share what the verdict of the published run says."""
        return common(self.verdicts) == self.verdicts[0]


def replicated(run: Run, replicates: Run) -> dict[tuple[str, str], Replicated]:
    """Map a pair of methods → what the published run and its replicates say of it, where there are replicates. The
    published run may be among the runs that were compared; it is counted once.
    """
    found = {}
    for first, second, differences, verdicts in _of_replicates(replicates):
        if duel := row(run, "all", first, second):
            others = [pair for pair in zip(differences, verdicts, strict=True) if pair[0] != duel["difference"]]
            values, words = zip((duel["difference"], verdict_in(duel)), *others, strict=True)
            found[first, second] = Replicated(values, words)
    return found


def _of_replicates(replicates: Run) -> Iterator[tuple[str, str, list[float], list[Verdict]]]:
    """Yield method, rival, differences and verdicts; an earlier version wrote them as a sentence."""
    for found in replicates.get("over_all", ()):
        verdicts = as_promised(found["verdicts"], list[Verdict])
        yield found["method"], found["against"], found["differences"], verdicts
    for line in replicates.get("headline", ()) if "over_all" not in replicates else ():
        pair, told = line.split(": ", 1)
        both = FORMER_HEADLINE.findall(told)
        first, second = pair.split(" − ")
        yield first, second, [float(value) for value, _ in both], [NO_INTERVAL[word] for _, word in both]


def answer(run: Run, replicates: Run) -> str:
    of_pairs = replicated(run, replicates)

    def found(first: str, second: str) -> Outcome | None:
        duel = row(run, "all", first, second)
        if duel is None:
            return None
        runs = of_pairs.get((first, second)) or Replicated((duel["difference"],), (verdict_in(duel),))
        values = (duel["difference"],) if runs.repeated else runs.differences
        scenes = (row(run, scene["scene"], first, second) for scene in run["scenes"])
        return Outcome(first, second, values, common(runs.verdicts), tuple(one["difference"] for one in scenes if one))

    title = title_of(found(FAVOURITE, BASELINE), found(FAVOURITE, CONTROL), CONTROL)
    if not title:
        return str(run["headline"])
    repaired = [outcome for rival in (BASELINE, CONTROL) if (outcome := found(REPAIRED, rival))]
    title = "; ".join(filter(None, [title, clauses(repaired)]))
    gains = {gained["method"]: gained["gain"] for gained in run.get("last_doubling", [])}
    more = rising(gains.get(method) for method in (FAVOURITE, BASELINE))
    return "; ".join(filter(None, [f"{title[0].upper()}{title[1:]} (at equal steps, on scenes like these)", more]))
