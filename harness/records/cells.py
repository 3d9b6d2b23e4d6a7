"""What a run leaves behind: one JSON file a cell, one for the run, one for its comparisons."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal, TypedDict

from msgspec import defstruct, field
from msgspec.structs import replace

from harness.records.json_record import (
    REMEDY,
    DamagedRecord,
    Record,
    as_promised,
    file_digest,
    read_record,
    write_record,
)
from harness.records.metric_table import ALONG_TRAINING, METRICS


class Estimate(Record, frozen=True):
    """What is known of a difference in one of two senses: `on_these_scenes`, or on scenes like these."""

    interval: tuple[float, float] | None
    """95 %, two-sided, of this comparison alone; None where too few values say nothing of their own spread."""
    simultaneous: tuple[float, float] | None
    """The interval that the verdict is taken from: of the `family`'s, all hold the truth together in 95 %."""
    family: int
    """As many comparisons are looked at together (`harness.verdicts.comparisons.family_of`)."""
    verdict: Literal["better", "worse", "equivalent", "inconclusive"]
    smallest_detectable: float | None
    """The smallest true difference that is called better or worse in 80 % of runs with just this spread."""
    effect: float | None
    """Standardised: the difference in standard deviations of the paired differences within a scene, or of the scenes'
    means."""


class Comparison(Record, frozen=True):
    """A paired difference `method` − `against` with its interval.

    Over all scenes it is estimated in both senses. What stands beside the difference itself is that of scenes like
    these where several were tried, and of these scenes where it is a single one.
    """

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    metric: str
    budget: Literal["steps", "seconds"]
    difference: float | None
    interval: tuple[float, float] | None
    """As all that has the name of a part of `Estimate`: from the one of the two that speaks for the row."""
    verdict: Literal["better", "worse", "equivalent", "inconclusive"]
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    """Pairs that cannot be judged because one of the two diverged, collapsed, failed or is missing."""
    simultaneous: tuple[float, float] | None
    family: int
    on_these_scenes: Estimate | None
    """Error from seeds alone; None without any pair."""
    scenes_like_these: Estimate | None
    """Scenes are drawn, too: Student's t over their means. None for a single scene."""


class Comparisons(Record, frozen=True):
    """Those of a run."""

    rows: list[Comparison]


SCHEMA = 1


class PaperTables(TypedDict, total=False):
    """What of `RunRecord.paper` a report reads."""

    table1: dict[str, float] | None
    table2: dict[str, dict[str, float]] | None
    table3: dict[str, Any] | None
    table4: list[dict[str, Any]] | None
    original_nerf: dict[str, float] | None
    ledger: list[dict[str, Any]] | None
    parameters_measured: dict[str, float] | None
    sloc_measured: float | None
    sloc_files: dict[str, float] | None


Status = Literal["done", "diverged", "error", "not_available"]


def _scores(name: str, metrics: Iterable[str]) -> Any:
    """Return a struct with a field for every metric; None where a view or a run has no such score."""
    return defstruct(name, [(metric, float | None, None) for metric in metrics], bases=(Record,), kw_only=True)


ScoresAlong: Any = _scores("ScoresAlong", ALONG_TRAINING)
ViewScores: Any = _scores("ViewScores", METRICS)


class Checkpoint(ScoresAlong):
    """One scoring of the whole fixed test set, by the metrics that are scored along training."""

    step: int
    seconds: float
    """Training seconds of this method so far; scoring, warm-up and I/O are not in it."""
    network_evaluations: int
    """Points at which the network was evaluated for training so far."""
    density: dict[str, list[int | float]] | None = None
    """`edges` [bins + 1], `before` [bins], `after` [bins]: shares of points (sum 1, clipped into the outer bins)
    over the scene's box, of the density entering the amplifier and of the density that is rendered.

    Where the true occupancy of the scene is known also `before_inside`, `after_inside`, `before_outside` and
    `after_outside` [bins], shares of the points that truly lie inside and outside matter (sum 1, or 0 where there are
    none), and `points` [2], how many are inside and outside (`scenes.rendering.occupancy`)."""
    alpha: float | None = None
    """The amplifier's α and β (Listing 2) where the method has them."""
    beta: float | None = None


