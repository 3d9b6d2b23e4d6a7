"""Question 7: how fast each variant of Mitsuba that works here renders ground truth, each in a process of its own."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.speed.situation import Situation
from harness.speed.timing import measured, not_measured, quotients
from harness.speed_record import Measurement
from scenes.errors import InputError
from scenes.variant import VARIANTS, Variant, choose_variant

ITEM = 7
SCENES = ("lego", "hotdog")
REFERENCE = "scalar_rgb"


@dataclass(frozen=True)
class Order:
    """What is rendered: a few training views."""

    resolution: int
    views: int
    spp: int

    @property
    def megasamples_a_view(self) -> float:
        return self.resolution**2 * self.spp / 1e6


def measure(situation: Situation) -> Iterator[Measurement]:
    """Seconds a megasample in the steady state: without the first view of each process, which loads and compiles."""
    order = Order(16, 3, 4) if situation.quick else Order(100, 7, 64)
    scenes = SCENES[:1] if situation.quick else SCENES
    usable: list[Variant] = []
    for name in VARIANTS:
        try:
            usable.append(choose_variant(name))
        except InputError as refusal:
            yield not_measured(f"render.{name}.seconds", ITEM, f"Ground truth, {name}", "s/megasample", str(refusal))
    repeats = 1 if situation.quick else 3
    for scene in scenes:
        taken: dict[str, list[float]] = {variant.name: [] for variant in usable}
        for repetition in range(repeats):
            for variant in usable:
                cache = situation.scratch / f"rendered-{scene}-{variant.name}-{repetition}"
                steady = seconds_a_view(scene, order, variant, cache)
                taken[variant.name].append(steady / order.megasamples_a_view)
                shutil.rmtree(cache, ignore_errors=True)
        detail = f"{order.views} views of {order.resolution} px, {order.spp} samples a pixel, geometry included"
        for variant in usable:
            yield measured(
                f"render.{scene}.{variant.name}.seconds",
                ITEM,
                f"Ground truth of {scene}, {variant.name}",
                taken[variant.name],
                "s/megasample",
                detail=detail,
            )
            if variant.name != REFERENCE:
                yield measured(
                    f"render.{scene}.{variant.name}.ratio",
                    ITEM,
                    f"Ground truth of {scene}, {variant.name} against {REFERENCE}",
                    quotients(taken[REFERENCE], taken[variant.name]),
                    "×",
                    detail=detail,
                )


def seconds_a_view(scene: str, order: Order, variant: Variant, cache: Path) -> float:
    """Mean seconds of the views after the first, as the renderer reports them on its way.

    Raises `RuntimeError` with what it said where it fails.
    """
    options = {
        "resolution": order.resolution,
        "train": order.views,
        "val": 0,
        "test": 0,
        "spp-train": order.spp,
        "spp-test": order.spp,
        "variant": variant.name,
        "view-sets": cache,
    }
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    process = subprocess.Popen(
        [sys.executable, "-m", "scenes", "render", scene, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **variant.environment()},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    moments: list[float] = []
    try:
        for line in process.stdout:
            if json.loads(line).get("done"):
                moments.append(time.perf_counter())
        said = process.stderr.read()
        code = process.wait()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        process.stdout.close()
        process.stderr.close()
    if code or len(moments) < 2:
        raise RuntimeError(f"rendering {scene} with {variant.name} ended with {code}: {said.strip()[-500:]}")
    return (moments[-1] - moments[0]) / (len(moments) - 1)
