"""How often the intervals hold the truth, and how often an effect is found: simulated studies whose truth is known.

The functions under test are those that judge a run. Every study is a table of scenes and seeds, with an effect that
differs from scene to scene and noise that differs from seed to seed.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from harness.records.metric_table import METRICS, PRIMARY
from harness.records.study import Check, Series, Table, check
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found
from harness.verdicts import nested
from harness.verdicts.statistics import half_widths

SCENES = (4, 8, 16)
SEEDS = (3, 5, 10)
SCENE_SD = (0.0, 0.2, 0.6)
"""dB: how much an effect differs from scene to scene. The gains that the paper prints differ by 0.2."""
PAIR_SD = 0.248
"""The standard deviation in dB of a paired difference over seeds, nerf_matched minus nerf in the default run."""
PUBLISHED = 0.174
"""dB: how much that difference differs from scene to scene in the default run."""
DEFAULT = (8, 3)
"""Scenes and seeds of the default run."""
STUDIES = 4000
"""The studies simulated at each point of the grid: they determine a coverage of 95 % to ± 0.34 %."""
COVERAGE = (0.93, 0.98)
POWER = {0.2: 0.55, 0.3: 0.88}
"""dB: effect → the least share of studies of the default size that must find it."""
EFFECTS = tuple(round(0.05 * step, 2) for step in range(13))
COLLAPSE = 1 / 50
"""The share of the runs that show nothing but background."""
UNSEEN_LOSS = 3.0
"""The cost in dB of a collapse that goes unnoticed. One that is noticed has no score that is judged."""
ONE_SCENE, HERE, ELSEWHERE = "on one scene", "on these scenes", "on scenes like these"
ASKED_WRONGLY = "on these scenes, asked about others"


def _normal(generator: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return PAIR_SD * generator.standard_normal(shape)


def _unseen(generator: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Return noise in which collapses go unnoticed, centred so that the true effect is 0 again."""
    lost = generator.random(shape) < COLLAPSE
    return _normal(generator, shape) - UNSEEN_LOSS * (lost - COLLAPSE)


Noise = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]
CHECKED: dict[str, Noise] = {
    "normal": _normal,
    "t₄": lambda generator, shape: PAIR_SD * generator.standard_t(4, shape) / math.sqrt(2),
    "1 in 50 collapses and is counted apart": lambda generator, shape: np.where(
        generator.random(shape) < COLLAPSE, np.nan, _normal(generator, shape)
    ),
}
NOISE = CHECKED | {f"1 in 50 loses {UNSEEN_LOSS:g} dB unseen": _unseen}


@dataclass(frozen=True)
class DesignPoint:
    """One kind of study, and the results of many of that kind."""

    noise: str
    scenes: int
    seeds: int
    scene_sd: float
    coverage: dict[str, float]
    """Interval → share of studies in which it contains the truth."""
    power: dict[str, dict[float, float]]
    """Interval → effect in dB → share of studies that call it better."""

    def __str__(self) -> str:
        return f"{self.noise}, {self.scenes} scenes, {self.seeds} seeds, {self.scene_sd:g} dB from scene to scene"


def calibration(context: EvidenceContext) -> Iterator[Found]:
    """Yield the coverage over the complete grid and the power at the noise of the default run."""
    count = 1000 if context.quick else STUDIES
    grid = [simulated(*point, count) for point in product(NOISE, SCENES, SEEDS, SCENE_SD)]
    default = simulated("normal", *DEFAULT, PUBLISHED, count, EFFECTS)
    yield from _sentences(grid, default, count)
    yield from checks(grid, default, count)
    for kind, power in default.power.items():
        shares = np.array(list(power.values()))
        half = 2 * np.sqrt(shares * (1 - shares) / count)
        yield Series(
            "how often an effect is called better, at the noise of the default run", 0, kind,
            "true effect (dB)", "share of simulated studies", list(power), shares.tolist(),
            np.maximum(0.0, shares - half).tolist(), np.minimum(1.0, shares + half).tolist(), log_x=False, log_y=False,
        )  # fmt: skip
    yield _table([default, *grid])


