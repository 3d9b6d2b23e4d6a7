"""All methods of one scene and one seed, trained in turn on the same batches, each on its own clock."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.contract import Box
from harness import evaluate
from harness.batches import Batches
from harness.checkpoints import checkpoint_path, save_checkpoint
from harness.flops import flops_per_evaluation
from harness.learner import Learner, NotAvailable, learner_for
from harness.records import CellRecord, Checkpoint, Status, StoredImage, ViewScore, records_folder
from harness.schedule import Budget, checkpoint_fractions
from harness.settings import ScoreSettings, TrainSettings
from harness.trainer import Diverged
from harness.unscored import unscored
from scenes.errors import InputError
from scenes.images import write_png
from scenes.pixels import over_white
from scenes.view_set import Split, ViewSet

COLLAPSED_OPACITY = 0.02
"""Mean test opacity below which a method has learnt nothing but the background."""
BILLBOARD_GAP_DB = 6.0
"""Training views this much above test views, and these worse than a copy of the nearest training view: the images are
painted in front of the cameras, not in the scene."""
FLAGGED_GAP_DB = 3.0
"""Training views this much above test views: the views are fitted better than what is between them."""
REFERENCE_LIMITED_DB = 1.0
"""Nearer to the ceiling than this, a score says more about the noise of the ground truth than about the method."""


@dataclass(frozen=True)
class GroupSettings:
    """What a group of cells is trained with; the same for every method."""

    methods: tuple[str, ...]
    train: TrainSettings
    score: ScoreSettings
    budget: Budget


def train_group(
    views: ViewSet,
    scene: str,
    seed: int,
    settings: GroupSettings,
    device: torch.device,
    out: Path,
    provenance: dict[str, Any],
    on_progress: Callable[[float], None],
    made_by: Callable[..., Learner] | None = None,
) -> Iterator[CellRecord]:
    """Yields the record of each method as soon as it has ended; one that fails or diverges does not stop the others.

    `on_progress` gets the share of the group's training that is done; `made_by` stands for `learner_for`.
    """
    box = box_of(views, device)
    train_cameras = evaluate.cameras_of(views, views.train, device)
    batches = Batches(train_cameras, views.train.rgba, settings.train.ray_attention)
    stream = stream_of(scene, seed)
    floor = evaluate.floor_psnr(views)
    runners = []
    for method in settings.methods:
        try:
            learner = (made_by or learner_for)(
                method, box, settings.train, settings.budget, stream, device, needs_view_direction(views)
            )
            runner = _Runner(learner, views, scene, seed, settings, out, provenance, floor)
        except NotAvailable as missing:
            yield unscored(scene, method, seed, "not_available", str(missing))
            continue
        except InputError:
            raise
        except Exception as error:
            yield unscored(scene, method, seed, "error", f"{type(error).__name__} before the first step: {error}")
            continue
        failed = runner.warm_up(*batches.batch(stream, 0, settings.train.rays))
        if failed is None:
            runners.append(runner)
        else:
            yield failed
        del learner, runner  # the memory of one that failed is the next one's
    active = list(runners)
    turn = 0
    while active:
        # who goes first changes, so that nobody always finds the caches that another has filled
        order = active[turn % len(active) :] + active[: turn % len(active)]
        for runner in order:
            rays, truth = batches.batch(stream, runner.trainer.step, settings.train.rays)
            record = runner.advance(rays, truth)
            if record is not None:
                active.remove(runner)
                yield record
        turn += 1
        on_progress(sum(min(runner.progress, 1.0) for runner in runners) / len(runners))


@dataclass
class _LastViews:
    """What the record takes from the last rendering of the test views, which are in memory one at a time."""

    test: Split
    stored_views: int
    rows: list[ViewScore] = field(default_factory=list)
    opacities: list[np.floating[Any]] = field(default_factory=list)
    """Mean of each view."""
    kept: dict[int, evaluate.View] = field(default_factory=dict)
    """The few that become pictures, by index."""

    def passing(self, images: Iterable[evaluate.View]) -> Iterator[evaluate.View]:
        """The views themselves, each noted on its way."""
        chosen = np.linspace(0, len(self.test.names) - 1, self.stored_views + 2).round().astype(int)[1:-1].tolist()
        for index, image in enumerate(images):
            self.rows.append(evaluate.view_scores(image, self.test, index))
            self.opacities.append(image.opacity.mean())
            if index in chosen:
                self.kept[index] = image
            yield image


class _Runner:
    """One cell: trains, scores at checkpoints, and ends in a record."""

    def __init__(
        self,
        trainer: Learner,
        views: ViewSet,
        scene: str,
        seed: int,
        settings: GroupSettings,
        out: Path,
        provenance: dict[str, Any],
        floor: float | None,
    ) -> None:
        self.trainer = trainer
        self.views = views
        self.scene = scene
        self.seed = seed
        self.settings = settings
        self.out = out
        self.provenance = provenance
        self.floor = floor
        self.test = evaluate.cameras_of(views, views.test, trainer.device)
        self.due = checkpoint_fractions(settings.score.checkpoints, settings.score.earliest)
        self.curve: list[Checkpoint] = []
        self.ended = False

    @property
    def progress(self) -> float:
        return 1.0 if self.ended else self.trainer.progress

    def warm_up(self, rays: Any, truth: torch.Tensor) -> CellRecord | None:
        """What comes before the clock; the record when the cell ends with it."""
        try:
            self.trainer.warm_up(rays, truth)
        except Diverged as stop:
            return self._stopped("diverged", str(stop))
        except Exception as error:
            return self._stopped("error", f"{type(error).__name__} before the first step: {error}")
        return None

    def advance(self, rays: Any, truth: torch.Tensor) -> CellRecord | None:
        """One step and whatever is due after it; the record when the cell has ended."""
        try:
            self.trainer.train_on(rays, truth)
            if self.trainer.progress < self.due[0]:
                return None
            while self.due and self.trainer.progress >= self.due[0]:
                self.due.pop(0)
            images = evaluate.render_split(self.trainer, self.test, self.settings.score.chunk)
            if self.due:
                self.curve.append(self._checkpoint(images))
                return None
            last = _LastViews(self.views.test, self.settings.score.stored_views)
            self.curve.append(self._checkpoint(last.passing(images)))
            return self._finished(last)
        except Diverged as stop:
            return self._stopped("diverged", str(stop))
        except OSError:
            raise
        except Exception as error:
            # an error of ours costs its own cell, not those that train beside it
            return self._stopped("error", f"{type(error).__name__} at step {self.trainer.step}: {error}")

    def _stopped(self, status: Status, reason: str) -> CellRecord:
        self.ended = True
        return self._record(status, reason, {}, [], {}, [])

    def _checkpoint(self, images: Iterable[evaluate.View]) -> Checkpoint:
        trainer = self.trainer
        scores = evaluate.scores_along(images, self.views.test)
        return Checkpoint(
            step=trainer.step,
            seconds=trainer.clock.seconds,
            network_evaluations=trainer.network_evaluations,
            density=evaluate.density_histogram(trainer),
            **scores,
            **trainer.amplifier_scalars(),
        )

    def _finished(self, last: _LastViews) -> CellRecord:
        trainer, score = self.trainer, self.settings.score
        scores = evaluate.mean_scores(last.rows)
        scores["psnr_train"] = evaluate.train_psnr(trainer, self.views, score.train_views, score.chunk)
        scores["psnr_floor"] = self.floor
        save_checkpoint(trainer, checkpoint_path(self.out, self.scene, trainer.method, self.seed))
        properties = evaluate.measured_properties(trainer, self.test)
        properties["clipped_share"] = trainer.clipping.clipped_steps / trainer.step
        self.ended = True
        stored = [self._store(view, index) for index, view in last.kept.items()]
        opacity = float(np.mean(last.opacities))
        return self._record("done", None, scores, last.rows, properties, stored, opacity)

    def _record(
        self,
        status: Status,
        reason: str | None,
        scores: dict[str, float | None],
        rows: list[ViewScore],
        properties: dict[str, float | str | None],
        images: list[StoredImage],
        mean_opacity: float | None = None,
    ) -> CellRecord:
        trainer = self.trainer
        return CellRecord(
            scene=self.scene,
            method=trainer.method,
            seed=self.seed,
            status=status,
            reason=reason,
            steps=trainer.step,
            train_seconds=trainer.clock.seconds,
            scores=scores,
            curve=self.curve,
            views=rows,
            trace=trainer.trace,
            parameters=trainer.field.parameter_counts(),
            properties={
                **properties,
                "flops_per_evaluation": flops_per_evaluation(trainer.field),
                "rays_per_step": self.settings.train.rays,
            },
            warnings=warnings_of(scores, mean_opacity, trainer.grid is not None and trainer.grid.emptied),
            images=images,
            settings={**asdict(self.settings), "view_set": view_set_facts(self.views)},
            provenance=self.provenance,
        )

    def _store(self, view: evaluate.View, index: int) -> StoredImage:
        name = self.views.test.names[index]
        stem = f"{self.scene}.{self.trainer.method}.{self.seed}.{Path(name).name}"
        folder = records_folder(self.out) / "images"
        folder.mkdir(parents=True, exist_ok=True)

        def write(kind: str, rgb: np.ndarray) -> str:
            opaque = np.ones((*rgb.shape[:2], 1))
            write_png(folder / f"{stem}.{kind}.png", np.concatenate([rgb, opaque], axis=-1).astype(np.float32))
            return f"images/{stem}.{kind}.png"

        return StoredImage(
            view=name,
            truth=write("truth", over_white(self.views.test.rgba[index])),
            render=write("render", np.clip(view.colour, 0.0, 1.0)),
            opacity=write("opacity", np.repeat(np.clip(view.opacity, 0.0, 1.0)[..., None], 3, axis=-1)),
        )


def box_of(views: ViewSet, device: torch.device) -> Box:
    """The box that everything seen lies in."""
    return Box(*(torch.as_tensor(corner, dtype=torch.float32, device=device) for corner in views.bounds))


def stream_of(scene: str, seed: int) -> str:
    """What seeds the random numbers of a cell. With the scene in it, scenes are independent draws, as the statistics
    take them to be; without the method in it, methods are paired.
    """
    return f"{scene}/{seed}"


def needs_view_direction(views: ViewSet) -> bool:
    """False where the scene's own description says that it looks the same from all sides."""
    return needs_view_direction_of([row["what"] for row in views.rendered.get("left_out", [])])


