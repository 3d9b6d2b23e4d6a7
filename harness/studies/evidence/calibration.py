"""How often the intervals hold the truth, and how often an effect is found: simulated studies whose truth is known.

The functions under test are those that judge a run. Every study is a table of scenes and seeds, with an effect that
differs from scene to scene and noise that differs from seed to seed, as much as in the published run. Scenes are not
equally noisy, noise may have heavy tails, cells may fail, and one cell may end far below all others.
"""

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from harness.plan.profiles import JUDGED
from harness.records.cells import USUAL
from harness.records.metric_table import PRIMARY
from harness.records.study import Check, Series, Table, check
from harness.studies.evidence.evidence_context import EvidenceContext
from harness.studies.framework import Found, Rows
from harness.verdicts.estimates import nested
from harness.verdicts.estimates.multiplicity import holm
from harness.verdicts.estimates.robust import robust_over_scenes
from harness.verdicts.statistics import half_widths, p_values

SCENES = (4, 8, 16)
SEEDS = (3, 5)
LARGE_SD = 0.6
"""dB: the standard deviation of an effect over scenes, larger than any that was measured."""
DEFAULT = (8, 3)
"""Scenes and seeds of the default run."""
PAIRS = [(JUDGED.index(method), JUDGED.index(against)) for method, against in USUAL.pairs(JUDGED)]
HEADLINE = 2 * len(PAIRS)
"""The family of the headline of the default run: its pairs at two budgets."""
STUDIES = 5000
"""The number of studies simulated at each point of the grid: it resolves a coverage of 95 % to ± 0.31 %."""
COVERAGE = {(8, 16): (0.93, 0.975), (4,): (0.93, 0.98)}
"""Scenes → the limits of a share of intervals. Over four scenes Student's t is too wide if one is much noisier."""
POWER = {0.2: 0.55, 0.3: 0.88}
"""dB: effect → the minimum share of studies of the default size that must find it, in the headline's family."""
EFFECTS = tuple(round(0.05 * step, 2) for step in range(13))
LOST = 1 / 50
"""The share of the runs that fail and are excluded."""
BAD = 3.0
"""dB: how far the bad cell ends below what its seed would give."""
NOISIER = 4.0
ONE_SCENE, HERE, ELSEWHERE = "on one scene", "on these scenes", "on scenes like these"
CHANGE_HERE, CHANGE_ELSEWHERE = "of a change on these scenes", "of a change on scenes like these"
CHANGE_OF_SEEDS = "of a change on these scenes, with other seeds"
ROBUST = "of the robust estimate"
KINDS = (ONE_SCENE, HERE, ELSEWHERE, CHANGE_HERE, CHANGE_ELSEWHERE, CHANGE_OF_SEEDS, ROBUST)
ALONE = "on scenes like these, alone"
ASKED_WRONGLY = "on these scenes, asked about others"
PUBLISHED = Path(__file__).parents[3] / "docs" / "reduced" / "summary.json"
METHOD, AGAINST = "qnerf", "nerf"


@dataclass(frozen=True)
class Scatter:
    """How much a paired difference of PSNR scatters, dB."""

    source: str
    scene_sd: float
    """The standard deviation of the true differences from scene to scene."""
    seed_sds: tuple[float, ...]
    """The standard deviation over seeds of each scene, as measured, without smoothing over scenes."""

    @property
    def pooled(self) -> float:
        return math.sqrt(float(np.mean(np.square(self.seed_sds))))

    def __str__(self) -> str:
        low, high = min(self.seed_sds), max(self.seed_sds)
        return (
            f"{self.source}: {self.scene_sd:.3f} dB from scene to scene, {self.pooled:.3f} dB from seed to seed "
            f"({low:.3f} to {high:.3f} by scene)"
        )


ASSUMED = Scatter("assumed, as there is no published run", 0.1, (0.05, 0.1, 0.1, 0.2))


def published_scatter(file: Path = PUBLISHED) -> Scatter:
    """Return the scatter of `qnerf` − `nerf` in the published run, or `ASSUMED` without such a run."""
    if not file.is_file():
        return ASSUMED
    run = json.loads(file.read_text(encoding="utf-8"))
    psnr = {(cell["scene"], cell["method"], cell["seed"]): cell[PRIMARY] for cell in run["cells"]}
    names, seeds = [scene["scene"] for scene in run["scenes"]], run["seeds"]
    pairs = [[[psnr.get((name, method, seed)) for method in (METHOD, AGAINST)] for seed in seeds] for name in names]
    rows = [-np.diff(np.array(row, dtype=np.float64), axis=1)[:, 0] for row in pairs]  # NaN for a missing score
    known = [row[np.isfinite(row)] for row in rows if np.isfinite(row).sum() > 1]
    if len(known) < 2:
        return ASSUMED
    variances = np.array([row.var(ddof=1) for row in known])
    # a scene's mean varies with its seeds too: their part is subtracted
    between = np.var([row.mean() for row in known], ddof=1) - np.mean(variances / [row.size for row in known])
    source = f"{METHOD} − {AGAINST} in {file.parent.name}/{file.name}, commit {run['provenance']['commit']}"
    return Scatter(source, math.sqrt(max(0.0, float(between))), tuple(np.sqrt(variances).tolist()))


