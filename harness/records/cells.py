"""The records of a run: one JSON file per cell, one for the run, one for its comparisons."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field
from msgspec.structs import asdict, replace

from harness.records.claims import ClaimFile
from harness.records.former.four_words import in_two_words
from harness.records.json_record import REMEDY, Record, digest_of, plain, read_record, without_gaps, write_record
from harness.records.metric_table import POSSIBLE
from harness.records.verdict import Verdict
from scenes.files.digest import file_digest
from scenes.files.errors import DamagedRecord
from scenes.files.json_object import JsonObject

Budget = Literal["steps", "seconds", "core_seconds"]
"""The quantity of which two methods get equal amounts: training steps, or wall or core seconds of their own clocks."""
HELD = "held:"
"""The prefix of a digest that ignores the order of keys; an older version wrote digests that depend on it."""
WAITED = 1.3
"""The wall seconds per core second above which a cell shared its processor with other work."""


class Estimate(Record, frozen=True):
    """An estimate of a difference, on these scenes or on scenes like these."""

    interval: tuple[float, float] | None
    """The two-sided 95 % interval of this comparison only; None if there are too few values to know their spread."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict comes from: in 95 % of runs all intervals of the `family` contain the truth."""
    family: int
    """The number of comparisons that are judged together (`harness.verdicts.comparisons.family_of`)."""
    verdict: Verdict
    smallest_detectable: float | None
    """The smallest true difference whose sign 80 % of runs with this spread would find."""
    effect: float | None
    """The difference in standard deviations of the paired differences in a scene, or of the scenes' means."""
    p: float | None = None
    """The two-sided p-value of a difference of 0, by the t of `interval`. It is None without an interval, for a single
    scene with too few seeds for a verdict, and in older records."""
    p_adjusted: float | None = None
    """`p` adjusted for the `family`: the sign is known if it is at most 5 %. It is Holm's step-down p-value in the
    family of the headline, and `family` times `p` in others."""


class Robust(Record, frozen=True):
    """An estimate of a difference that one bad cell does not move (`harness.verdicts.estimates.robust`)."""

    difference: float
    interval: tuple[float, float] | None
    """The exact 95 % interval of Wilcoxon's signed ranks; None with fewer than six scenes, or seeds of one scene."""


class Flagged(Record, frozen=True):
    """A pair of cells whose difference is an outlier (`harness.verdicts.estimates.robust.outliers`)."""

    scene: str
    seed: int
    difference: float
    usual: float
    """The median of all paired differences of the comparison."""


class Comparison(Record, frozen=True):
    """A paired difference `method` − `against` with its interval.

    The fields that `Estimate` has too are those of scenes like these if several were tried, else of these scenes.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    metric: str
    budget: Budget
    difference: float | None
    interval: tuple[float, float] | None
    verdict: Verdict
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    """The pairs that cannot be judged because a cell diverged, collapsed, failed or is missing."""
    simultaneous: tuple[float, float] | None
    family: int
    on_these_scenes: Estimate | None
    """The estimate whose error comes from seeds only; None without a pair."""
    scenes_like_these: Estimate | None
    """The estimate that treats scenes as drawn too: Student's t over their means. None for a single scene."""
    robust: Robust | None = None
    """None without a pair, and in older records."""
    flagged: list[Flagged] = field(default_factory=list)
    """The outlying cells, in a row over all scenes."""

    @property
    def p(self) -> float | None:
        chosen = self.scenes_like_these or self.on_these_scenes
        return chosen.p if chosen else None


class Comparisons(Record, frozen=True):
    rows: list[Comparison]
    digests: dict[str, str] = field(default_factory=dict)
    """Map file name of each compared cell → digest of its record; empty in an older run."""


SCHEMA = 1
Status = Literal["done", "diverged", "error", "not_available"]
Count = Annotated[int, Meta(ge=0, le=10**15)]
Seconds = Annotated[float, Meta(ge=0.0, le=1e10)]


class Scores(Record, frozen=True, kw_only=True):
    """A score by every metric of `METRICS`, in its order; None if a view or a run has no such score."""

    psnr: float | None = None
    ssim: float | None = None
    rmse_linear: float | None = None
    flip: float | None = None
    delta_e: float | None = None
    depth_rmse: float | None = None
    opacity_iou: float | None = None
    rel_mse: float | None = None
    smape: float | None = None
    hdr_flip: float | None = None
    lpips: float | None = None


