"""The records of a run: one JSON file per cell, one for the run, one for its comparisons."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from msgspec import field
from msgspec.structs import asdict, replace

from harness.records.claims import ClaimFile
from harness.records.former.four_words import in_two_words
from harness.records.json_record import (
    REMEDY,
    Record,
    digest_of,
    file_digest,
    plain,
    read_record,
    without_gaps,
    write_record,
)
from harness.records.metric_table import POSSIBLE
from harness.records.verdict import Verdict
from scenes.files.errors import DamagedRecord

Budget = Literal["steps", "seconds", "core_seconds"]
"""What two methods are given equal amounts of: training steps, wall seconds or core seconds, each on its own clock."""
HELD = "held:"
"""The beginning of a digest of what a cell holds; one without it is of an older version, and of its keys' order."""
WAITED = 1.3
"""The wall seconds per core second from which work shares its processor with that of others."""


class Estimate(Record, frozen=True):
    """An estimate of a difference in one of two senses: on these scenes, or on scenes like these."""

    interval: tuple[float, float] | None
    """The two-sided 95 % interval of this comparison alone; None if there are too few values to know their spread."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict is taken from: all those of the `family` hold the truth together in 95 %."""
    family: int
    """The number of comparisons that are looked at together (`harness.verdicts.comparisons.family_of`)."""
    verdict: Verdict
    smallest_detectable: float | None
    """The smallest true difference whose sign is found in 80 % of runs with just this spread."""
    effect: float | None
    """The difference in standard deviations of the paired differences within a scene, or of the scenes' means."""
    p: float | None = None
    """The two-sided p-value of a difference of 0, by the t of `interval`; None without an interval, of a single scene
    with too few seeds for a verdict, and in older records."""
    p_adjusted: float | None = None
    """`p` for the whole `family`: the sign is known where it is at most 5 %. By Holm's step-down procedure in the
    family of the headline, `family` times `p` in others."""


class Robust(Record, frozen=True):
    """The estimate of a difference that one bad cell does not move (`harness.verdicts.estimates.robust`)."""

    difference: float
    interval: tuple[float, float] | None
    """The exact 95 % interval of Wilcoxon's signed ranks; None with fewer than six scenes, or seeds of one scene."""


class Flagged(Record, frozen=True):
    """A pair of cells whose difference lies off all others (`harness.verdicts.estimates.robust.outliers`)."""

    scene: str
    seed: int
    difference: float
    usual: float
    """The median of all paired differences of the comparison."""


class Comparison(Record, frozen=True):
    """A paired difference `method` − `against` with its interval.

    Over all scenes it is estimated in both senses. The fields beside the difference are those of scenes like these if
    several were tried, and of these scenes for a single one.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    metric: str
    budget: Budget
    difference: float | None
    interval: tuple[float, float] | None
    """Taken, as every field that `Estimate` has too, from the estimate that speaks for the row."""
    verdict: Verdict
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    """The pairs that cannot be judged because one of the two diverged, collapsed, failed or is missing."""
    simultaneous: tuple[float, float] | None
    family: int
    on_these_scenes: Estimate | None
    """The estimate with the error of seeds alone; None without any pair."""
    scenes_like_these: Estimate | None
    """The estimate for which scenes are drawn too: Student's t over their means. None for a single scene."""
    robust: Robust | None = None
    """None without any pair, and in older records."""
    flagged: list[Flagged] = field(default_factory=list)
    """The cells that lie off, in a row over all scenes."""

    @property
    def p(self) -> float | None:
        chosen = self.scenes_like_these or self.on_these_scenes
        return chosen.p if chosen else None


class Comparisons(Record, frozen=True):
    rows: list[Comparison]
    digests: dict[str, str] = field(default_factory=dict)
    """The digest of each cell's record that was compared, by the name of its file; empty in an older run."""


SCHEMA = 1


Status = Literal["done", "diverged", "error", "not_available"]