EQUAL, UNEQUAL, ONE_NOISY = "equal scenes", "unequal scenes", f"one scene {NOISIER:g} times as noisy"
HEAVY, ONE_LOST = "heavy tails (t₄)", "1 in 50 fails and is excluded"
ONE_BAD = f"one cell ends {BAD:g} dB too low"
CHECKED = (EQUAL, UNEQUAL, ONE_NOISY, HEAVY, ONE_LOST)
NOISE = (*CHECKED, ONE_BAD)


def noise_of(kind: str, generator: np.random.Generator, shape: tuple[int, int, int], scatter: Scatter) -> np.ndarray:
    """Draw an array [studies, scenes, seeds] of one kind of `NOISE`."""
    if kind == HEAVY:
        return scatter.pooled * generator.standard_t(4, shape) / math.sqrt(2)
    sds = np.array(scatter.pooled)
    if kind not in (EQUAL, ONE_NOISY):
        sds = generator.choice(scatter.seed_sds, (*shape[:2], 1))
    values: np.ndarray = sds * generator.standard_normal(shape)
    if kind == ONE_NOISY:
        values[:, 0] *= NOISIER
    elif kind == ONE_LOST:
        values[generator.random(shape) < LOST] = np.nan
    elif kind == ONE_BAD:
        values[:, 0, 0] -= BAD
    return values


@dataclass(frozen=True)
class DesignPoint:
    noise: str
    scenes: int
    seeds: int
    scene_sd: float
    coverage: dict[str, float]
    """Interval → share of studies in which it contains the truth; without intervals that are never printed."""
    power: dict[str, dict[float, float]]
    """Estimate → effect in dB → share of studies that call it above 0, in the headline's family or singly."""

    def __str__(self) -> str:
        return f"{self.noise}, {self.scenes} scenes, {self.seeds} seeds, {self.scene_sd:.3g} dB from scene to scene"


@dataclass(frozen=True)
class Simulated:
    scatter: Scatter
    count: int
    """The number of studies at each point."""
    grid: list[DesignPoint]
    default: DesignPoint
    """The size of the default run."""
    bad: DesignPoint
    """The same with one bad cell."""
    claims: dict[str, float]
    """Map family → the share that claims a sign where nothing differs."""
    misses: dict[str, float]
    """Map family → the share in which an interval misses the truth."""

    @property
    def judged(self) -> list[DesignPoint]:
        return [point for point in self.grid if point.noise in CHECKED]


def calibration(context: EvidenceContext) -> Iterator[Found]:
    count, scatter = 1000 if context.quick else STUDIES, published_scatter()
    sds = (0.0, scatter.scene_sd, LARGE_SD)
    grid = [simulate(*point, scatter, count) for point in product(NOISE, SCENES, SEEDS, sds)]
    default, bad = (
        simulate(noise, *DEFAULT, scatter.scene_sd, scatter, count, EFFECTS) for noise in (UNEQUAL, ONE_BAD)
    )
    claims, misses = errors_of_families(scatter, count)
    simulated = Simulated(scatter, count, grid, default, bad, claims=claims, misses=misses)
    yield from _sentences(simulated)
    yield from checks(simulated)
    for kind, power in default.power.items():
        shares = np.array(list(power.values()))
        half = 2 * np.sqrt(shares * (1 - shares) / count)
        yield Series(
            "how often an effect is called above 0, at the scatter of the published run", 0, kind,
            "true effect (dB)", "share of simulated studies", list(power), shares.tolist(),
            np.maximum(0.0, shares - half).tolist(), np.minimum(1.0, shares + half).tolist(), log_x=False, log_y=False,
        )  # fmt: skip
    yield _table([default, bad, *grid], scatter)


