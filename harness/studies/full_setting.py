"""docs/scaling.md: what the paper's full table costs on other machines, on paper.

Operations are counted, rates are measured (speed.json) or taken from a data sheet. Every figure is an upper bound in
one respect: all samples of all rays are counted, although rays that miss the scene's box have none and empty space may
be skipped.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import ceil

from harness.plan.profiles import PROFILES, Plan
from harness.records.study import Studies
from harness.studies.speed.throughput import step_flops
from scenes.files.errors import InputError

FORWARD_OF_A_STEP = 3
"""The matrix multiplications of a step in forward passes, nearly: its first layers have two."""
VIEW_SET_BYTES_A_PIXEL = (9.0, 17.0)
"""PNG and EXR of one view, measured on view sets of 100 to 300 px."""
PICTURE_BYTES_A_PIXEL = 10
"""The bytes per pixel of a saved view: colour, opacity and depth as float16, not compressed."""
DECODED_BYTES_A_PIXEL = 16
"""The bytes per pixel of a worker's own copy of a view set on disk while it trains: RGBA as float32."""


@dataclass(frozen=True)
class Gpu:
    """The rates that a data sheet states; nothing here was measured."""

    name: str
    float32: float
    """TFLOP/s without matrix units that round: float32 matrix multiplications are float32 here (no TF32)."""
    bfloat16: float
    """TFLOP/s, dense."""


GPUS = (
    Gpu("NVIDIA A100", 19.5, 312.0),
    Gpu("NVIDIA H100 or H200, SXM", 67.0, 989.0),
    Gpu("AMD MI250X, one of its two dies", 23.9, 191.5),
    Gpu("AMD MI300X", 163.4, 1307.0),
)
ASSUMED_SHARES = {"float32": (0.2, 0.6), "bfloat16": (0.05, 0.25)}
"""The share of the data sheet's rate that a step is assumed to reach, worst and best. The paper's layers are 256 wide:
in bfloat16 memory, not arithmetic, sets the pace.
"""


@dataclass(frozen=True)
class Work:
    """The operations of one cell and the bytes of one run."""

    training: float
    """The FLOP of training."""
    scoring: float
    """The FLOP of scoring."""
    cells: int
    groups: int
    megasamples: float
    """The megasamples of Mitsuba's path tracer, over all scenes."""
    view_sets: tuple[float, float]
    """The bytes of the view sets: least and most."""
    decoded: float
    """The bytes per worker."""
    pictures: float
    """The bytes of the pictures, at most."""

    @property
    def a_cell(self) -> float:
        return self.training + self.scoring


def paper_table(plan: Plan = PROFILES["full"], methods: int = 8, seeds: int = 5) -> Plan:
    """Return the paper's full table: its scenes, every on/off combination of its three parts, five seeds."""
    return replace(plan, methods=tuple(f"method {number}" for number in range(methods)), seeds=tuple(range(seeds)))


def work_of(plan: Plan) -> Work:
    """Count the work of a plan. Raises `InputError` for a plan of seconds, whose cost is those seconds."""
    if plan.budget.steps is None:
        raise InputError("--budget-seconds: such a plan costs its seconds; the estimate is for steps")
    train, views, score = plan.train, plan.views, plan.score
    # the coarse network sees the coarse samples, the fine one all of them
    samples = train.bins + (train.bins + train.fine_bins if train.fine_bins else 0)
    step = step_flops(train.network, train.rays * samples, train.rays)
    a_ray = step / train.rays / FORWARD_OF_A_STEP
    pixels = views.resolution**2
    scored = score.checkpoints * views.test + score.train_views
    cells, first_seed = len(plan.cells()), len(plan.scenes) * len(plan.methods)
    kept = first_seed * score.checkpoints + (cells - first_seed) + len(plan.scenes)
    all_views = len(plan.scenes) * (views.train + views.val + views.test)
    spp = (views.train + views.val) * views.spp_train + views.test * views.spp_test
    return Work(
        training=plan.budget.steps * step,
        scoring=scored * pixels * a_ray,
        cells=cells,
        groups=len(plan.groups()),
        megasamples=len(plan.scenes) * spp * pixels / 1e6,
        view_sets=(all_views * pixels * VIEW_SET_BYTES_A_PIXEL[0], all_views * pixels * VIEW_SET_BYTES_A_PIXEL[1]),
        decoded=float((views.train + views.test) * pixels * DECODED_BYTES_A_PIXEL),
        pictures=float(kept * score.stored_views * pixels * PICTURE_BYTES_A_PIXEL),
    )


