"""docs/scaling.md: an estimate of what the paper's full table costs on other machines.

Operations are counted; rates are measured (speed.json) or taken from data sheets. The count is an upper bound: it has
all samples of all rays, although rays that miss the scene's box have none and empty space may be skipped.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import ceil

from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.records.study import Studies
from harness.studies.speed.throughput import step_flops
from scenes.files.errors import InputError

FORWARD_PASSES_PER_STEP = 3
"""The matrix multiplications of a step, in forward passes; the first layers need only two."""
VIEW_SET_BYTES_PER_PIXEL = (9.0, 17.0)
"""The bytes per pixel of a view's PNG and EXR files, minimum and maximum, on view sets of 100 to 300 px."""
PICTURE_BYTES_PER_PIXEL = 10
"""The bytes per pixel of a saved view: colour, opacity and depth as float16, not compressed."""
DECODED_BYTES_PER_PIXEL = 16
"""The bytes per pixel of a worker's own copy of a view set on disk while it trains: RGBA as float32."""

GPUS = {
    "NVIDIA A100": {"float32": 19.5, "bfloat16": 312.0},
    "NVIDIA H100 or H200, SXM": {"float32": 67.0, "bfloat16": 989.0},
    "AMD MI250X, one of its two dies": {"float32": 23.9, "bfloat16": 191.5},
    "AMD MI300X": {"float32": 163.4, "bfloat16": 1307.0},
}
"""Dense TFLOP/s without TF32, as stated by data sheets; none was measured."""
ASSUMED_SHARES = {"float32": (0.2, 0.6), "bfloat16": (0.025, 0.1)}
"""The share of the data sheet's rate that a step is assumed to reach, worst and best; an H100 reached about the worst
(`docs/gpu/speed.json`). The paper's layers are only 256 wide, so that memory limits the rate in bfloat16.
"""


@dataclass(frozen=True)
class Work:
    training: float
    scoring: float
    """FLOP, like that of training."""
    cells: int
    groups: int
    megasamples: tuple[float, float]
    """The megasamples of Mitsuba's path tracer, over all scenes: minimum and maximum of what scenes need."""
    view_sets: tuple[float, float]
    """Bytes: minimum and maximum."""
    decoded: float
    """Bytes per worker."""
    pictures: float
    """Bytes, at most."""

    @property
    def per_cell(self) -> float:
        return self.training + self.scoring


def paper_table(plan: Plan = PROFILES["full"]) -> Plan:
    """Return the paper's full table: its scenes, every combination of its three parts, five seeds."""
    return replace(
        plan.without_extras(), methods=tuple(f"method {number}" for number in range(2**3)), seeds=tuple(range(5))
    )


def work_of(plan: Plan) -> Work:
    """Count the work of a plan. Raises `InputError` for a plan of seconds, which costs just these."""
    if plan.budget.steps is None:
        raise InputError("--budget-seconds: such a plan costs its seconds; the estimate is for steps")
    train, views, score = plan.train, plan.views, plan.score
    # the coarse network evaluates the coarse samples, the fine network all samples
    samples = train.bins + (train.bins + train.fine_bins if train.fine_bins else 0)
    step = step_flops(train.network, train.rays * samples, train.rays)
    per_ray = step / train.rays / FORWARD_PASSES_PER_STEP
    pixels = views.resolution**2
    scored = score.rendered(views.test) + score.train_views
    cells, first_seed = len(plan.cells()), len(plan.scenes) * len(plan.methods)
    kept = first_seed * score.checkpoints + (cells - first_seed) + len(plan.scenes)
    all_views = len(plan.scenes) * (views.train + views.val + views.test)
    low, high = (len(plan.scenes) * spp * pixels / 1e6 for spp in views.samples())
    return Work(
        training=plan.budget.steps * step,
        scoring=scored * pixels * per_ray,
        cells=cells,
        groups=len(plan.groups()),
        megasamples=(low, high),
        view_sets=(all_views * pixels * VIEW_SET_BYTES_PER_PIXEL[0], all_views * pixels * VIEW_SET_BYTES_PER_PIXEL[1]),
        decoded=float((views.train + views.test) * pixels * DECODED_BYTES_PER_PIXEL),
        pictures=float(kept * score.stored_views * pixels * PICTURE_BYTES_PER_PIXEL),
    )


def wall_hours(work: Work, cell_hours: float, gpus: int) -> float:
    """Return the hours until the busiest GPU has trained its groups, which are equally long, one after the other."""
    return ceil(work.groups / gpus) * cell_hours * work.cells / work.groups


def measured_rate(speed: Studies) -> float:
    """Return the FLOP/s of training the paper's network on the machine of `speed`. Raises `InputError`."""
    return value_of(speed, "matrix.paper.rate") * 1e12


def render_seconds(speed: Studies) -> tuple[float, float]:
    """Return seconds per megasample of the fastest variant that works: minimum and maximum over the scenes."""
    fastest: dict[str, float] = {}
    for name, seconds in _values(speed).items():
        if rendered := re.fullmatch(r"render\.(\w+)\.\w+\.seconds", name):
            fastest[rendered[1]] = min(seconds, fastest.get(rendered[1], seconds))
    if not fastest:
        raise InputError("the speed record has no seconds of rendering; run `nox -s speed` again")
    return min(fastest.values()), max(fastest.values())


def value_of(speed: Studies, name: str) -> float:
    if name not in _values(speed):
        raise InputError(f"the speed record has no {name}; run `nox -s speed` again")
    return _values(speed)[name]