class Scores(Record, frozen=True, kw_only=True):
    """A score by every metric of `METRICS`, in its order; None where a view or a run has no such score."""

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
    """One scoring of the whole fixed test set, by every metric."""

    step: int
    seconds: float
    """The training seconds of this method so far, without scoring, warm-up and I/O."""
    network_evaluations: int
    """The number of points at which the network was evaluated for training so far."""
    density: dict[str, list[int | float]] | None = None
    """`edges` [bins + 1], `before` [bins], `after` [bins]: shares of points (sum 1, clipped into the outer bins)
    over the scene's box, of the density entering the amplifier and of the density that is rendered.

    Where the true occupancy of the scene is known also `before_inside`, `after_inside`, `before_outside` and
    `after_outside` [bins], shares of the points that truly lie inside and outside matter (sum 1, or 0 where there are
    none), and `points` [2], how many are inside and outside (`scenes.rendering.occupancy`)."""
    alpha: float | None = None
    """The amplifier's α and β (Listing 2) where the method has them."""
    beta: float | None = None
    core_seconds: float | None = None
    """The processor seconds of the same work, by all threads of the process (on a GPU the host's alone); None in older
    records.
    """
    dead_units: dict[str, float] | None = None
    """Map layer → the share of its units that are 0 at all of the points spread over the box; None where the method's
    field does not tell, and in older records."""


class ViewScore(Scores, frozen=True):
    """The scores of one test view at the end of training, by every metric."""

    view: str
    psnr_ceiling: float | None = None


class LeftOut(Record, frozen=True):
    """A part that a scene does not need and that was therefore left out."""

    what: str
    reason: str
    seconds_saved: float | None
    """None, as below, unless it was measured (`--verify-omissions`, or a published study)."""
    difference: float | None
    """Test PSNR without the part less that with it, in dB: a loss is negative. Or the largest change of colour."""
    interval: tuple[float, float] | None
    """The 95 % interval."""
    name: str = ""
    """The name of the need in `scenes.modelling.needs`."""
    concerns: str = ""
    """One of model, sampling, rendering and metrics."""
    bound: float | None = None
    """The loss that is allowed."""
    unit: str = ""
    """The unit of `difference` and `bound`: dB, or colour for a display colour 0 … 1."""
    clock: str = ""
    """The work that `seconds_saved` are seconds of."""
    verdict: str = ""
    """One of "within its bound", "costs more" and "inconclusive"."""
    study: str = ""
    """The published study that measured it under the same settings; empty if this run did, or nothing."""


