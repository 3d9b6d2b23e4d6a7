"""Questions 4 and 7: a view of the paper's network, and ground truth by each of Mitsuba's variants."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from baselines.contract import NO_ACCELERATION
from harness.execution.ground_truth import sizes_of
from harness.plan.settings import ViewSettings
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    SpeedContext,
    figure,
    interleaved,
    new_trainer,
    no_figure,
    paper_settings,
    ratio,
    reduced_plan,
    views_of,
)
from harness.training.lockstep import box_of
from harness.training.scoring.evaluate import cameras_of, render_view
from scenes.files.errors import InputError
from scenes.rendering.variant import VARIANTS, Variant, choose_variant


def rendering(context: SpeedContext) -> Iterator[Check]:
    """Time the paper's network with every sample evaluated; question 11 times the reduced profile."""
    views, plan, paper = views_of(context), reduced_plan(context), paper_settings(context)
    cameras, box = cameras_of(views, views.test, context.device), box_of(views, context.device)
    plain = replace(paper, precision="float32", accelerations=NO_ACCELERATION)
    show = partial(render_view, cameras=cameras, view=len(cameras) // 2, chunk=plan.score.chunk)
    sides = {
        "on": partial(show, new_trainer(context, paper, box)),
        "off": partial(show, new_trainer(context, plain, box)),
    }
    seconds = interleaved(sides, context.repeats(3), context.synchronise)
    a_view = f"A view of {cameras.width} × {cameras.height}"
    detail = f"{paper.network.depth} × {paper.network.width}, {paper.bins} samples per ray, all evaluated"
    title = f"{a_view}, paper's network, {paper.precision} against float32 without accelerations"
    yield ratio("rendering.paper", title, seconds["off"], seconds["on"], detail)
    yield figure("rendering.paper.seconds", f"{a_view}, paper's network", seconds["on"], "s", detail)


SCENES = ("lego", "hotdog")
REFERENCE = "scalar_rgb"


def ground_truth(context: SpeedContext) -> Iterator[Check]:
    """Time megasamples without the first view of each process, which loads and compiles."""
    resolution, count, spp = (16, 3, 4) if context.quick else (100, 7, 64)
    views = ViewSettings(resolution, train=count, val=0, test=0, spp_train=spp, spp_test=spp)
    usable: list[Variant] = []
    for name in VARIANTS:
        try:
            usable.append(choose_variant(name))
        except InputError as refusal:
            yield no_figure(f"render.{name}.seconds", f"Ground truth, {name}", "s/megasample", str(refusal))
    detail = f"{count} views of {resolution} px, {spp} samples per pixel, geometry included"
    for scene in SCENES[:1] if context.quick else SCENES:
        taken: dict[str, list[float]] = {variant.name: [] for variant in usable}
        for repetition in range(1 if context.quick else 3):
            for variant in usable:
                cache = context.scratch / f"rendered-{scene}-{variant.name}-{repetition}"
                taken[variant.name].append(seconds_per_view(scene, views, variant, cache) / (resolution**2 * spp / 1e6))
                shutil.rmtree(cache, ignore_errors=True)
        for name, seconds in taken.items():
            id, title = f"render.{scene}.{name}", f"Ground truth of {scene}, {name}"
            yield figure(f"{id}.seconds", title, seconds, "s/megasample", detail)
            if name != REFERENCE:
                yield ratio(id, f"{title} against {REFERENCE}", taken[REFERENCE], seconds, detail)


def seconds_per_view(scene: str, views: ViewSettings, variant: Variant, cache: Path) -> float:
    """Return the mean seconds of the views after the first. Raises `RuntimeError` if the renderer fails."""
    words = [*sizes_of(views), "--variant", variant.name, "--view-sets", str(cache)]
    command = [sys.executable, "-m", "scenes", "render", scene, *words]
    environment = {**os.environ, **variant.environment()}
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True, env=environment) as process,
    ):
        assert process.stdout is not None
        try:
            moments = [time.perf_counter() for line in process.stdout if json.loads(line).get("done")]
            code = process.wait()
        finally:
            process.kill()
        complaints.seek(0)
        if code or len(moments) < 2:
            told = complaints.read().strip()[-500:]
            raise RuntimeError(f"rendering {scene} with {variant.name} ended with {code}: {told}")
    return (moments[-1] - moments[0]) / (len(moments) - 1)
