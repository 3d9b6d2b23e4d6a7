"""What a run leaves behind: one JSON file a cell, one for the run, one for its comparisons.

    OUT/records/run.json                         RunRecord: plan, scenes, provenance, wall-clock phases
    OUT/records/cells/<scene>.<method>.<seed>.json   CellRecord
    OUT/records/comparisons.json                 list of Comparison
    OUT/records/targets.json                     TargetsRecord (`harness.targets_record`)
    OUT/records/images/…png                      renders and ground truth that cells refer to

A file is written beside its place and renamed into it, so a killed run leaves whole files or none.
JSON here never holds NaN or Infinity: a number that is not finite is `None`, and a status says why.
This module imports the standard library alone: reports are built without torch and without Mitsuba.
"""

import json
import math
import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal

SCHEMA = 1

Status = Literal["done", "diverged", "error", "not_available"]


class DamagedRecord(ValueError):
    """A record file is not what this version writes: the message names the file, the reason and the remedy."""


@dataclass(frozen=True)
class Checkpoint:
    """One scoring of the whole fixed test set."""

    step: int
    seconds: float
    """Training seconds of this method so far; scoring, warm-up and I/O are not in it."""
    network_evaluations: int
    """Points at which the network was evaluated for training so far."""
    psnr: float | None
    rmse_linear: float | None
    ssim: float | None
    density: dict[str, list[float]] | None = None
    """`edges` [bins + 1], `before` [bins], `after` [bins]: shares of points (sum 1, clipped into the outer bins)
    over the scene's box, of the density entering the amplifier and of the density that is rendered."""
    alpha: float | None = None
    """The amplifier's α and β (Listing 2) where the method has them."""
    beta: float | None = None
    flip: float | None = None
    depth_rmse: float | None = None
    """In scene units; None where the view set has no depth, or the run was recorded before it was scored here."""


@dataclass(frozen=True)
class ViewScore:
    """Scores of one test view at the end of training."""

    view: str
    psnr: float | None
    ssim: float | None
    flip: float | None
    delta_e: float | None
    rmse_linear: float | None
    depth_rmse: float | None
    opacity_iou: float | None
    psnr_ceiling: float | None


@dataclass(frozen=True)
class StoredImage:
    """A test view kept for the report; paths relative to `OUT/records`, display colour over white, 8 bit."""

    view: str
    truth: str
    render: str
    opacity: str
    """Grey image of Σ w."""


@dataclass(frozen=True)
class LeftOut:
    """Something that a scene does not need and that was therefore not done."""

    what: str
    reason: str
    seconds_saved: float | None = None
    """None where it was not measured (`--verify-omissions`), as below."""
    difference: float | None = None
    """dB: test PSNR with it left out less with it done, so that less than 0 is a loss. colour: what changed at most."""
    interval: tuple[float, float] | None = None
    """95 %."""
    name: str = ""
    """Of the need in `scenes.needs`."""
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


@dataclass(frozen=True)
class CellRecord:
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
    properties: dict[str, float | str | None]
    """Measured properties: chunk_max_difference, chunk_rms_difference (same view in small and in whole chunks),
    opacity_unit_slab (largest opacity that one unit of solid matter can reach), occupied_share, clipped_share (of the
    steps, of which the gradient was clipped), …"""
    warnings: list[str]
    """States that a reader must know: empty collapse, billboard (train far above test), below the floor."""
    images: list[StoredImage]
    settings: dict[str, Any]
    provenance: dict[str, Any]
    schema: int = SCHEMA


@dataclass(frozen=True)
class SceneRecord:
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


@dataclass(frozen=True)
class RunRecord:
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
    """Wall seconds by phase: render, train, total."""
    finished: bool
    not_tested: list[str]
    """What a reader might expect and this run did not do; one sentence each."""
    schema: int = SCHEMA