class Checkpoint(Scores, frozen=True):
    """One scoring of the fixed test set, by every metric."""

    step: Count
    seconds: Seconds
    """The training seconds of this method so far, without scoring, warm-up and I/O."""
    network_evaluations: Count
    """The number of points at which training has evaluated the network so far."""
    density: dict[str, list[int | float]] | None = None
    """Histograms of points in the scene's box: `edges` [bins + 1], and the shares of points by the density that enters
    the amplifier, `before` [bins], and by the rendered density, `after` [bins] (sum 1, clipped into the outer bins).

    If the true occupancy of the scene is known, `before_inside`, `after_inside`, `before_outside` and `after_outside`
    [bins] are the shares of the points inside and outside the geometry (sum 1, or 0 without any), and `points` [2] are
    the numbers of points inside and outside (`scenes.rendering.occupancy`)."""
    alpha: float | None = None
    """The amplifier's α and β (Listing 2) if the method has them."""
    beta: float | None = None
    core_seconds: Seconds | None = None
    """The processor seconds of the same work, by all threads of the process (with a GPU only the host's); None in older
    records."""
    dead_units: dict[str, float] | None = None
    """Map layer → the share of its units that are 0 at all points of a sample of the box; None if the method's field
    does not report it, and in older records."""


class ViewScore(Scores, frozen=True):
    """The scores of one test view at the end of training, by every metric."""

    view: str
    psnr_ceiling: float | None = None


class LeftOut(Record, frozen=True):
    """A part that was left out because the scene does not need it."""

    what: str
    reason: str
    seconds_saved: float | None
    """The seconds saved; None, as the two fields below, unless it was measured (`--verify-omissions`, or a published
    study)."""
    difference: float | None
    """Test PSNR without the part minus that with it, in dB (a loss is negative), or the largest change of colour."""
    interval: tuple[float, float] | None
    name: str = ""
    """The name of the need in `scenes.modelling.needs`."""
    concerns: str = ""
    """One of model, sampling, rendering and metrics."""
    bound: float | None = None
    """The loss that is allowed."""
    unit: str = ""
    """The unit of `difference` and `bound`: dB, or colour for a display colour 0 … 1."""
    clock: str = ""
    """The work whose seconds `seconds_saved` counts."""
    verdict: str = ""
    """One of "within its bound", "costs more" and "inconclusive"."""
    study: str = ""
    """The published study that measured it under the same settings; empty if this run measured it, or none did."""


class CellRecord(Record, frozen=True):
    """One cell, scene × method × seed, with everything that is needed to reproduce and plot it."""

    scene: str
    method: str
    seed: int
    status: Status
    reason: str | None
    """The reason of a status other than `done`; for `diverged` the step and the tensor."""
    steps: Count
    train_seconds: Seconds
    scores: dict[str, float | None]
    """Means over the test views: psnr ssim flip delta_e rmse_linear depth_rmse opacity_iou psnr_train psnr_ceiling,
    and psnr_floor, the score of copying the nearest training view."""
    curve: list[Checkpoint]
    views: list[ViewScore]
    trace: dict[str, list[float | None]]
    """Lists of equal length over training: step, loss, gradient_norm (before clipping), clipped_norm (which the
    optimiser received; absent in older runs), alpha, beta, samples_per_ray, learning_rate (if it is the same for all
    weights), and "gradient_norm LAYER" of each layer, before clipping."""
    parameters: dict[str, int]
    """The number of weights by component: density_net, density_head, colour_net, amplifier, total."""
    properties: dict[str, int | float | str | None]
    """Measured properties: chunk_max_difference and chunk_rms_difference (the same view in small and in full chunks),
    largest_density (per half of the longest side of the scene's box), opacity_unit_slab (of that density over that
    length), occupied_share, clipped_share (the share of steps whose gradient was clipped), those of an amplifier
    (`harness.training.scoring.amplifier_effect`), and of the ceiling of density, per half of the longest side
    (`harness.training.scoring.densities`, listed in docs/records.md): density_limit is None without a limit,
    weight_at_ceiling and density_by_weight_* are None for empty pictures and for methods that are not rendered by
    points of rays. Older records have none of these."""
    warnings: list[str]
    """What a reader must know: empty collapse, billboard (train score far above test score), below the floor."""
    settings: JsonObject
    provenance: JsonObject
    train_core_seconds: Seconds | None = None
    """The processor seconds of training, as `Checkpoint.core_seconds`."""
    pictures: str | None = None
    """The file of its saved renders (`harness.records.pictures`), relative to `OUT/records`; None without any."""
    costs: dict[str, float] = field(default_factory=dict)
    """Costs of a cell that is done, which change from run to run: view_seconds and view_core_seconds, the time to
    render a test view (mean of the last scoring); weights_bytes, the size of its file; gpu_memory_bytes, the peak that
    torch allocated on a GPU; memory_bytes, the peak so far of its process, which trains all methods of a group."""
    files: dict[str, str] = field(default_factory=dict)
    """Map each other file of the cell, relative to OUT → its SHA-256 (`with_files`)."""
    schema: int = SCHEMA

    @property
    def wall_per_core_second(self) -> float | None:
        """Return the wall seconds of training per core second; above 1, it waited for a processor that others used.
        None if core seconds were not counted, and on a GPU.
        """
        if not self.train_core_seconds or self.provenance.get("device", "cpu") != "cpu":
            return None
        return self.train_seconds / self.train_core_seconds

    @property
    def waited(self) -> bool:
        return (self.wall_per_core_second or 0.0) > WAITED or self.spun

    @property
    def spun(self) -> bool:
        """Tell whether its core seconds exceed its own work, because several threads waited actively for each other on
        cores that other programs used too (`harness.machine.wait_policy`). An older record that does not say how its
        threads waited counts as active.
        """
        threads: int = self.provenance.get("threads", 1)
        if threads == 1 or self.provenance.get("waiting", "active") != "active":
            return False
        return threads * (self.wall_per_core_second or 0.0) > WAITED

    @property
    def all_warnings(self) -> list[str]:
        """Return the warnings, including that of its clock, which is not part of its results."""
        clock = f"core seconds too long: {self.provenance['threads']} threads waited actively" if self.spun else ""
        return [*self.warnings, clock] if clock else self.warnings