class ViewScore(ViewScores):
    """The scores of one test view at the end of training, by every metric."""

    view: str
    psnr_ceiling: float | None = None


class LeftOut(Record, frozen=True):
    """Something that a scene does not need and that was therefore not done."""

    what: str
    reason: str
    seconds_saved: float | None
    """None where it was not measured (`--verify-omissions`), as below."""
    difference: float | None
    """dB: test PSNR with it left out less with it done, so that less than 0 is a loss. colour: what changed at most."""
    interval: tuple[float, float] | None
    """95 %."""
    name: str = ""
    """Of the need in `scenes.modelling.needs`."""
    concerns: str = ""
    """model, sampling, rendering or metrics."""
    bound: float | None = None
    """How much worse the result may get."""
    unit: str = ""
    """Of `difference` and `bound`: dB, or colour for a display colour 0 … 1."""
    clock: str = ""
    """What `seconds_saved` are seconds of."""
    verdict: str = ""
    """within its bound, costs more or inconclusive."""


class CellRecord(Record, frozen=True):
    """scene × method × seed: everything needed to reproduce it and to plot it."""

    scene: str
    method: str
    seed: int
    status: Status
    reason: str | None
    """Why the status is not `done`: for `diverged` the step and the tensor."""
    steps: int
    train_seconds: float
    scores: dict[str, float | None]
    """Means over the test views: psnr ssim flip delta_e rmse_linear depth_rmse opacity_iou psnr_train psnr_ceiling,
    and psnr_floor, the score of copying the nearest training view."""
    curve: list[Checkpoint]
    views: list[ViewScore]
    trace: dict[str, list[float | None]]
    """Equally long lists over training: step, loss, gradient_norm (before clipping), clipped_norm (of what the
    optimiser got; runs recorded before it was noted have none), alpha, beta, samples_per_ray."""
    parameters: dict[str, int]
    """Weights by component: density_net, density_head, colour_net, amplifier, total."""
    properties: dict[str, int | float | str | None]
    """Measured properties: chunk_max_difference, chunk_rms_difference (same view in small and in whole chunks),
    largest_density (per half of the longest side of the scene's box), opacity_unit_slab (of that length of it),
    occupied_share, clipped_share (of the steps, of which the gradient was clipped), …"""
    warnings: list[str]
    """States that a reader must know: empty collapse, billboard (train far above test), below the floor."""
    settings: dict[str, Any]
    provenance: dict[str, Any]
    pictures: str | None = None
    """The renders that were kept (`harness.records.pictures`), a path relative to `OUT/records`; None where there are
    none, or the run was recorded before they were kept like this."""
    files: dict[str, str] = field(default_factory=dict)
    """Every further file of the cell, a path relative to OUT → its SHA-256 (`with_files`)."""
    schema: int = SCHEMA


class SceneRecord(Record, frozen=True):
    """What a view set was, as far as a reader needs it."""

    name: str
    title: str
    view_set: str
    width: int
    height: int
    views: dict[str, int]
    """Number of views by split: train, val, test."""
    near: float
    far: float
    bounds: list[list[float]]
    """[[x, y, z], [x, y, z]]: lower and upper corner of the scene's box."""
    psnr_ceiling: float | None
    """PSNR between the ground truth and a noiseless one, from its own variance."""
    psnr_floor: float | None
    """PSNR of copying the nearest training view."""
    rendered: dict[str, Any]
    """How: variant, spp, seconds, integrator, versions; empty for a view set from elsewhere."""
    left_out: list[LeftOut]