def wall_hours(work: Work, cell_hours: float, places: int, methods: int, split: bool = False) -> float:
    """Return the hours until the last group (with `split` the last cell) ends on `places` GPUs, each doing one at a
    time.

    All are equally long, so that the place with most of them takes longest.
    """
    pieces, hours = (work.cells, cell_hours) if split else (work.groups, cell_hours * methods)
    return ceil(pieces / places) * hours


def measured_rate(speed: Studies) -> float:
    """Return the FLOP/s of the paper's network in training on the machine of `speed`. Raises `InputError` without
    it.
    """
    return value_of(speed, "matrix.paper.rate") * 1e12


def render_seconds(speed: Studies) -> tuple[float, float]:
    """Return seconds per megasample: least and most over the scenes measured, of the fastest variant that works
    there.
    """
    found: dict[str, list[float]] = {}
    for _, one in speed.checks():
        parts = one.id.split(".")
        if len(parts) == 4 and parts[0] == "render" and parts[3] == "seconds" and one.value is not None:
            found.setdefault(parts[1], []).append(one.value)
    if not found:
        raise InputError("the speed record has no seconds of rendering; run `nox -s speed` again")
    fastest = [min(values) for values in found.values()]
    return min(fastest), max(fastest)


def value_of(speed: Studies, name: str) -> float:
    """Return the value of a measurement. Raises `InputError` if it was not measured."""
    for _, one in speed.checks():
        if one.id == name and one.value is not None:
            return one.value
    raise InputError(f"the speed record has no {name}; run `nox -s speed` again")


PLACES = (1, 8, 64)
COMBINATIONS = 8


def page(speed: Studies) -> str:
    """Return the page as Markdown."""
    plan = paper_table()
    work = work_of(plan)
    lean = work_of(paper_table(_fewer_views()))
    cores = speed.provenance["cores"]
    rate = measured_rate(speed)
    return "\n".join(
        [
            "# What the paper's full table costs",
            "",
            "Printed by `python -m harness study scaling`; give it your own machine's figures with `--speed`. "
            f"The table is {len(plan.scenes)} scenes × 2³ methods × {len(plan.seeds)} seeds × {plan.budget.steps:,} "
            f"steps at {plan.views.resolution} × {plan.views.resolution}: {work.cells} cells in {work.groups} groups "
            "(a scene and a seed, its methods in lockstep).",
            "",
            "**Measured**: rates of this processor. **Counted**: floating-point operations of the matrix products, "
            "every sample of every ray, so that the true figure is lower where rays miss the scene's box. **Assumed**: "
            "everything about GPUs. No cell of this table was ever trained, on any machine.",
            "",
            "## Work",
            "",
            *_table(
                ("", "of a cell", "of all"),
                [
                    ("training", _flop(work.training), _flop(work.training * work.cells)),
                    ("scoring the test views", _flop(work.scoring), _flop(work.scoring * work.cells)),
                    ("both", _flop(work.a_cell), _flop(work.a_cell * work.cells)),
                ],
            ),
            "",
            f"Scoring is {work.scoring / work.training:.1f} times the training: {plan.score.checkpoints} checkpoints × "
            f"{plan.views.test} views × {plan.views.resolution}² pixels × 256 network evaluations a ray. With every "
            f"eighth test view it would be {lean.scoring / lean.training:.2f} times; the profile has no option for "
            "that, and scores all views.",
            "",
            f"## On the measured processor ({speed.provenance['processor']}, {cores} cores, float32)",
            "",
            f"Training steps of the paper's network reach {rate / 1e12:.3f} TFLOP/s there, "
            f"{value_of(speed, 'matrix.paper.share'):.0f} % of what its matrix products reach alone: "
            f"{work.training / rate / 86400:.1f} days of training and {work.scoring / rate / 86400:.1f} of scoring for "
            f"a cell, {work.a_cell * work.cells / rate / 86400 / 365:.1f} years for the table. Do not.",
            "",
            "## On GPUs, assumed",
            "",
            "Rates are those of the vendors' data sheets, dense. The shares of it that a step reaches are assumptions: "
            + "; ".join(f"{name} {low:.0%} to {high:.0%}" for name, (low, high) in ASSUMED_SHARES.items())
            + ". The full profile multiplies in float32 without TF32; `--precision bfloat16` is the other column, and "
            "memory sets its pace, as the layers are but 256 wide.",
            "",
            *_gpu_table(work),
            "",
            "GPU-hours are for all cells, training and scoring. Wall hours follow below; a GPU that is shared with "
            "anything else makes its clocks worthless.",
            "",
            "## Wall time on 1, 8 and 64 GPUs",
            "",
            *_wall_table(work),
            "",
            f"The bag holds {work.groups} groups, all equally long. So {PLACES[-1]} GPUs are no faster than "
            f"{work.groups}: {PLACES[-1] - work.groups} stand idle, and the wall time is one group, "
            f"{COMBINATIONS} cells one after the other. Were groups split into cells, {PLACES[-1]} GPUs would do it in "
            f"{-(-work.cells // PLACES[-1])} cells instead of {COMBINATIONS}. What that costs: the methods of a scene "
            "and seed no longer run in turn on the same device in the same hour, so equal-time comparisons would also "
            "compare two GPUs; equal-step comparisons would not change by a bit. The harness does not split groups. "
            "More seeds or scenes fill the GPUs instead: 8 scenes × 8 seeds are 64 groups.",
            "",
            "## Ground truth",
            "",
            *_rendering(work, speed),
            "",
            "## Disk",
            "",
            *_table(
                ("what", "how much"),
                [
                    ("view sets", f"{_gigabytes(work.view_sets[0])} to {_gigabytes(work.view_sets[1])}"),
                    ("decoded images, a copy for each running group", _gigabytes(work.decoded)),
                    ("kept pictures in the records, at most", _gigabytes(work.pictures)),
                ],
            ),
            "",
            "Bytes a pixel of view sets were measured at 100 to 300 px; pictures are not compressed. Checkpoints are a "
            "few megabytes a cell. On Ray, every node without the driver's disk fetches each view set that it trains "
            "on once, so that its temporary folder needs room for them and for the decoded images; the driver's disk "
            "holds everything else.",
            "",
        ]
    )


