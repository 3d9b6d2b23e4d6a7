"""The declared family of a run's headline: PSNR over all scenes, every pair at equal steps and at equal core seconds.

Holm's step-down procedure decides its signs: in at most 5 % of runs any of them is wrong. Its printed intervals are
Bonferroni's for the size of the family: in at most 5 % of runs any of them misses the truth. If Holm decides a sign
that Bonferroni's interval leaves open, the interval is cut at 0, so that sign and interval never contradict each other.
Such a cut adds a miss only where the sign is wrong.
Each sense, on these scenes and on scenes like these, is a family.
"""

from collections.abc import Sequence
from typing import Literal, cast

from msgspec.structs import replace

from harness.records.cells import Budget, Comparison, Estimate
from harness.records.metric_table import METRICS, PRIMARY
from harness.verdicts.estimates.multiplicity import holm
from harness.verdicts.statistics import decided

MARGIN = METRICS[PRIMARY].smallest_of_interest
SENSES: tuple[Literal["on_these_scenes", "scenes_like_these"], ...] = ("on_these_scenes", "scenes_like_these")


def headline_budgets(along: Sequence[Budget]) -> tuple[Budget, ...]:
    """Return the budgets of the headline: steps, and core seconds, or seconds if no core seconds were counted."""
    return ("steps", "core_seconds" if "core_seconds" in along else "seconds")


def is_headline(scene: str, metric: str, budget: Budget, along: Sequence[Budget]) -> bool:
    return (scene, metric) == ("all", PRIMARY) and budget in headline_budgets(along)


def by_holm(rows: list[Comparison], along: Sequence[Budget]) -> list[Comparison]:
    """Return all rows of a run, in which Holm's procedure has decided the headline's signs in each sense."""
    places = [place for place, row in enumerate(rows) if is_headline(row.scene, row.metric, row.budget, along)]
    rows = list(rows)
    for sense in SENSES:
        known = [cast("Estimate | None", getattr(rows[place], sense)) for place in places]
        adjusted = holm([each.p if each else None for each in known], len(places))
        for place, each, p in zip(places, known, adjusted, strict=True):
            if each is not None and p is not None:
                row, sure = rows[place], decided(each, p, rows[place].difference or 0.0, MARGIN)
                changes: dict[str, object] = {sense: sure}
                if sense == "scenes_like_these" or row.scenes_like_these is None:
                    changes |= {"simultaneous": sure.simultaneous, "verdict": sure.verdict}
                rows[place] = replace(row, **changes)
    return rows
