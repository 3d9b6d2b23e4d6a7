"""One cell in training: it steps, scores at checkpoints, is saved in snapshots, and ends in a record."""

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import nn

from baselines.field import NetworkField
from harness.machine.peak_memory import peak_bytes, peak_gpu_bytes
from harness.machine.provenance import CHECKED, PROGRAM
from harness.machine.stopwatch import Stopwatch
from harness.plan.group_task import GroupTask
from harness.plan.plugins import origins
from harness.plan.schedule import checkpoint_fractions
from harness.records.cells import CellRecord, Checkpoint, Status, ViewScore, cell_path, read_cell
from harness.records.json_record import as_promised, finite_or_none, plain
from harness.records.metric_table import METRICS
from harness.records.pictures import RENDER, Render
from harness.records.snapshot import Unfinished, read_unfinished, unfinished_path, write_unfinished
from harness.training.batches import Batch
from harness.training.checkpoints import checkpoint_path, restore_training, save_checkpoint, training_state
from harness.training.learner import Learner, take_turn, turns_of, warm_up
from harness.training.saved_renders import KeptRenders
from harness.training.scoring import evaluate
from harness.training.scoring.amplifier_effect import amplifier_effect
from harness.training.scoring.densities import density_properties
from harness.training.scoring.lpips import lpips_of
from harness.training.shared_state import left_as_it_was
from harness.training.trainer import Diverged
from scenes.files.errors import DamagedRecord, InputError, named
from scenes.files.json_object import JsonObject
from scenes.rendering.occupancy import read_occupancy
from scenes.view_sets.view_set import ViewSet
from scenes.view_sets.viewpoints import evenly_spread

CORNERS = 8
"""The number of voxels between which a point is interpolated."""


def flops_per_evaluation(field: object) -> int | None:
    """Count the operations of density and colour at one point: of a network with its encoder, or of voxels, which
    interpolate one density and the coefficients of three colours; None for any other field.
    """
    if isinstance(field, nn.Module):
        layers = [layer for layer in field.modules() if isinstance(layer, nn.Linear)]
        encoder: int = getattr(getattr(field, "encoder", None), "operations", 0)
        return encoder + 2 * sum(layer.in_features * layer.out_features for layer in layers) or None
    coefficients: int | None = getattr(field, "coefficients", None)
    if coefficients is None:
        return None
    return 2 * CORNERS * (1 + 3 * coefficients) + (2 * 3 * coefficients if coefficients > 1 else 0)


def content_of(views: ViewSet) -> str | None:
    """Return the digest of a view set: of its manifest, else of the images that were read."""
    return views.rendered.get("digest") or views.content


SAME = 1e-6
"""The relative tolerance: values computed from cameras may differ in their last bits between processors."""


def view_set_facts(views: ViewSet) -> dict[str, object]:
    return {
        "name": views.path.resolve().name,
        "digest": views.rendered.get("digest"),
        "content": views.content,
        "width": views.width,
        "height": views.height,
        "focal": views.focal,
        "near": views.near,
        "far": views.far,
        "train": len(views.train.names),
        "test": len(views.test.names),
        "bounds": views.bounds.tolist(),
    }


def finished_on(out: Path, keys: Iterable[tuple[str, str, int]], views: ViewSet) -> int:
    """Count the finished cells of `keys` (scene, method, seed). Raises `InputError` if a cell was not trained on
    `views` (facts that an earlier version did not record count as equal), and `DamagedRecord`.
    """
    now = view_set_facts(views)
    finished = 0
    for key in keys:
        path = cell_path(out, *key)
        if not path.exists():
            continue
        finished += 1
        before = read_cell(path).settings.get("view_set") or {}
        # a folder may be moved: its contents count
        known = [name for name in now if name != "name" and None not in (before.get(name), now[name])]
        if changed := [name for name in known if not _same(before[name], now[name])]:
            what = "; ".join(f"{name} was {_short(before[name])}, is {_short(now[name])}" for name in changed)
            raise InputError(
                f"--resume: {views.path}: not the view set that {path.stem} was trained on ({what}); restore that view "
                "set, or name a fresh --out"
            )
    return finished


def _same(before: object, now: object) -> bool:
    if isinstance(before, list) and isinstance(now, list):
        return len(before) == len(now) and all(map(_same, before, now))
    if isinstance(before, int | float) and isinstance(now, int | float):
        return math.isclose(before, now, rel_tol=SAME, abs_tol=SAME)
    return bool(before == now)