def _values(speed: Studies) -> dict[str, float]:
    return {check.id: check.value for _, check in speed.checks() if check.value is not None}


def page(speed: Studies) -> str:
    plan = paper_table()
    work, cores, rate = work_of(plan), speed.provenance["cores"], measured_rate(speed)
    rendering = [
        seconds * amount / 3600 for seconds, amount in zip(render_seconds(speed), work.megasamples, strict=True)
    ]
    shares = "; ".join(f"{name} {100 * low:g} % to {100 * high:g} %" for name, (low, high) in ASSUMED_SHARES.items())
    blocks = [
        "# What the paper's full table costs",
        "Printed by `python -m harness study scaling`; give it your own machine's figures with `--speed`. "
        f"The table is {len(plan.scenes)} scenes × 2³ methods × {len(plan.seeds)} seeds × {plan.budget.steps:,} "
        f"steps at {plan.views.resolution} × {plan.views.resolution}: {work.cells} cells in {work.groups} groups "
        "(a scene and a seed, its methods in lockstep).",
        "**Measured**: rates of this processor. **Counted**: floating-point operations of the matrix multiplications, "
        "every sample of every ray, so that the true figure is lower where rays miss the scene's box. **Assumed**: "
        "what share of its rate a GPU reaches. No cell of this table was ever trained, on any machine.",
        "## Work",
        _table(
            ("", "per cell", "in all"),
            [
                (name, _flop(value), _flop(value * work.cells))
                for name, value in (("training", work.training), ("scoring the test views", work.scoring))
            ],
        ),
        f"Scoring is {work.scoring / work.training:.1f} times the training: {plan.score.curve_views} views at each of "
        f"{plan.score.checkpoints - 1} checkpoints and {plan.views.test} at the end, {plan.views.resolution}² pixels "
        "each, with 256 network evaluations per ray. `--test-views`, `--curve-views` and `--checkpoints` change that.",
        f"## On the measured processor ({speed.provenance['processor']}, {cores} cores, float32)",
        f"Training steps of the paper's network reach {rate / 1e12:.3f} TFLOP/s there, "
        f"{value_of(speed, 'matrix.paper.share'):.0f} % of what its matrix multiplications reach alone: "
        f"{work.training / rate / 86400:.1f} days of training and {work.scoring / rate / 86400:.1f} of scoring per "
        f"cell, {work.per_cell * work.cells / rate / 86400 / 365:.1f} years for the table. Do not.",
        "## On GPUs, assumed",
        f"Rates are those of the vendors' data sheets, dense. The shares that a step reaches are assumed: {shares}; "
        "an H100 reached about the least of them before steps were taken in turns (`docs/gpu/speed.json`). The profile "
        "multiplies in bfloat16, where memory sets the pace, as the layers are only 256 wide.",
        _table(
            ("GPU", "precision", "TFLOP/s", "hours per cell", "hours on 1 GPU", "on 8", f"on {work.groups} or more"),
            [_gpu_row(work, gpu, precision) for gpu in GPUS for precision in ASSUMED_SHARES],
        ),
        f"No more than {work.groups} GPUs are busy at once: the harness trains the methods of a scene and a seed in "
        "turn on one device, so that equal-time comparisons do not compare two GPUs. More seeds fill more GPUs. A GPU "
        "that is shared with anything else makes its clocks worthless.",
        "## Ground truth",
        f"Mitsuba renders the view sets on the driver's processor before anything trains: {work.megasamples[0]:,.0f} "
        f"to {work.megasamples[1]:,.0f} million samples, as few as its noise allows (a ceiling of "
        f"{plan.views.ceiling_train_db:g} dB for training views and {plan.views.ceiling_test_db:g} dB for test views), "
        f"{rendering[0]:.0f} to {rendering[1]:.0f} hours on the {cores} measured cores (extrapolated "
        "from views of 100 px). GPUs wait meanwhile: render first, on a machine without any (`python -m scenes "
        "render`), and hand the cache over with `--view-sets`.",
        "## Disk",
        f"View sets take {_gigabytes(work.view_sets[0])} to {_gigabytes(work.view_sets[1])} (bytes per pixel were "
        f"measured at 100 to 300 px), decoded images {_gigabytes(work.decoded)} for each running group, and saved "
        f"pictures at most {_gigabytes(work.pictures)}. On Ray, every node without the driver's disk fetches each view "
        "set that it trains on once, into its temporary folder; the driver's disk holds everything else.",
    ]
    return "\n\n".join(blocks) + "\n"


def _gpu_row(work: Work, gpu: str, precision: str) -> tuple[str, ...]:
    peak = GPUS[gpu][precision]
    low, high = (work.per_cell / (peak * 1e12 * share) / 3600 for share in reversed(ASSUMED_SHARES[precision]))
    walls = [[wall_hours(work, hours, gpus) for hours in (low, high)] for gpus in (1, 8, work.groups)]
    return gpu, precision, f"{peak:g}", *(f"{_number(a)} – {_number(b)}" for a, b in [(low, high), *walls])


def _table(heads: tuple[str, ...], rows: Iterable[Iterable[str]]) -> str:
    return "\n".join("| " + " | ".join(row) + " |" for row in [heads, ["---"] * len(heads), *rows])


def _flop(value: float) -> str:
    exponent = len(f"{value:.0f}") - 1
    return f"{value / 10**exponent:.2f} · 10^{exponent} FLOP"


def _gigabytes(value: float) -> str:
    return f"{value / 1e9:.1f} GB"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}"