class CellRecord(Record, frozen=True):
    """One cell, scene × method × seed: everything that is needed to reproduce and to plot it."""

    scene: str
    method: str
    seed: int
    status: Status
    reason: str | None
    """The reason if the status is not `done`: for `diverged` the step and the tensor."""
    steps: int
    train_seconds: float
    scores: dict[str, float | None]
    """Means over the test views: psnr ssim flip delta_e rmse_linear depth_rmse opacity_iou psnr_train psnr_ceiling,
    and psnr_floor, the score of copying the nearest training view."""
    curve: list[Checkpoint]
    views: list[ViewScore]
    trace: dict[str, list[float | None]]
    """Lists of equal length over training: step, loss, gradient_norm (before clipping), clipped_norm (what the
    optimiser got; absent from older runs), alpha, beta, samples_per_ray, learning_rate (if all weights
    have the same), and "gradient_norm LAYER" of each layer, before clipping."""
    parameters: dict[str, int]
    """The number of weights by component: density_net, density_head, colour_net, amplifier, total."""
    properties: dict[str, int | float | str | None]
    """Measured properties: chunk_max_difference, chunk_rms_difference (same view in small and in whole chunks),
    largest_density (per half of the longest side of the scene's box), opacity_unit_slab (of that length of it),
    occupied_share, clipped_share (of the steps, of which the gradient was clipped), and of a method with an amplifier
    alpha_phi and psnr_without_amplifier (`harness.training.scoring.amplifier_effect`), …

    Of the ceiling of density, per half of the longest side of the box (`harness.training.scoring.densities`):
    density_limit (the largest that the method can have; None if there is no limit), opacity_of_a_pixel (of geometry one
    pixel thick at that density; a pixel has its width in the middle of the box, the mean distance of the training
    cameras from it divided by their focal length in pixels; 1 if there is no limit), weight_at_ceiling (the share of
    the weight Σ w of test views that comes from densities of 0.99 of the limit or more), density_by_weight_50, _90 and
    _99 (the densities up to which that many percent of the weight lie). The last four are None for empty pictures and
    for methods that are not rendered by points of rays; older records have none of them."""
    warnings: list[str]
    """States that a reader must know: empty collapse, billboard (train far above test), below the floor."""
    settings: dict[str, Any]
    provenance: dict[str, Any]
    train_core_seconds: float | None = None
    """The processor seconds of training, as `Checkpoint.core_seconds`."""
    pictures: str | None = None
    """The file of its saved renders (`harness.records.pictures`) relative to `OUT/records`; None if there is none."""
    costs: dict[str, float] = field(default_factory=dict)
    """What changes from run to run, of a cell that is done: view_seconds and view_core_seconds, the time to draw a test
    view (mean of the last scoring), weights_bytes of its file, gpu_memory_bytes, the peak that torch allocated on a
    GPU, and memory_bytes, the peak so far of its process, which trains all methods of a group."""
    files: dict[str, str] = field(default_factory=dict)
    """Map every further file of the cell, relative to OUT → its SHA-256 (`with_files`)."""
    schema: int = SCHEMA

    @property
    def wall_per_core_second(self) -> float | None:
        """Return the wall seconds of training per core second: above 1, it waited for a processor that others used.

        None where no processor's seconds were counted, and on a GPU, whose work is no processor's.
        """
        if not self.train_core_seconds or self.provenance.get("device", "cpu") != "cpu":
            return None
        return self.train_seconds / self.train_core_seconds

    @property
    def waited(self) -> bool:
        return (self.wall_per_core_second or 0.0) > WAITED or self.spun

    @property
    def spun(self) -> bool:
        """Tell whether its core seconds are longer than its own work accounts for: several threads tested again and
        again whether the others were done, on cores that other programs used (`harness.machine.wait_policy`).

        Such threads use all of their cores' time where nothing else runs. Older records do not say how they waited.
        """
        threads: int = self.provenance.get("threads", 1)
        if threads == 1 or self.provenance.get("waiting", "active") != "active":
            return False
        return threads * (self.wall_per_core_second or 0.0) > WAITED

    @property
    def all_warnings(self) -> list[str]:
        """Return the warnings, also that of its clock, which is no part of its results."""
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
    rendered: dict[str, Any]
    """How it was rendered: variant, spp, seconds, integrator, versions; empty for a view set from elsewhere."""
    left_out: list[LeftOut]
    hull_share: float | None = None
    """The share of the box that the silhouettes of the training views leave; 1 where they say nothing."""
    seen: str = ""
    """What the training cameras see of the box, one line."""
    cautions: list[str] = field(default_factory=list)
    """What a reader of scores on these views has to know, one sentence each."""

    @property
    def costs_more(self) -> bool:
        """Tell whether something that was left out costs, in this run, more than its bound."""
        return any(row.verdict == "costs more" and not row.study for row in self.left_out)


class Roles(Record, frozen=True):
    """Which method of a run the others are compared with, and which ones explain a difference from it."""

    baseline: str
    controls: tuple[str, ...] = ()
    claimed: tuple[tuple[str, str], ...] = ()

    def among(self, methods: Iterable[str]) -> "Roles":
        """Return the roles in a comparison of `methods`: without the baseline, the first one takes its place."""
        some = list(methods)
        baseline = self.baseline if self.baseline in some else some[0]
        return replace(self, baseline=baseline, controls=tuple(name for name in self.controls if name in some))

    def contenders(self, methods: Iterable[str]) -> list[str]:
        """Return those of `methods` that are put to the test; of a baseline and controls alone, the controls."""
        others = [name for name in methods if name != self.baseline]
        return [name for name in others if name not in self.controls] or others

    def pairs(self, methods: Iterable[str]) -> list[tuple[str, str]]:
        """Return the pairs to compare, (method, against); last those that only a claim compares."""
        some = list(methods)
        if not some:
            return []
        cast = self.among(some)
        pairs = [(method, cast.baseline) for method in some if method != cast.baseline]
        for control in cast.controls:
            pairs += [(method, control) for method in some if method not in (cast.baseline, control)]
        return pairs + [pair for pair in self.claimed if set(pair) <= set(some) and pair not in pairs]


USUAL = Roles("nerf", ("nerf_matched",))
"""The roles in the program's own profiles, and in records that state none."""


