"""The report of `doctor --device`: what a GPU that nobody here has tried does, in one file that its owner can hand in.

It compares the steps of each method with those of the processor, two equal runs with each other, the rate of training
with that of plain torch and of matrix multiplications, and trains cells of the paper's setting for some minutes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch

from baselines.catalog import CATALOG
from baselines.contract import NetworkSize, Precision
from baselines.plain import PlainField, plain_step
from harness.execution.ground_truth import read_views, view_set_folders
from harness.execution.progress import Progress
from harness.machine.device import use_threads
from harness.machine.provenance import provenance
from harness.machine.stopwatch import Stopwatch
from harness.plan.group_task import GroupTask
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, ScoreSettings, TrainSettings, ViewSettings
from harness.studies.drawn_views import write_disc
from harness.studies.speed.speed_context import random_batch, unit_box
from harness.studies.speed.throughput import step_flops
from harness.training.batches import Batch
from harness.training.learner import Job, take_turn
from harness.training.lockstep import train_group
from harness.training.make_learner import learner_for
from harness.training.trainer import Trainer
from scenes.files.json_object import JsonObject

NETWORKS = tuple(name for name, method in CATALOG.items() if method.parts is not None and method.is_field)
SCENE = "lego"
COMPARED_STEPS = 12
"""The steps after which a picture is compared with the processor's: over the first refresh of the grid."""
TOLERATED = 0.1
"""The mean difference of two pictures, relative to what the steps changed: sums in another order give about 0.001."""
CELLS = ("nerf", "nerf_matched", "qnerf", "qnerf_repaired")
SMALL = TrainSettings(
    network=NetworkSize(depth=6, width=32, colour_layers=2, colour_width=32, position_bands=4, direction_bands=2),
    rays=256, bins=16, first_bins=12, fine_bins=8, learning_rate=1e-2, last_learning_rate=1e-3, warm_up_steps=5,
    grid=GridSettings(cells=8, first_step=10, every=5),
)  # fmt: skip
LARGE, LARGE_QUICK = 8192, 256
"""The side of the square matrices whose multiplication is timed."""


@dataclass(frozen=True)
class DeviceContext:
    device: torch.device
    minutes: float
    """The training time of all cells together."""
    view_set: Path | None
    """The posed images to train on; None: a scene of the catalogue is rendered."""
    view_sets: Path
    scratch: Path
    quick: bool
    show: Progress


def sections(context: DeviceContext) -> Iterator[tuple[str, JsonObject]]:
    """Yield the name and the content of each section as soon as it is measured."""
    use_threads(1)
    asked: dict[str, Callable[[DeviceContext], JsonObject]] = {
        "facts": facts,
        "methods": lambda here: {method: against_the_processor(here, method) for method in NETWORKS},
        "bits": equal_runs,
        "rates": rates,
        **({"cells": cells} if context.minutes > 0 else {}),
    }
    for name, measure in asked.items():
        try:
            yield name, measure(context)
        except Exception as error:  # the other sections may still be known
            yield name, {"failed": _told(error)}


def _told(error: BaseException) -> str:
    """Return an error in one line, without the name of a user's folder."""
    text = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return text.replace(str(Path.home()), "~")[:500]


def faults(found: JsonObject) -> list[str]:
    """Return a sentence on everything that a device should do and this one did not."""
    sentences = [f"{name}: {content['failed']}" for name, content in found.items() if "failed" in content]
    known = {name: content for name, content in found.items() if "failed" not in content}
    for method, row in known.get("methods", {}).items():
        if not row["agrees"]:
            sentences.append(f"{method}: {row['why'] or 'its picture differs from that of the processor'}")
    if not known.get("bits", {"equal": True})["equal"]:
        sentences.append("two equal runs have other bits")
    for method in CELLS:
        cell = known.get("cells", {}).get(method, {"status": "done"})
        if cell["status"] != "done":
            sentences.append(f"cell of {method}: {cell['reason']}")
    return sentences