def _fewer_views() -> Plan:
    plan = PROFILES["full"]
    return replace(plan, views=replace(plan.views, test=plan.views.test // 8))


def _hours(work: Work, gpu: Gpu, precision: str) -> tuple[float, float]:
    """Return the hours of one cell: best and worst."""
    low, high = ASSUMED_SHARES[precision]
    peak = getattr(gpu, precision) * 1e12
    return work.a_cell / (peak * high) / 3600, work.a_cell / (peak * low) / 3600


def _gpu_table(work: Work) -> list[str]:
    rows = []
    for gpu in GPUS:
        row = [gpu.name]
        for precision in ASSUMED_SHARES:
            best, worst = _hours(work, gpu, precision)
            row += [
                f"{getattr(gpu, precision):g}",
                f"{_number(best)} – {_number(worst)}",
                f"{_number(best * work.cells)} – {_number(worst * work.cells)}",
            ]
        rows.append(tuple(row))
    figures = ("TFLOP/s", "hours a cell", "GPU-hours")
    return _table(("GPU", *(f"{precision}: {one}" for precision in ASSUMED_SHARES for one in figures)), rows)


def _wall_table(work: Work) -> list[str]:
    rows = []
    for gpu in GPUS:
        for precision in ASSUMED_SHARES:
            best, worst = _hours(work, gpu, precision)
            cells = [
                f"{_number(wall_hours(work, best, places, COMBINATIONS))} – "
                f"{_number(wall_hours(work, worst, places, COMBINATIONS))}"
                for places in PLACES
            ]
            split = (
                f"{_number(wall_hours(work, best, PLACES[-1], COMBINATIONS, split=True))} – "
                f"{_number(wall_hours(work, worst, PLACES[-1], COMBINATIONS, split=True))}"
            )
            rows.append((gpu.name, precision, *cells, split))
    heads = ("hours", "products", *(f"{places} GPUs" if places > 1 else "1 GPU" for places in PLACES), "64, if split")
    return _table(heads, rows)


def _rendering(work: Work, speed: Studies) -> list[str]:
    low, high = (seconds * work.megasamples / 3600 for seconds in render_seconds(speed))
    cores = speed.provenance["cores"]
    return [
        f"Mitsuba renders the view sets on the driver's processor before anything trains: {work.megasamples:,.0f} "
        f"million samples, {low:.0f} to {high:.0f} hours on the {cores} measured cores (extrapolated from views of "
        f"100 px). If it scales with cores, which was not measured beyond {cores}, 64 cores take "
        f"{low * cores / 64:.1f} to {high * cores / 64:.1f} hours. GPUs wait meanwhile: render first, on a machine "
        "without any (`python -m scenes render`), and hand the cache over with `--view-sets`."
    ]


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    lines = ["| " + " | ".join(heads) + " |"]
    lines.append("|" + "---|" * (lines[0].count("|") - 1))
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def _flop(value: float) -> str:
    exponent = len(f"{value:.0f}") - 1
    return f"{value / 10**exponent:.2f} · 10^{exponent} FLOP"


def _gigabytes(value: float) -> str:
    return f"{value / 1e9:.1f} GB"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}"