def simulate(
    noise: str,
    scenes: int,
    seeds: int,
    scene_sd: float,
    scatter: Scatter,
    count: int,
    effects: tuple[float, ...] = tuple(POWER),
) -> DesignPoint:
    """Simulate `count` studies. Power is that of the same studies with the effect added to every difference."""
    generator = np.random.default_rng([20260108, NOISE.index(noise), scenes, seeds, round(1000 * scene_sd)])
    truth, before = (scene_sd * generator.standard_normal((count, scenes)) for _ in range(2))
    shape = (count, scenes, seeds)
    values, earlier = (each[..., None] + noise_of(noise, generator, shape, scatter) for each in (truth, before))
    true = np.where(np.isfinite(values).any(axis=-1), truth, np.nan)
    change, of_change = values - earlier, truth - before
    here, elsewhere = nested.on_these_scenes(values), nested.scenes_like_these(values)
    known = np.isfinite(values).any(axis=-1).all(axis=-1)
    _, low, high = robust_over_scenes(values[known])
    held = {
        ONE_SCENE: _held(nested.scenes_like_these(values[..., None]), true),
        HERE: _held(here, np.nanmean(true, axis=-1)),
        ELSEWHERE: _held(elsewhere, np.zeros(count)),
        CHANGE_HERE: _held(nested.on_these_scenes(change), of_change.mean(axis=-1)),
        CHANGE_ELSEWHERE: _held(nested.scenes_like_these(change), np.zeros(count)),
        CHANGE_OF_SEEDS: _held(nested.less(here, nested.on_these_scenes(earlier)), of_change.mean(axis=-1)),
        ROBUST: float(((low <= 0) & (high >= 0)).mean()) if np.isfinite(low).all() else math.nan,
        ASKED_WRONGLY: _held(here, np.zeros(count)),
    }
    lows = {kind: each.mean - half_widths(each, HEADLINE) for kind, each in ((HERE, here), (ELSEWHERE, elsewhere))}
    lows |= {ALONE: elsewhere.mean - half_widths(elsewhere), ROBUST: low}
    power = {kind: {effect: float((ends + effect > 0).mean()) for effect in effects} for kind, ends in lows.items()}
    coverage = {kind: share for kind, share in held.items() if math.isfinite(share)}
    return DesignPoint(noise, scenes, seeds, scene_sd, coverage, power)


def _held(estimated: nested.Estimated, true: np.ndarray) -> float:
    half = half_widths(estimated)
    known = np.isfinite(half) & np.isfinite(true)
    return float((np.abs(estimated.mean - true) <= half)[known].mean())


def errors_of_families(scatter: Scatter, count: int) -> tuple[dict[str, float], dict[str, float]]:
    """Return how often a family claims a sign where nothing differs, and how often any interval of the headline, as it
    is printed, misses the truth.

    The families are single scenes of five seeds, and the headline, in which one method may differ by 1 dB: what Holm's
    procedure gains from the pairs that differ must not make the others wrong.
    """
    generator, (scenes, seeds) = np.random.default_rng(20260109), DEFAULT
    single = nested.scenes_like_these(noise_of(UNEQUAL, generator, (count, scenes, 5), scatter)[..., None])
    claims = {"single scenes": float((np.abs(single.mean) > half_widths(single, scenes)).any(axis=-1).mean())}
    misses = {}
    for name, shift in (("the headline, nothing differs", 0.0), ("the headline, one method differs", 1.0)):
        shape = (len(JUDGED), 2, count, scenes)  # the second budget shares half of its variance with the first
        flat = noise_of(UNEQUAL, generator, (len(JUDGED) * 2 * count, scenes, seeds), scatter)
        noise = flat.reshape(*shape, seeds)
        noise[:, 1] = (noise[:, 0] + noise[:, 1]) / math.sqrt(2)
        own = (noise + scatter.scene_sd * generator.standard_normal((len(JUDGED), 1, count, scenes, 1))) / math.sqrt(2)
        own[-1] += shift
        pairs = nested.scenes_like_these(np.concatenate([own[method] - own[against] for method, against in PAIRS]))
        mean, half, p = pairs.mean, half_widths(pairs, HEADLINE), p_values(pairs)
        true = np.repeat([shift * (len(JUDGED) - 1 in pair) for pair in PAIRS], 2)[:, None]
        known = np.array([holm(row) for row in p.T.tolist()], dtype=np.float64).T <= 0.05
        # as `harness.verdicts.statistics.decided`: sign and interval do not contradict each other
        low = np.where(known & (mean > 0), np.maximum(mean - half, 0.0), mean - half)
        high = np.where(known & (mean < 0), np.minimum(mean + half, 0.0), mean + half)
        claims[name] = float((known & (true == 0.0)).any(axis=0).mean())
        misses[name] = float(((low > true) | (high < true)).any(axis=0).mean())
    return claims, misses