def facts(context: DeviceContext) -> JsonObject:
    memory = None
    if context.device.type == "cuda":
        memory = torch.cuda.get_device_properties(context.device).total_memory
    return {**provenance(context.device), "memory_bytes": memory, "quick": context.quick}


def _batch(device: torch.device, count: int, step: int) -> Batch:
    return random_batch(device, count, "device", step)


def _trained(method: str, device: torch.device, settings: TrainSettings, steps: int) -> Trainer:
    learner = learner_for(Job(method, unit_box(device), settings, Budget(max(steps, 1), None), "device", device))
    assert isinstance(learner, Trainer)
    while learner.step < steps:
        take_turn(learner, lambda step: _batch(device, settings.rays, step))
    return learner


def against_the_processor(context: DeviceContext, method: str) -> JsonObject:
    """Compare pictures before and after a few steps in float32 on both."""
    rays = _batch(torch.device("cpu"), SMALL.rays, -1).rays

    def pictures(device: torch.device) -> list[torch.Tensor]:
        learners = [_trained(method, device, SMALL, steps) for steps in (0, COMPARED_STEPS)]
        return [learner.render(rays.to(device), SMALL.rays).colour.cpu() for learner in learners]

    try:
        (first, later), (first_there, later_there) = pictures(torch.device("cpu")), pictures(context.device)
    except Exception as error:
        return {"agrees": False, "why": _told(error)}
    changed = float((later - first).abs().mean())
    apart = float((later_there - later).abs().mean())
    return {
        "agrees": apart < TOLERATED * changed,
        "why": None,
        "first_apart": float((first_there - first).abs().max()),
        "apart": apart,
        "changed": changed,
    }


def equal_runs(context: DeviceContext) -> JsonObject:
    settings = _paper(context, "bfloat16")
    steps = 4 if context.quick else 200
    first, second = (_trained("qnerf", context.device, settings, steps).fields.state_dict() for _ in range(2))
    largest = max(float((first[name] - second[name]).abs().max()) for name in first)
    return {"equal": largest == 0.0, "largest_difference": largest, "steps": steps}


def _paper(context: DeviceContext, precision: Precision) -> TrainSettings:
    if context.quick:
        return replace(SMALL, grid=GridSettings(cells=0), precision=precision)
    return replace(PROFILES["full"].train, precision=precision)


def rates(context: DeviceContext) -> JsonObject:
    """Time steps of the paper's size in turns, the same number of samples in plain torch, and large multiplications."""
    side = LARGE_QUICK if context.quick else LARGE
    square = torch.randn(side, side, generator=torch.Generator().manual_seed(0)).to(context.device)
    found: JsonObject = {}
    for precision, dtype in (("bfloat16", torch.bfloat16), ("float32", torch.float32)):
        factor = square.to(dtype)
        found[f"matrix_flops.{precision}"] = 2.0 * side**3 / _seconds(context, partial(torch.mm, factor, factor))
    for method, precision in (("nerf", "bfloat16"), ("qnerf", "bfloat16"), ("nerf", "float32")):
        settings = _paper(context, precision)  # type: ignore[arg-type]
        found[f"{method}.{precision}"] = _steps(context, method, settings, found[f"matrix_flops.{precision}"])
    found["plain_torch.bfloat16"] = _plain(context)
    return found


def _steps(context: DeviceContext, method: str, settings: TrainSettings, matrix_flops: float) -> JsonObject:
    learner = _trained(method, context.device, settings, 1)
    learner.budget = Budget(1000, None)
    batch = _batch(context.device, settings.rays, 0)
    take_turn(learner, lambda _: batch)
    before, began = learner.step, learner.clock.seconds
    for _ in range(1 if context.quick else 3):
        take_turn(learner, lambda _: batch)
    each = (learner.clock.seconds - began) / (learner.step - before)
    samples = settings.rays * (2 * settings.bins + settings.fine_bins)
    return {
        "milliseconds": 1e3 * each,
        "samples_per_second": samples / each,
        "share_of_matrix_rate": step_flops(settings.network, samples, settings.rays) / each / matrix_flops,
        **(learner.turns.properties() if learner.turns else {"step_form": "one by one"}),
    }


