"""What a plan costs on other machines, on paper: operations counted, rates measured or taken from a data sheet.

Every figure is an upper bound in one respect: all samples of all rays are counted, although rays that miss the
scene's box have none and empty space may be skipped.
"""

from dataclasses import dataclass, replace
from math import ceil

from harness.plan import PROFILES, Plan
from harness.speed.matrix_rate import step_flops
from harness.speed_record import SpeedRecord
from scenes.errors import InputError

FORWARD_OF_A_STEP = 3
"""A step's products in forward passes, nearly: its first layers have two."""
VIEW_SET_BYTES_A_PIXEL = (9.0, 17.0)
"""PNG and EXR of one view, measured on view sets of 100 to 300 px."""
PICTURE_BYTES_A_PIXEL = 10
"""Of a kept view: colour, opacity and depth as float16, not compressed."""
DECODED_BYTES_A_PIXEL = 16
"""A worker's own copy of a view set on disk while it trains: RGBA as float32."""


@dataclass(frozen=True)
class Gpu:
    """What a data sheet says; nothing here was measured."""

    name: str
    float32: float
    """TFLOP/s without matrix units that round: float32 products are float32 here (no TF32)."""
    bfloat16: float
    """TFLOP/s, dense."""


GPUS = (
    Gpu("NVIDIA A100", 19.5, 312.0),
    Gpu("NVIDIA H100 or H200, SXM", 67.0, 989.0),
    Gpu("AMD MI250X, one of its two dies", 23.9, 191.5),
    Gpu("AMD MI300X", 163.4, 1307.0),
)
ASSUMED_SHARES = {"float32": (0.2, 0.6), "bfloat16": (0.05, 0.25)}
"""Of the data sheet's rate that a step is assumed to reach, worst and best. The paper's layers are 256 wide: in
bfloat16 memory, not arithmetic, sets the pace."""


@dataclass(frozen=True)
class Work:
    """Operations of one cell and bytes of one run."""

    training: float
    """FLOP."""
    scoring: float
    """FLOP."""
    cells: int
    groups: int
    megasamples: float
    """Of Mitsuba's path tracer, over all scenes."""
    view_sets: tuple[float, float]
    """Bytes."""
    decoded: float
    """Bytes a worker."""
    pictures: float
    """Bytes at most."""

    @property
    def a_cell(self) -> float:
        return self.training + self.scoring


def paper_table(plan: Plan = PROFILES["full"], methods: int = 8, seeds: int = 5) -> Plan:
    """The paper's full table: its scenes, every on/off combination of its three parts, five seeds."""
    return replace(plan, methods=tuple(f"method {number}" for number in range(methods)), seeds=tuple(range(seeds)))


def work_of(plan: Plan) -> Work:
    """Raises `InputError` for a plan of seconds, which cost what they say."""
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
    """Until the last group (with `split` the last cell) ends on `places` GPUs, each doing one at a time.

    All are equally long, so that the longest place is the one with most.
    """
    pieces, hours = (work.cells, cell_hours) if split else (work.groups, cell_hours * methods)
    return ceil(pieces / places) * hours


def measured_rate(speed: SpeedRecord) -> float:
    """FLOP/s of the paper's network in training on the machine of `speed`. Raises `InputError` without it."""
    return value_of(speed, "matrix.paper.rate") * 1e12


def render_seconds(speed: SpeedRecord) -> tuple[float, float]:
    """Seconds a megasample: least and most over the scenes measured, of the fastest variant that works there."""
    found: dict[str, list[float]] = {}
    for one in speed.measurements:
        parts = one.id.split(".")
        if len(parts) == 4 and parts[0] == "render" and parts[3] == "seconds" and one.value is not None:
            found.setdefault(parts[1], []).append(one.value)
    if not found:
        raise InputError("the speed record has no seconds of rendering; run `nox -s speed` again")
    fastest = [min(values) for values in found.values()]
    return min(fastest), max(fastest)


def value_of(speed: SpeedRecord, name: str) -> float:
    """Raises `InputError` where it was not measured."""
    for one in speed.measurements:
        if one.id == name and one.value is not None:
            return one.value
    raise InputError(f"the speed record has no {name}; run `nox -s speed` again")