@dataclass(frozen=True)
class Comparison:
    """A paired difference `method` − `against` with its interval."""

    scene: str
    """A scene's name, or `all`."""
    method: str
    against: str
    metric: str
    budget: Literal["steps", "seconds"]
    difference: float | None
    interval: tuple[float, float] | None
    """95 %, paired over seeds (one scene) or over scenes and seeds (all)."""
    verdict: Literal["better", "worse", "equivalent", "inconclusive"]
    smallest_detectable: float | None
    """The smallest true difference that is called better or worse in 80 % of runs with just this spread."""
    pairs: int
    left_aside: int
    """Cells that could not be paired because one of them diverged or failed; never silently dropped."""
    simultaneous: tuple[float, float] | None = None
    """The interval that the verdict is taken from: of the `family`'s, all hold the truth together in 95 %.
    None in runs recorded before families were looked at, whose verdicts are from `interval`."""
    family: int = 1
    """As many comparisons are looked at together (`harness.comparisons.family_of`)."""


def finite_or_none(value: float | None) -> float | None:
    """`value` as a JSON number, or None where it is missing, NaN or infinite."""
    if value is None:
        return None
    number = float(value)
    return number if math.isfinite(number) else None


def write_json(path: Path, data: Any) -> None:
    """Whole or not at all, also under `kill -9`; raises `ValueError` on NaN or Infinity."""
    text = json.dumps(data, indent=1, allow_nan=False, ensure_ascii=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        # a failed write does not say of which file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        beside.unlink(missing_ok=True)


def records_folder(out: Path) -> Path:
    return out / "records"


def cell_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return records_folder(out) / "cells" / f"{scene}.{method}.{seed}.json"


def write_cell(out: Path, cell: CellRecord) -> None:
    write_json(cell_path(out, cell.scene, cell.method, cell.seed), asdict(cell))


def write_run(out: Path, run: RunRecord) -> None:
    write_json(records_folder(out) / "run.json", asdict(run))


def write_comparisons(out: Path, comparisons: list[Comparison]) -> None:
    write_json(records_folder(out) / "comparisons.json", [asdict(one) for one in comparisons])


def read_cell(path: Path) -> CellRecord:
    data = _read(path, CellRecord)
    try:
        data["curve"] = [Checkpoint(**one) for one in data["curve"]]
        data["views"] = [ViewScore(**one) for one in data["views"]]
        data["images"] = [StoredImage(**one) for one in data["images"]]
    except TypeError as error:  # keys missing or unknown further in
        raise _damaged(path, error) from error
    return CellRecord(**data)


def read_cells(out: Path) -> Iterator[CellRecord]:
    """Every finished cell, in the order of file names."""
    for path in sorted((records_folder(out) / "cells").glob("*.json")):
        yield read_cell(path)


def read_run(out: Path) -> RunRecord:
    path = records_folder(out) / "run.json"
    data = _read(path, RunRecord)
    scenes = []
    try:
        for scene in data["scenes"]:
            left_out = [LeftOut(**{**one, "interval": _pair(one["interval"])}) for one in scene["left_out"]]
            scenes.append(SceneRecord(**{**scene, "left_out": left_out}))
    except (TypeError, KeyError) as error:
        raise _damaged(path, error) from error
    return RunRecord(**{**data, "scenes": scenes})


def read_comparisons(out: Path) -> list[Comparison]:
    path = records_folder(out) / "comparisons.json"
    if not path.exists():
        return []
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        pairs = [{name: _pair(row.get(name)) for name in ("interval", "simultaneous")} for row in rows]
        return [Comparison(**{**row, **pair}) for row, pair in zip(rows, pairs, strict=True)]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, why: Exception) -> DamagedRecord:
    return DamagedRecord(f"{path}: {why}; delete it and run again with --resume")


def _pair(value: list[float] | None) -> tuple[float, float] | None:
    return None if value is None else (value[0], value[1])


def _read(path: Path, kind: type) -> dict[str, Any]:
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise _damaged(path, error) from error
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = data.get("schema") if isinstance(data, dict) else type(data).__name__
        raise DamagedRecord(f"{path}: schema {found!r}, this version reads {SCHEMA}; run again into a fresh folder")
    known = {one.name for one in fields(kind)}
    if set(data) != known:
        raise DamagedRecord(
            f"{path}: unexpected or missing keys {sorted(set(data) ^ known)}; delete it and run again with --resume"
        )
    return data