def _plain(context: DeviceContext) -> JsonObject:
    settings = _paper(context, "bfloat16")
    samples = 2 * settings.bins + settings.fine_bins
    field = PlainField(settings.network, unit_box(context.device), "device").to(context.device)
    optimiser = torch.optim.Adam(field.parameters(), lr=settings.learning_rate, fused=True)
    batch = _batch(context.device, settings.rays, 0)

    def step() -> None:
        with torch.autocast(context.device.type, dtype=torch.bfloat16):
            plain_step(field, optimiser, batch.rays, batch.colours, samples, generator_for("device", "jitter"))

    seconds = _seconds(context, step)
    return {"milliseconds": 1e3 * seconds, "samples_per_second": settings.rays * samples / seconds}


def _seconds(context: DeviceContext, work: Callable[[], object]) -> float:
    """Return the mean seconds of a repetition, after some that do not count."""
    watch = Stopwatch(context.device)
    for _ in range(2):
        work()
    repeats = 2 if context.quick else 20
    with watch.running():
        for _ in range(repeats):
            work()
    return watch.seconds / repeats


def cells(context: DeviceContext) -> JsonObject:
    """Train cells of the paper's setting for the same seconds each, on one scene; return curves and scores."""
    plan = _cell_plan(context)
    views = read_views(_folder(context, plan), plan.views, context.scratch)
    seconds = 60.0 * context.minutes / len(CELLS)
    task = GroupTask(
        scene=SCENE, seed=0, methods=CELLS, train=plan.train, score=plan.score, budget=Budget(None, seconds),
        out=context.scratch / "cells", views=plan.views, device=context.device.type,
    )  # fmt: skip
    found: JsonObject = {"seconds": seconds, "resolution": views.width, "test_views": len(views.test.names)}
    for cell in train_group(task, views, provenance(context.device), lambda share: None):
        found[cell.method] = {
            "status": cell.status,
            "reason": cell.reason and cell.reason.replace(str(Path.home()), "~"),
            "steps": cell.steps,
            "seconds": cell.train_seconds,
            "scores": cell.scores,
            "curve": [{"step": at.step, "seconds": at.seconds, "psnr": at.psnr} for at in cell.curve],
            "properties": cell.properties,
            "settings": cell.settings["train"],
        }
        context.show.line(f"{cell.method}: {cell.status}, {cell.scores.get('psnr')} dB after {cell.steps} steps")
    return found


def _cell_plan(context: DeviceContext) -> Plan:
    plan = replace(PROFILES["full"].without_extras(), scenes=(SCENE,), methods=CELLS, seeds=(0,))
    plan = replace(plan, train=replace(plan.train, own=plan.own_settings(CELLS)))
    score = ScoreSettings(checkpoints=6, earliest=0.02, curve_views=3, train_views=2, stored_views=0)
    views = replace(plan.views, train=40, val=0, test=8, spp_train=64, spp_test=64, ceiling_train_db=34.0)
    plan = replace(plan, score=score, views=views)
    if not context.quick:
        return plan
    small = ViewSettings(resolution=24, train=6, val=0, test=2)
    return replace(plan, train=replace(SMALL, own=plan.train.own), views=small, score=replace(score, chunk=256))


def _folder(context: DeviceContext, plan: Plan) -> Path:
    if context.view_set is not None:
        return context.view_set
    if not context.quick:
        return view_set_folders(plan, context.view_sets, context.show)[SCENE]
    folder = context.scratch / "drawn"
    write_disc(folder, plan.views.resolution, plan.views.train, plan.views.test, seed=0)
    return folder
