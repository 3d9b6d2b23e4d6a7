"""By how much cells of short trainings are better than the stored ones, and the limits of that figure.

Equal seeds draw equal numbers. So a change of the program that draws the same numbers is measured against rounding,
whose scatter is known: stored cells were trained several times from weights that differ in their last bit, and another
processor acts like another draw. If the first steps have changed too, figures are judged by their own scatter or that
of seeds (`harness.gate.quality.scatter`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from harness.gate.gates import (
    DRAWS,
    FALSE_ALARMS,
    GATE_SEEDS,
    HEADLINES,
    LOSS_OF_ONE,
    LOSS_OVER_ALL,
    OTHER_SEEDS,
    SCORES,
    TRAINED_METHODS,
    TRAINED_SCENES,
    Gate,
    Scatter,
    gates,
)
from harness.gate.limits import Limit, judge
from harness.gate.quality import scatter
from harness.gate.quality.scatter import Error
from harness.gate.references import References
from harness.records.metric_table import METRICS
from harness.records.study import Check
from harness.verdicts.statistics import POWER

Scores = dict[str, dict[str, float | None]]
"""scene/method/seed → score → value."""
DIGITS = 7
"""The significant digits of a stored score."""
STATISTICS = "worse.headline.statistics"
FIGURES = {gate.name: gate for gate in gates() if gate.kind == "worse" and gate.name != STATISTICS}
SINGLE = tuple(gate for name, gate in FIGURES.items() if name.count(".") == 3)
BOTH_WAYS = tuple(gate for name, gate in FIGURES.items() if name.startswith("worse.headline."))
BECAUSE: dict[Scatter, str] = {
    "rounding": "The first steps are the stored ones",
    "change": "The first steps are others, with the same random numbers",
    "seeds": "The program draws other random numbers",
}
JUDGED: dict[Scatter, str] = {
    "rounding": "judged with the scatter of rounding",
    "change": "judged with the scatter of the differences",
    "seeds": "judged with the seeds' spread",
}


def score_and_weights(gate: Gate) -> tuple[str, np.ndarray]:
    """Return the score of a gate's figure and the weights of its cells [scenes, methods]."""
    _, of, *scenes, score = gate.name.split(".")
    weights = np.zeros((len(TRAINED_SCENES), len(TRAINED_METHODS)))
    rows = [TRAINED_SCENES.index(scene) for scene in scenes] or list(range(len(TRAINED_SCENES)))
    if of == "headline":
        method, against = next(pair for pair in HEADLINES if "_".join(pair) == score)
        score, parts = "psnr", {method: 1.0, against: -1.0}
    else:
        methods = TRAINED_METHODS if of == "all" else (of,)
        parts = {method: 1.0 / len(methods) for method in methods}
    for method, part in parts.items():
        weights[rows, TRAINED_METHODS.index(method)] = part / len(rows)
    return score, weights


def table(scores: Mapping[str, Mapping[str, float | None]], score: str, seeds: Sequence[int]) -> np.ndarray:
    """Return a score [scenes, methods, seeds], with a sign so that larger is better; NaN for a missing one."""
    sign = 1.0 if METRICS[score].higher_is_better else -1.0
    keys = [[[f"{scene}/{method}/{seed}" for seed in seeds] for method in TRAINED_METHODS] for scene in TRAINED_SCENES]
    values = [[[scores.get(key, {}).get(score) for key in row] for row in rows] for rows in keys]
    return sign * np.array(values, dtype=np.float64)


@dataclass(frozen=True)
class StoredScore:
    """The stored cells of one score, with a sign so that larger is better."""

    draws: np.ndarray
    """[scenes, methods, seeds of the gate, draws of the rounding]."""
    others: np.ndarray
    """[scenes, methods, other seeds]."""

    @staticmethod
    def of(stored: References, score: str) -> "StoredScore":
        several = [
            {key: {score: values[score][draw]} for key, values in stored.cells.items() if draw < len(values[score])}
            for draw in range(DRAWS)
        ]
        draws = np.stack([table(some, score, GATE_SEEDS) for some in several], axis=-1)
        return StoredScore(draws, table(several[0], score, OTHER_SEEDS))

    @cached_property
    def mean(self) -> np.ndarray:
        return np.asarray(self.draws.mean(axis=-1))

    @cached_property
    def every_seed(self) -> np.ndarray:
        return np.concatenate([self.mean, self.others], axis=-1)

    def has_draw(self, better_by: np.ndarray, chosen: np.ndarray) -> bool:
        """Return whether the chosen cells [scenes, methods] equal one of the draws in all stored digits."""
        new = (better_by + self.mean)[..., None]
        same = np.isclose(new, self.draws, rtol=10.0 ** (1 - DIGITS), atol=0.0)
        return bool(same[chosen].all(axis=(0, 1)).any())