def checks(simulated: Simulated) -> Iterator[Check]:
    default, bad, count = simulated.default, simulated.bad, simulated.count
    for kind, (scenes, limits) in product(KINDS, COVERAGE.items()):
        # one bad cell must not move the robust estimate, so that it is judged with such a cell as well
        points = simulated.grid if kind == ROBUST else simulated.judged
        printed = [point for point in points if point.scenes in scenes and kind in point.coverage]
        for which, end in (("lowest", min), ("highest", max)) if printed else ():
            point = end(printed, key=lambda point: point.coverage[kind])
            yield check(
                f"share of intervals {kind} that hold the truth, {' and '.join(map(str, scenes))} scenes, {which}",
                point.coverage[kind],
                *limits,
                why=f"of {len(printed)} kinds of study, {count} each: {point}; 95 % is nominal",
            )
    for error, shares in (
        ("that claim a sign where nothing differs", simulated.claims),
        ("with an interval that misses the truth", simulated.misses),
    ):
        for name, share in shares.items():
            what, why = f"share of families {error}, {name}", f"{count} studies of unequal scenes; 5 % is nominal"
            yield check(what, share, high=0.06, why=why)
    for effect, least in POWER.items():
        what = f"share of studies of the default size that find {effect:g} dB {ELSEWHERE}"
        yield check(what, default.power[ELSEWHERE][effect], low=least, why=f"{default}; {count} studies")
    what = f"share of studies with one bad cell in which the robust estimate finds {max(POWER):g} dB"
    yield check(what, bad.power[ROBUST][max(POWER)], low=max(POWER.values()), why=f"{bad}; {count} studies")


def _sentences(simulated: Simulated) -> Iterator[str]:
    default, bad = simulated.default, simulated.bad
    spoilt = [point for point in simulated.grid if point.noise == ONE_BAD]

    def span(kind: str, points: list[DesignPoint]) -> str:
        values = [point.coverage[kind] for point in points if kind in point.coverage]
        return f"{100 * min(values):.1f} to {100 * max(values):.1f} %"

    coverage = []
    for scenes in COVERAGE:
        points = [point for point in simulated.judged if point.scenes in scenes]
        printed = [kind for kind in KINDS if any(kind in point.coverage for point in points)]
        coverage.append(
            f"With {' and '.join(map(str, scenes))} scenes, an interval of 95 % holds the truth in "
            f"{'; '.join(f'{span(kind, points)} {kind}' for kind in printed)}: {len(points)} kinds of study, "
            f"{simulated.count} of each."
        )
    yield coverage[0]
    effects = [effect for effect in EFFECTS if 0.1 <= effect <= 0.4]
    found = ", ".join(f"{effect:g} dB in {100 * default.power[ELSEWHERE][effect]:.0f} %" for effect in effects)
    yield (
        f"At the scatter of the published run, {DEFAULT[0]} scenes and {DEFAULT[1]} seeds call an effect above 0 "
        f"{ELSEWHERE}, among the {HEADLINE} comparisons of the headline: {found}."
    )
    for shares, of in (
        (simulated.claims, "claim a sign where nothing differs"),
        (simulated.misses, "have an interval that misses the truth"),
    ):
        stated = "; ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items())
        yield f"Families that {of}, with all of their printed comparisons: {stated}."
    yield from coverage[1:]
    yield f"Kinds of study: {'; '.join(CHECKED)}; {' and '.join(map(str, SEEDS))} seeds."
    yield f"The scatter is that of {simulated.scatter}."
    effect = max(POWER)
    yield (
        f"If {ONE_BAD}, the intervals of means widen and hold the truth in {span(ELSEWHERE, spoilt)} {ELSEWHERE} and "
        f"in {span(HERE, spoilt)} {HERE}, but an effect of {effect:g} dB, tested alone, is found in "
        f"{100 * bad.power[ALONE][effect]:.0f} % where it was in {100 * default.power[ALONE][effect]:.0f} %. "
        f"The interval of the robust estimate holds the truth in {span(ROBUST, spoilt)} and finds the effect in "
        f"{100 * bad.power[ROBUST][effect]:.0f} %, without the bad cell in "
        f"{100 * default.power[ROBUST][effect]:.0f} %."
    )
    wrongly = [point.coverage[ASKED_WRONGLY] for point in simulated.judged if point.scene_sd == LARGE_SD]
    yield (
        f"The interval on these scenes holds for no others: if effects differ by {LARGE_SD:g} dB from scene to scene, "
        f"it holds the mean of all such scenes in {100 * min(wrongly):.0f} to {100 * max(wrongly):.0f} %."
    )


def _table(points: list[DesignPoint], scatter: Scatter) -> Table:
    columns = ["noise", "scenes", "seeds", "SD of scenes (dB)", *(f"coverage {kind} (%)" for kind in KINDS)]
    columns += [f"{effect:g} dB found {kind} (%)" for effect in POWER for kind in (HERE, ELSEWHERE)]
    rows: Rows = []
    for point in points:
        shares = [point.coverage.get(kind) for kind in KINDS]
        shares += [point.power[kind][effect] for effect in POWER for kind in (HERE, ELSEWHERE)]
        sizes = [float(point.scenes), float(point.seeds), round(point.scene_sd, 3)]
        rows.append([point.noise, *sizes, *(None if share is None else round(100 * share, 1) for share in shares)])
    return Table("coverage", 0, f"Coverage and power; scatter of {scatter}", columns, rows)