class RunRecord(Record, frozen=True):
    profile: str
    command: str
    scenes: list[SceneRecord]
    methods: dict[str, str]
    """Map method → its title, in the order of tables."""
    deviations: list[str]
    """Where the run departs from the paper's printed text, and why; one sentence each."""
    seeds: list[int]
    settings: dict[str, Any]
    provenance: dict[str, Any]
    phases: dict[str, float]
    """Wall seconds: render, train, verify, serve, total; of a resumed run sums, but for what a killed process lost."""
    finished: bool
    not_tested: list[str]
    """What a reader might expect and this run did not test; one sentence each."""
    schema: int = SCHEMA
    guests: list[str] = field(default_factory=list)
    """The methods of other families that were trained for scale, and are compared with nothing."""
    claims: list[ClaimFile] | None = None
    """What is claimed of the methods; None in older records, whose methods have the claims that come with the program.
    """

    roles: Roles = USUAL

    @property
    def main_methods(self) -> list[str]:
        """Return the methods that were planned on every scene; the others explain a result on one of them."""
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
    """Return the record with the digests of its other files: weights and pictures. Raises `OSError`."""
    names = [checkpoint_name(cell.scene, cell.method, cell.seed)] if cell.status == "done" else []
    names += [f"records/{cell.pictures}"] if cell.pictures else []
    return replace(cell, files={name: file_digest(out / name) for name in names if (out / name).is_file()})


def write_run(out: Path, run: RunRecord) -> None:
    write_record(records_folder(out) / "run.json", run)


def digests_of(cells: Iterable[CellRecord]) -> dict[str, str]:
    """Return the digests of cells by the names of their files: what is computed from cells is held to them."""
    return {_file_of(cell): HELD + digest_of(without_gaps(plain(cell))) for cell in cells}


def require_unchanged(path: Path, digests: dict[str, str], cells: Iterable[CellRecord]) -> None:
    """Raise `DamagedRecord` for a file that was computed when one of `cells` held something else."""
    for name, digest in digests_of(cells).items():
        known = digests.get(name)
        if known is not None and known.startswith(HELD) and known != digest:
            raise DamagedRecord(f"{path}: was made when the cell {name} held something else; {REMEDY}")


def write_comparisons(out: Path, comparisons: list[Comparison], digests: dict[str, str] | None = None) -> None:
    write_record(records_folder(out) / "comparisons.json", Comparisons(comparisons, digests or {}))


def read_cell(path: Path) -> CellRecord:
    """Read a cell. Raises `DamagedRecord` for anything else, for the cell of another name, and impossible scores."""
    cell = read_record(path, CellRecord, SCHEMA, formerly=("images",))
    if _file_of(cell) != path.name:
        raise DamagedRecord(f"{path}: is the record of {_file_of(cell)}; {REMEDY}")
    for scores in (cell.scores, *(asdict(point) for point in cell.curve)):
        for name, (least, most) in POSSIBLE.items():
            if not least <= (scores.get(name) or 0.0) <= most:
                raise DamagedRecord(f"{path}: {name} {scores[name]:g} is no possible score; {REMEDY}")
    return cell


def _file_of(cell: CellRecord) -> str:
    return cell_path(Path(), cell.scene, cell.method, cell.seed).name


def read_cells(out: Path) -> Iterator[CellRecord]:
    """Yield every finished cell, in the order of file names."""
    yield from map(read_cell, cell_files(out))


def read_cells_of(out: Path, keys: Iterable[tuple[str, str, int]]) -> Iterator[CellRecord]:
    """Yield the finished cells of `keys` (scene, method, seed)."""
    return (read_cell(path) for key in keys if (path := cell_path(out, *key)).exists())


def cell_files(out: Path) -> list[Path]:
    """Return the files of cells, sorted; without hidden ones, which other systems leave on a shared disk."""
    return sorted(path for path in (records_folder(out) / "cells").glob("*.json") if not path.name.startswith("."))


def read_run(out: Path) -> RunRecord:
    path = records_folder(out) / "run.json"
    return read_record(path, RunRecord, SCHEMA, formerly=("paper",))


def read_comparisons(out: Path, cells: Iterable[CellRecord] = ()) -> list[Comparison]:
    """Read the comparisons. Raises `DamagedRecord` for anything else, and where one of `cells` has changed since."""
    path = records_folder(out) / "comparisons.json"
    if not path.exists():
        return []
    record = read_record(path, Comparisons, None, former=in_two_words)
    require_unchanged(path, record.digests, cells)
    return record.rows


def unscored(scene: str, method: str, seed: int, status: Status, reason: str) -> CellRecord:
    """Return a record without a step, a score or a weight that gives the reason."""
    return CellRecord(
        scene, method, seed, status, reason, steps=0, train_seconds=0.0, scores={}, curve=[], views=[], trace={},
        parameters={}, properties={}, warnings=[], settings={}, provenance={},
    )  # fmt: skip