def simulated(
    noise: str, scenes: int, seeds: int, scene_sd: float, count: int, effects: tuple[float, ...] = tuple(POWER)
) -> DesignPoint:
    """Simulate `count` studies. Power is that of the same studies with the effect added to every difference: the share
    whose interval is above 0, and not all of it within the range of no interest.
    """
    generator = np.random.default_rng([20260108, list(NOISE).index(noise), scenes, seeds, round(1000 * scene_sd)])
    truth = scene_sd * generator.standard_normal((count, scenes))
    values = truth[..., None] + NOISE[noise](generator, (count, scenes, seeds))
    left = np.where(np.isfinite(values).any(axis=-1), truth, np.nan)
    here, none = nested.on_these_scenes(values), np.zeros(count)
    tried = {
        HERE: (here, np.nanmean(left, axis=-1)),
        ELSEWHERE: (nested.scenes_like_these(values), none),
        ASKED_WRONGLY: (here, none),
        ONE_SCENE: (nested.on_each_scene(values), left),
    }
    coverage, power = {}, {}
    for kind, (estimated, true) in tried.items():
        half, mean = half_widths(estimated), estimated.mean
        known = np.isfinite(half) & np.isfinite(true)
        coverage[kind] = float((np.abs(mean - true) <= half)[known].mean())
        if kind in (HERE, ELSEWHERE):
            of_interest = METRICS[PRIMARY].smallest_of_interest
            power[kind] = {
                effect: float(((mean + effect - half > 0) & (mean + effect + half >= of_interest)).mean())
                for effect in effects
            }
    return DesignPoint(noise, scenes, seeds, scene_sd, coverage, power)


def checks(grid: list[DesignPoint], default: DesignPoint, count: int) -> Iterator[Check]:
    """Yield checks of each kind of interval from below and from above, and of the power that was promised."""
    judged = [point for point in grid if point.noise in CHECKED]
    for kind in (ELSEWHERE, HERE, ONE_SCENE):
        for which, end in (("lowest", min), ("highest", max)):
            point = end(judged, key=lambda point: point.coverage[kind])
            yield check(
                f"share of intervals {kind} that hold the truth, {which}",
                point.coverage[kind],
                *COVERAGE,
                why=f"of {len(judged)} kinds of study, {count} each: {point}; 95 % is what the interval says",
            )
    for effect, share in POWER.items():
        what = f"share of studies of the default size that find {effect:g} dB {ELSEWHERE}"
        yield check(what, default.power[ELSEWHERE][effect], low=share, why=f"{default}; {count} studies")


def _sentences(grid: list[DesignPoint], default: DesignPoint, count: int) -> Iterator[str]:
    judged = [point for point in grid if point.noise in CHECKED]
    unseen = [point for point in grid if point.noise not in CHECKED]

    def span(kind: str, points: list[DesignPoint]) -> str:
        values = [point.coverage[kind] for point in points]
        return f"{100 * min(values):.1f} to {100 * max(values):.1f} %"

    yield (
        f"An interval of 95 % holds the truth in {span(ELSEWHERE, judged)} of simulated studies where it is about "
        f"scenes like these, in {span(HERE, judged)} where it is about these scenes, and in {span(ONE_SCENE, judged)} "
        f"where it is about a single scene: {len(judged)} kinds of study, {count} of each."
    )
    sizes = " and ".join(
        f"{effect:g} dB in {100 * default.power[ELSEWHERE][effect]:.0f} % {ELSEWHERE} and in "
        f"{100 * default.power[HERE][effect]:.0f} % {HERE}"
        for effect in POWER
    )
    yield (
        f"At the noise of the default run ({DEFAULT[0]} scenes, {DEFAULT[1]} seeds; {PUBLISHED:g} dB from scene to "
        f"scene, {PAIR_SD:g} dB from seed to seed) a study finds {sizes}."
    )
    wrong = [point.coverage[ASKED_WRONGLY] for point in judged if point.scene_sd == max(SCENE_SD)]
    yield (
        f"The interval on these scenes answers no other question: where effects differ by {max(SCENE_SD):g} dB from "
        f"scene to scene, it holds the mean of all such scenes in {100 * min(wrong):.0f} to {100 * max(wrong):.0f} %."
    )
    yield (
        "A collapse is a failure, counted apart, and the intervals are about the other runs. Were it not noticed, and "
        f"one pair in fifty lost {UNSEEN_LOSS:g} dB, intervals would hold the truth in {span(ELSEWHERE, unseen)} on "
        f"scenes like these, in {span(HERE, unseen)} on these scenes, in {span(ONE_SCENE, unseen)} on a single one."
    )


def _table(points: list[DesignPoint]) -> Table:
    kinds = (ELSEWHERE, HERE, ONE_SCENE)
    columns = ["noise", "scenes", "seeds", "SD of scenes (dB)", *(f"coverage {kind} (%)" for kind in kinds)]
    columns += [f"{effect:g} dB found {kind} (%)" for effect in POWER for kind in kinds[:2]]
    rows: list[list[str | float | None]] = []
    for point in points:
        shares = [point.coverage[kind] for kind in kinds]
        shares += [point.power[kind][effect] for effect in POWER for kind in kinds[:2]]
        sizes = [float(point.scenes), float(point.seeds), point.scene_sd]
        rows.append([point.noise, *sizes, *(round(100 * share, 1) for share in shares)])
    return Table("coverage", 0, f"Coverage and power; {PAIR_SD:g} dB from seed to seed throughout", columns, rows)