class RunRecord(Record, frozen=True):
    """The run as a whole."""

    profile: str
    command: str
    scenes: list[SceneRecord]
    methods: dict[str, str]
    """Method name → what it is, in one line, in table order; others stand against `nerf`, else the first."""
    deviations: list[str]
    """Where what was run departs from the paper's printed text, and why; one sentence each."""
    paper: dict[str, Any]
    """Printed numbers: table2 {scene: {nerf, qnerf}}, table3, table4, table1 {component: weights}."""
    seeds: list[int]
    settings: dict[str, Any]
    provenance: dict[str, Any]
    phases: dict[str, float]
    """Wall seconds by phase: render, train, verify, serve, total; of a run that was gone on with the sums, without what
    a process that was killed had not yet written."""
    finished: bool
    not_tested: list[str]
    """What a reader might expect and this run did not do; one sentence each."""
    schema: int = SCHEMA

    @property
    def main_methods(self) -> list[str]:
        """Methods that were planned on every scene; the others explain a result on one of them."""
        planned = self.settings.get("methods")
        return [name for name in self.methods if not isinstance(planned, list) or name in planned]


def records_folder(out: Path) -> Path:
    return out / "records"


def cell_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return records_folder(out) / "cells" / f"{scene}.{method}.{seed}.json"


def write_cell(out: Path, cell: CellRecord) -> None:
    write_record(cell_path(out, cell.scene, cell.method, cell.seed), cell)


def checkpoint_name(scene: str, method: str, seed: int) -> str:
    """The file of a cell's weights, relative to OUT."""
    return f"checkpoints/{scene}.{method}.{seed}.safetensors"


def with_files(out: Path, cell: CellRecord) -> CellRecord:
    """The record with the digests of what else its cell left: weights and pictures. Raises `OSError`."""
    names = [checkpoint_name(cell.scene, cell.method, cell.seed)] if cell.status == "done" else []
    names += [f"records/{cell.pictures}"] if cell.pictures else []
    return replace(cell, files={name: file_digest(out / name) for name in names if (out / name).is_file()})


def write_run(out: Path, run: RunRecord) -> None:
    write_record(records_folder(out) / "run.json", run)


def write_comparisons(out: Path, comparisons: list[Comparison]) -> None:
    write_record(records_folder(out) / "comparisons.json", Comparisons(comparisons))


def read_cell(path: Path) -> CellRecord:
    return read_record(path, CellRecord, SCHEMA, formerly=("images",))


def read_cells(out: Path) -> Iterator[CellRecord]:
    """Every finished cell, in the order of file names."""
    yield from map(read_cell, cell_files(out))


def read_cells_of(out: Path, keys: Iterable[tuple[str, str, int]]) -> Iterator[CellRecord]:
    """Those of `keys` (scene, method, seed) that are finished, whatever else lies beside them."""
    return (read_cell(path) for key in keys if (path := cell_path(out, *key)).exists())


def cell_files(out: Path) -> list[Path]:
    """Sorted; without hidden ones, which the system of a disk's other users may leave beside each file."""
    found = (records_folder(out) / "cells").glob("*.json")
    return sorted(path for path in found if not path.name.startswith("."))


def read_run(out: Path) -> RunRecord:
    path = records_folder(out) / "run.json"
    run = read_record(path, RunRecord, SCHEMA)
    try:
        as_promised(run.paper, PaperTables)
    except ValueError as error:
        raise DamagedRecord(f"{path}: paper: {error}; {REMEDY}") from error
    for scene, row in (run.paper.get("table2") or {}).items():
        if not {"nerf", "qnerf"} <= set(row):
            raise DamagedRecord(f"{path}: paper.table2.{scene} lacks nerf or qnerf; {REMEDY}")
    return run


def read_comparisons(out: Path) -> list[Comparison]:
    path = records_folder(out) / "comparisons.json"
    return read_record(path, Comparisons, None).rows if path.exists() else []


def unscored(scene: str, method: str, seed: int, status: Status, reason: str) -> CellRecord:
    """A record without a step, a score or a weight, that says why."""
    return CellRecord(
        scene=scene,
        method=method,
        seed=seed,
        status=status,
        reason=reason,
        steps=0,
        train_seconds=0.0,
        scores={},
        curve=[],
        views=[],
        trace={},
        parameters={},
        properties={},
        warnings=[],
        settings={},
        provenance={},
    )