class SceneRecord(Record, frozen=True):
    """The facts of a view set that a reader needs."""

    name: str
    title: str
    view_set: str
    width: int
    height: int
    views: dict[str, int]
    """The number of views by split: train, val, test."""
    near: float
    far: float
    bounds: list[list[float]]
    """[[x, y, z], [x, y, z]]: lower and upper corner of the scene's box."""
    psnr_ceiling: float | None
    """The PSNR between the ground truth and a noiseless one, from its own variance."""
    psnr_floor: float | None
    """The PSNR of copying the nearest training view."""
    rendered: JsonObject
    """How it was rendered: variant, spp, seconds, integrator, versions; empty for a foreign view set."""
    left_out: list[LeftOut]
    hull_share: float | None = None
    """The share of the box that the silhouettes of the training views leave; 1 if they exclude nothing."""
    seen: str = ""
    """What the training cameras see of the box, in one line."""
    cautions: list[str] = field(default_factory=list)
    """Sentences that a reader of scores on these views must know."""

    @property
    def costs_more(self) -> bool:
        """Tell whether this run measured that an omission costs more than its bound."""
        return any(row.verdict == "costs more" and not row.study for row in self.left_out)


class Roles(Record, frozen=True):
    """The method of a run that the others are compared with, and the controls that explain a difference from it."""

    baseline: str
    controls: tuple[str, ...] = ()
    claimed: tuple[tuple[str, str], ...] = ()

    def among(self, methods: Iterable[str]) -> "Roles":
        """Return the roles in a comparison of `methods`, whose first takes the place of a missing baseline."""
        names = list(methods)
        baseline = self.baseline if self.baseline in names else names[0]
        return replace(self, baseline=baseline, controls=tuple(name for name in self.controls if name in names))

    def contenders(self, methods: Iterable[str]) -> list[str]:
        """Return the `methods` under test; if there are only a baseline and controls, the controls."""
        others = [name for name in methods if name != self.baseline]
        return [name for name in others if name not in self.controls] or others

    def pairs(self, methods: Iterable[str]) -> list[tuple[str, str]]:
        """Return the pairs to compare, (method, against); last those that only a claim compares."""
        names = list(methods)
        if not names:
            return []
        roles = self.among(names)
        pairs = [(method, roles.baseline) for method in names if method != roles.baseline]
        for control in roles.controls:
            pairs += [(method, control) for method in names if method not in (roles.baseline, control)]
        return pairs + [pair for pair in self.claimed if set(pair) <= set(names) and pair not in pairs]


USUAL = Roles("nerf", ("nerf_matched",))
"""The roles of the built-in profiles, and of records that state none."""


class RunRecord(Record, frozen=True):
    profile: str
    command: str
    scenes: list[SceneRecord]
    methods: dict[str, str]
    """Map method → its title, in the order of tables."""
    deviations: list[str]
    """Sentences on where the run departs from the paper's printed text, and why."""
    seeds: list[int]
    settings: JsonObject
    provenance: JsonObject
    phases: dict[str, float]
    """Wall seconds: render, train, verify, serve, total; summed over the parts of a resumed run."""
    finished: bool
    not_tested: list[str]
    """Sentences on what a reader might expect and this run did not test."""
    schema: int = SCHEMA
    guests: list[str] = field(default_factory=list)
    """The methods of other families that were trained for scale and are not compared."""
    claims: list[ClaimFile] | None = None
    """The claims about the methods; None in older records, for which the claims of this program hold."""
    roles: Roles = USUAL

    @property
    def main_methods(self) -> list[str]:
        """Return the methods that were planned on every scene."""
        planned = self.settings.get("methods")
        return [name for name in self.methods if not isinstance(planned, list) or name in planned]