@dataclass(frozen=True)
class Judge:
    stored: dict[str, StoredScore]
    better_by: dict[str, np.ndarray]
    """Score → new − stored [scenes, methods, seeds], NaN for an untrained cell."""
    scatter: Scatter

    @staticmethod
    def of(references: References, new: Scores, has_changed: bool) -> "Judge":
        stored = {score: StoredScore.of(references, score) for score in SCORES}
        better_by = {score: table(new, score, GATE_SEEDS) - stored[score].mean for score in SCORES}
        if not has_changed:
            return Judge(stored, better_by, "rounding")
        is_alike = scatter.alike(better_by["psnr"], stored["psnr"].every_seed) < scatter.ALIKE
        return Judge(stored, better_by, "change" if is_alike else "seeds")

    def error(self, gate: Gate) -> Error:
        """Return the standard error of a gate's figure if the true change is 0."""
        score, weights = score_and_weights(gate)
        stored = self.stored[score]
        match self.scatter:
            case "rounding":
                return scatter.rounding_error(weights, stored.draws)
            case "change":
                return scatter.change_error(weights, stored.draws, self.better_by[score])
            case "seeds":
                return scatter.seeds_error(weights, stored.every_seed, len(GATE_SEEDS))

    @property
    def alarms(self) -> float:
        """Return the share of harmless changes whose figure lies beyond one limit of one gate."""
        return FALSE_ALARMS[self.scatter] / (len(FIGURES) + len(BOTH_WAYS))

    def limit(self, gate: Gate) -> Limit:
        error, weights = self.error(gate), score_and_weights(gate)[1]
        high = error.limit(self.alarms)
        cells = int(np.count_nonzero(weights)) * len(GATE_SEEDS)
        return Limit(-high, high if gate in BOTH_WAYS else None, 0.0, error.size, cells, error.detects(self.alarms))

    def check(self, gate: Gate) -> Check:
        """Check by how much the cells are better than the stored ones; below 0 they are worse."""
        score, weights = score_and_weights(gate)
        limit, chosen = self.limit(gate), weights != 0.0
        missing = [
            f"{TRAINED_SCENES[scene]}/{TRAINED_METHODS[method]}/{GATE_SEEDS[seed]}"
            for scene, method, seed in np.argwhere(~np.isfinite(self.better_by[score]) & chosen[..., None])
        ]
        if missing:
            return judge(gate, [], limit, f"no {score} of {', '.join(missing)}")
        if self.stored[score].has_draw(self.better_by[score], chosen):
            return judge(gate, [0.0], limit, "unchanged")
        figure = scatter.figure(weights, np.nan_to_num(self.better_by[score]))
        unit = gate.unit and f" {gate.unit}"
        is_worse = judge(gate, [figure], limit).is_broken
        verdict = "worse" if is_worse else "not worse"
        change = f"changed, {figure:+.3f} ± {2 * (limit.spread or 0.0):.3f}{unit}"
        return judge(gate, [figure], limit, f"{change}: {verdict}, {JUDGED[self.scatter]}")

    def sentence(self) -> str:
        errors, alarms = [self.error(gate) for gate in SINGLE], self.alarms
        sizes = [error.detects(alarms) for error in errors]
        chances = [error.power(LOSS_OF_ONE, alarms) for error in errors]
        over_all = self.error(FIGURES["worse.all.psnr"])
        return (
            f"{BECAUSE[self.scatter]}; {JUDGED[self.scatter]}: a loss of {over_all.detects(alarms):.2f} dB over all "
            f"cells would be found in {POWER:.0%}, of {min(sizes):.2f} to {max(sizes):.2f} dB by one method on one "
            f"scene; {LOSS_OVER_ALL} dB over all in {over_all.power(LOSS_OVER_ALL, alarms):.0%}, {LOSS_OF_ONE} dB by "
            f"one in {np.mean(chances):.0%} (minimum {min(chances):.0%}). One of {len(FIGURES)} gates fails in at most "
            f"{FALSE_ALARMS[self.scatter]:.0%} of harmless changes"
        )