def _short(value: object) -> object:
    return f"{value[:12]}…" if isinstance(value, str) and len(value) > 12 else value


COLLAPSED_OPACITY = 0.02
"""The mean test opacity below which a method has learnt only the background."""
COLLAPSED_SHARE = 0.1
"""The share of the true opacity that a method in empty collapse does not reach: thin geometry is no collapse."""
BILLBOARD_GAP_DB = 6.0
"""The gap between training and test views from which images count as painted in front of the cameras, if test views
also score below a copy of the nearest training view.
"""
FLAGGED_GAP_DB = 3.0
"""The gap between training and test views from which a warning says so."""
REFERENCE_LIMITED_DB = 1.0
"""The distance to the ceiling below which a score depends more on the ground truth's noise than on the method."""


class IncompatibleSnapshot(Exception):
    """A snapshot of this cell from which it cannot resume; the message says why."""


@dataclass(eq=False)
class CellTraining:
    """One method of a group, from its first step to its record."""

    trainer: Learner
    batch_at: Callable[[int], Batch]
    views: ViewSet
    task: GroupTask
    provenance: JsonObject
    floor: float | None

    def __post_init__(self) -> None:
        views, score = self.views, self.task.score
        self.test = evaluate.cameras_of(views, views.test, self.trainer.device)
        self.due = checkpoint_fractions(score.checkpoints, score.earliest)
        self.curve: list[Checkpoint] = []
        poses = views.test.camera_to_world
        self.on_curve: list[int] = evenly_spread(score.on_curve(len(poses)), poses).tolist()
        """The test views of which the curve is the mean."""
        self.kept = KeptRenders.of(views.test, score.stored_views, self.task.seed, score.checkpoints)
        self.occupied = read_occupancy(views)
        self.lpips = None if self.task.lpips is None else lpips_of(self.task.lpips)
        self.ended = False
        self.resumed_at: list[int] = []
        """The steps at which another process resumed it."""
        self.can_be_kept = True

    @property
    def progress(self) -> float:
        return 1.0 if self.ended else self.trainer.progress

    def warm_up(self) -> CellRecord | None:
        """Run everything that precedes the clock. Return the record if the cell ends here."""
        try:
            with left_as_it_was():
                warm_up(self.trainer, self.batch_at)
        except (Exception, SystemExit) as error:
            return self._failed(error, "before the first step")
        return None

    @property
    def snapshot(self) -> Path:
        return unfinished_path(self.task.out, self.task.scene, self.trainer.method, self.task.seed)

    @property
    def name(self) -> str:
        return f"{self.task.scene}, {self.trainer.method}, seed {self.task.seed}"

    def keep(self) -> str | None:
        """Write a snapshot; if the state cannot be stored, return the reason once. Raises `OSError` naming the file."""
        if not self.can_be_kept:
            return None
        try:
            training = training_state(self.trainer)
            renders = {
                f"render.{place}.{name}": getattr(render, name)
                for place, render in enumerate(self.kept.renders)
                for name in RENDER
            }
            listing = {
                "made_with": self._made_with(),
                "resumed_at": self.resumed_at,
                "due": len(self.due),
                "curve": plain(self.curve),
                "renders": [[render.view, render.step] for render in self.kept.renders],
            }
            write_unfinished(self.snapshot, Unfinished(training.listing | listing, training.tensors | renders))
        except OSError:
            raise
        except Exception as error:
            # a user's method may have state that a snapshot cannot store; its training continues
            self.can_be_kept = False
            return f"{self.name}: no snapshot can be written in the middle of its training ({named(error, 200)})"
        return None

    def resume(self) -> str | None:
        """Resume from a snapshot of the same code on the same kind of processor, if there is one; return a note for the
        reader. Raises `IncompatibleSnapshot` if parts were already restored, so that this cell is unusable.
        """
        if not self.snapshot.exists():
            return None
        try:
            kept = read_unfinished(self.snapshot)
            before, now = dict(kept.listing["made_with"]), self._made_with()
        except (DamagedRecord, KeyError, TypeError, ValueError):
            return f"{self.name}: trained from the start, as its snapshot is damaged"
        if changed := [key for key, value in now.items() if before.get(key) != value]:
            return f"{self.name}: trained from the start, as {changed[0]} changed since its snapshot"
        try:
            restore_training(self.trainer, kept)
            listing, arrays = kept.listing, kept.under("render")
            if not 0 < listing["due"] <= len(self.due):
                raise ValueError(f"{listing['due']} checkpoints to come of {len(self.due)}")
            self.due = self.due[len(self.due) - listing["due"] :]
            self.curve = as_promised(listing["curve"], list[Checkpoint])
            self.kept.renders = [
                Render(view, step, **{part: arrays[f"{place}.{part}"] for part in RENDER})
                for place, (view, step) in enumerate(listing["renders"])
            ]
            self.resumed_at = [*listing["resumed_at"], self.trainer.step]
        except Exception as error:
            raise IncompatibleSnapshot(
                f"{self.name}: trained from the start, as its snapshot is not compatible ({named(error, 200)})"
            ) from error
        return f"{self.name}: resumes at step {self.trainer.step}"

    def _made_with(self) -> dict[str, object]:
        """Return, as JSON, all that its next steps depend on except the trained state."""
        place = ("processor", "threads", "device", "torch_build", "bfloat16_products")
        packages = self.provenance.get("packages", {})
        facts = {
            "Python": self.provenance.get("python"),
            PROGRAM: self.provenance.get("sources"),
            **{name: packages.get(name) for name in CHECKED},
            **{key: self.provenance.get(key) for key in place},
            "package": origins([self.trainer.method]),
            "settings": self.task.settings(self.trainer.method),
            "view set": {key: value for key, value in view_set_facts(self.views).items() if key != "name"},
        }
        return dict(json.loads(json.dumps(facts)))

    def advance(self) -> CellRecord | None:
        """Take one step and score if a checkpoint is due. Return the record when the cell has ended."""
        try:
            with left_as_it_was():
                take_turn(self.trainer, self.batch_at, self.due[0])
                if self.trainer.progress < self.due[0]:
                    return None
                self.due = [share for share in self.due if self.trainer.progress < share]
                with self.trainer.averaged():
                    return self._scored()
        except OSError:
            raise
        except (Exception, SystemExit) as error:
            # an error, also of a user's method, ends only its own cell
            return self._failed(error, f"at step {self.trainer.step}")

    def _scored(self) -> CellRecord | None:
        """Score a checkpoint. Return the record if it is the last."""
        drawing, test = Stopwatch(self.trainer.device), self.views.test
        shown = self.on_curve if self.due else list(range(len(test.names)))
        rendered = drawing.counting(evaluate.render_split(self.trainer, self.test, self.task.score.chunk, shown))
        images = self.kept.passing(zip(shown, rendered, strict=True), self.trainer.step, last=not self.due)
        rows: list[ViewScore] = []
        opacities: list[tuple[float, float]] = []
        angles: list[float | None] = []
        for index, image in images:  # one view is in memory at a time
            rows.append(evaluate.view_scores(image, test, index, lpips=self.lpips))
            opacities.append((float(image.opacity.mean()), float(test.rgba[index][..., 3].mean())))
            if not self.due:
                angles.append(evaluate.normal_error(self.trainer, image, self.test, test, index))
        scores = evaluate.mean_scores(rows)
        if self.trainer.step:  # Gaussians that are given have no curve
            of_curve = [row for index, row in zip(shown, rows, strict=True) if index in self.on_curve]
            self.curve.append(self._checkpoint(evaluate.mean_scores(of_curve)))
        if self.due:
            return None
        opacity, true_opacity = np.mean(opacities, axis=0).tolist()
        return self._finished(scores, rows, (opacity, true_opacity), evaluate.mean_of(angles), drawing)

    def _failed(self, error: BaseException, when: str) -> CellRecord:
        if isinstance(error, Diverged):
            return self._record("diverged", str(error), {}, [], {})
        return self._record("error", f"{type(error).__name__} {when}: {error}", {}, [], {})

    def _checkpoint(self, scores: dict[str, float | None]) -> Checkpoint:
        trainer = self.trainer
        return Checkpoint(
            step=trainer.step,
            seconds=trainer.clock.seconds,
            core_seconds=trainer.clock.core_seconds,
            network_evaluations=trainer.network_evaluations,
            density=evaluate.density_histogram(trainer, self.occupied),
            dead_units=trainer.field.dead_units() if isinstance(trainer.field, NetworkField) else None,
            **{name: finite_or_none(scores[name]) for name in METRICS},
            **trainer.amplifier_scalars(),
        )

    def _finished(
        self,
        scores: dict[str, float | None],
        rows: list[ViewScore],
        opacity: tuple[float, float],
        normal_error: float | None,
        drawing: Stopwatch,
    ) -> CellRecord:
        trainer, score = self.trainer, self.task.score
        fitted = evaluate.train_psnr(trainer, self.views, score.train_views, score.chunk)
        scores = {**scores, "psnr_train": fitted, "psnr_floor": self.floor}
        weights = checkpoint_path(self.task.out, self.task.scene, trainer.method, self.task.seed)
        save_checkpoint(trainer, weights)
        properties = evaluate.measured_properties(trainer, self.test)
        properties |= density_properties(trainer, self.views, self.test)
        properties["normal_error"] = normal_error
        scored = [row.psnr for row in rows]
        properties |= amplifier_effect(trainer, self.test, self.views.test, scored, score.chunk)
        properties["clipped_share"] = trainer.clipping.clipped_steps / max(trainer.step, 1)
        costs = {
            "view_seconds": drawing.seconds / len(rows),
            "view_core_seconds": drawing.core_seconds / len(rows),
            "weights_bytes": weights.stat().st_size,
            "memory_bytes": peak_bytes(),
            "gpu_memory_bytes": peak_gpu_bytes(trainer.device),
        }
        known = {name: float(amount) for name, amount in costs.items() if amount is not None}
        return self._record("done", None, scores, rows, properties, opacity, known)

    def _record(
        self,
        status: Status,
        reason: str | None,
        scores: dict[str, float | None],
        rows: list[ViewScore],
        properties: dict[str, float | str | None],
        opacity: tuple[float, float] | None = None,
        costs: dict[str, float] | None = None,
    ) -> CellRecord:
        trainer, task = self.trainer, self.task
        self.ended = True
        if (turns := turns_of(trainer)) is not None:
            turns.release()
        return CellRecord(
            scene=task.scene,
            method=trainer.method,
            seed=task.seed,
            status=status,
            reason=reason,
            steps=trainer.step,
            train_seconds=trainer.clock.seconds,
            train_core_seconds=trainer.clock.core_seconds,
            scores=scores,
            curve=self.curve,
            views=rows,
            trace=trainer.trace,
            parameters=trainer.field.parameter_counts(),
            properties={
                **properties,
                **(turns.properties() if turns is not None else {}),
                "flops_per_evaluation": flops_per_evaluation(trainer.field),
                "rays_per_step": task.train.rays,
            },
            warnings=warnings_of(scores, opacity, trainer.grid is not None and trainer.grid.emptied),
            pictures=self.kept.write(task.out, task.scene, trainer.method, task.seed),
            costs=costs or {},
            settings={**task.settings(trainer.method), "view_set": view_set_facts(self.views)},
            # the other methods of the group change no bit of this cell: after an interruption they may differ
            provenance={**self.provenance, "in_lockstep": list(task.methods)}
            | ({"resumed_at": self.resumed_at} if self.resumed_at else {})
            | ({"lpips": self.lpips.digest, "lpips_network": self.lpips.network} if self.lpips else {}),
        )