def records_folder(out: Path) -> Path:
    return out / "records"


def cell_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return records_folder(out) / "cells" / f"{scene}.{method}.{seed}.json"


def write_cell(out: Path, cell: CellRecord) -> None:
    write_record(cell_path(out, cell.scene, cell.method, cell.seed), cell)


def checkpoint_name(scene: str, method: str, seed: int) -> str:
    """Return the file of a cell's weights, relative to OUT."""
    return f"checkpoints/{scene}.{method}.{seed}.safetensors"


def with_files(out: Path, cell: CellRecord) -> CellRecord:
    """Return the record with the digests of its other files, weights and pictures; raises `OSError`."""
    names = [checkpoint_name(cell.scene, cell.method, cell.seed)] if cell.status == "done" else []
    names += [f"records/{cell.pictures}"] if cell.pictures else []
    return replace(cell, files={name: file_digest(out / name) for name in names if (out / name).is_file()})


def write_run(out: Path, run: RunRecord) -> None:
    write_record(records_folder(out) / "run.json", run)


def digests_of(cells: Iterable[CellRecord]) -> dict[str, str]:
    """Return the digests of cells by file name; results computed from cells are checked against them."""
    return {_file_of(cell): HELD + digest_of(without_gaps(plain(cell))) for cell in cells}


def require_unchanged(path: Path, digests: dict[str, str], cells: Iterable[CellRecord]) -> None:
    """Raise `DamagedRecord` for a file that was computed from other contents of `cells`."""
    for name, digest in digests_of(cells).items():
        known = digests.get(name)
        if known is not None and known.startswith(HELD) and known != digest:
            raise DamagedRecord(f"{path}: was made when the cell {name} held something else; {REMEDY}")


def write_comparisons(out: Path, comparisons: list[Comparison], digests: dict[str, str] | None = None) -> None:
    write_record(records_folder(out) / "comparisons.json", Comparisons(comparisons, digests or {}))


def read_cell(path: Path) -> CellRecord:
    """Read a cell; raises `DamagedRecord` for anything else, a cell with another file name, and impossible scores."""
    cell = read_record(path, CellRecord, SCHEMA, formerly=("images",))
    if _file_of(cell) != path.name:
        raise DamagedRecord(f"{path}: is the record of {_file_of(cell)}; {REMEDY}")
    for scores in (cell.scores, *(asdict(point) for point in cell.curve)):
        for name, (low, high) in POSSIBLE.items():
            if not low <= (scores.get(name) or 0.0) <= high:
                raise DamagedRecord(f"{path}: {name} {scores[name]:g} is not a possible score; {REMEDY}")
    return cell


def _file_of(cell: CellRecord) -> str:
    return cell_path(Path(), cell.scene, cell.method, cell.seed).name


def read_cells(out: Path) -> Iterator[CellRecord]:
    """Yield the finished cells in the order of their file names."""
    yield from map(read_cell, cell_files(out))


def read_cells_of(out: Path, keys: Iterable[tuple[str, str, int]]) -> Iterator[CellRecord]:
    """Yield the finished cells of `keys` (scene, method, seed)."""
    return (read_cell(path) for key in keys if (path := cell_path(out, *key)).exists())


def cell_files(out: Path) -> list[Path]:
    """Return the sorted files of cells, without hidden files, which other systems leave on a shared disk."""
    return sorted(path for path in (records_folder(out) / "cells").glob("*.json") if not path.name.startswith("."))


def read_run(out: Path) -> RunRecord:
    path = records_folder(out) / "run.json"
    return read_record(path, RunRecord, SCHEMA, formerly=("paper",))


def read_comparisons(out: Path, cells: Iterable[CellRecord] = ()) -> list[Comparison]:
    """Read the comparisons; raises `DamagedRecord` for anything else, and if one of `cells` has changed since."""
    path = records_folder(out) / "comparisons.json"
    if not path.exists():
        return []
    record = read_record(path, Comparisons, None, former=in_two_words)
    require_unchanged(path, record.digests, cells)
    return record.rows


def empty_cell(scene: str, method: str, seed: int, status: Status, reason: str) -> CellRecord:
    """Return the record of a cell that has no steps, scores or weights, with the reason."""
    return CellRecord(
        scene, method, seed, status, reason, steps=0, train_seconds=0.0, scores={}, curve=[], views=[], trace={},
        parameters={}, properties={}, warnings=[], settings={}, provenance={},
    )  # fmt: skip