def needs_view_direction_of(left_out: list[str]) -> bool:
    """By what a scene does not need, in words."""
    return "view-direction branch" not in left_out


def view_set_facts(views: ViewSet) -> dict[str, Any]:
    """What tells this view set from another one."""
    return {
        "name": views.path.resolve().name,
        "digest": views.rendered.get("digest"),
        "width": views.width,
        "height": views.height,
        "focal": views.focal,
        "train": len(views.train.names),
        "test": len(views.test.names),
        "bounds": views.bounds.tolist(),
    }


def warnings_of(scores: dict[str, float | None], mean_opacity: float | None, grid_emptied: bool) -> list[str]:
    """States that a reader of the scores must know, in words."""
    found = []
    psnr, floor, train, ceiling = (scores.get(f"psnr{name}") for name in ("", "_floor", "_train", "_ceiling"))
    if mean_opacity is not None and mean_opacity < COLLAPSED_OPACITY:
        found.append(f"empty collapse: mean test opacity {mean_opacity:.3f}, the method shows little but background")
    if grid_emptied:
        found.append("the occupancy grid found no matter at its last refresh; nothing was left out from then on")
    if psnr is not None and floor is not None and psnr < floor:
        found.append(f"below the floor: {psnr:.2f} dB, copying the nearest training view gives {floor:.2f} dB")
    if psnr is not None and train is not None and train - psnr > FLAGGED_GAP_DB:
        painted = train - psnr > BILLBOARD_GAP_DB and (floor is None or psnr < floor)
        name = "billboard" if painted else "gap"
        found.append(f"{name}: training views {train:.2f} dB, test views {psnr:.2f} dB")
    if psnr is not None and ceiling is not None and psnr > ceiling - REFERENCE_LIMITED_DB:
        found.append(f"reference-limited: {psnr:.2f} dB, an image without noise would have {ceiling:.2f} dB")
    return found