def warnings_of(scores: dict[str, float | None], opacity: tuple[float, float] | None, grid_emptied: bool) -> list[str]:
    """Return sentences about states that a reader of the scores must know. `opacity` is the mean over test views, as
    rendered and in truth.
    """
    warnings = []
    psnr, floor, train, ceiling = (scores.get(f"psnr{name}") for name in ("", "_floor", "_train", "_ceiling"))
    if opacity is not None and opacity[0] < min(COLLAPSED_OPACITY, COLLAPSED_SHARE * opacity[1]):
        words = f"empty collapse: mean test opacity {opacity[0]:.3f}, in truth {opacity[1]:.3f}"
        warnings.append(f"{words}; the method shows little but background")
    if grid_emptied:
        warnings.append("the occupancy grid found no geometry at its last refresh; no cell was skipped from then on")
    if psnr is not None and floor is not None and psnr < floor:
        warnings.append(f"below the floor: {psnr:.2f} dB, copying the nearest training view gives {floor:.2f} dB")
    if psnr is not None and train is not None and train - psnr > FLAGGED_GAP_DB:
        painted = train - psnr > BILLBOARD_GAP_DB and (floor is None or psnr < floor)
        name = "billboard" if painted else "gap"
        warnings.append(f"{name}: training views {train:.2f} dB, test views {psnr:.2f} dB")
    if psnr is not None and ceiling is not None and psnr > ceiling - REFERENCE_LIMITED_DB:
        warnings.append(f"reference-limited: {psnr:.2f} dB, an image without noise would have {ceiling:.2f} dB")
    return warnings
