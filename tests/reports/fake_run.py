"""A fake run, written by the writers of the records, for testing and developing the reports.

python -m tests.reports.fake_run OUT    writes eight scenes × three methods × three seeds with pictures
"""

import math
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from harness.records.cells import (
    CellRecord,
    Checkpoint,
    Comparison,
    Estimate,
    LeftOut,
    RunRecord,
    SceneRecord,
    ViewScore,
    records_folder,
    write_cell,
    write_comparisons,
    write_run,
)
from harness.records.pictures import (
    Render,
    Truth,
    Turn,
    cell_pictures,
    half,
    truth_pictures,
    write_renders,
    write_truth,
)
from harness.records.verdict import verdict_of
from harness.verdicts.claim_files import known_claims
from reports.data.load import Records, read_records

EIGHT = ("chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship")
METHODS = {
    "nerf": "vanilla NeRF: 2^k encoding, L = 10",
    "nerf_matched": "nerf with the bandwidth of φ: 2^k, L = 7",
    "qnerf": "Listings 1–4, made to run",
}
STEPS = (50, 100, 200, 400, 800, 1600)
GAIN = {"nerf": 0.0, "nerf_matched": 0.9, "qnerf": 0.8}
VIEWS = ("r_12", "r_87")
SLOWNESS = {"nerf": 1.0, "nerf_matched": 0.97, "qnerf": 1.06}
PAPER = replace(
    known_claims()[0],
    measured={
        "weights": {"density_net": 493_056, "density_head": 257, "colour_net": 53_251, "total": 546_566},
        "sloc": 690,
        "sloc_files": {"encoding": 90, "amplifier": 600},
    },
)


def fake_cell(scene: str, place: int, method: str, seed: int) -> CellRecord:
    """Return a finished cell with a plausible curve."""
    slowness = SLOWNESS.get(method, 1.0)
    final = round(23.0 + 0.7 * place + GAIN.get(method, 0.0) + 0.15 * math.sin(7 * seed + 3 * place + len(method)), 3)
    amplified = method == "qnerf"
    curve = []
    for step in STEPS:
        psnr = round(final - 3.2 * (1 - math.log(step / 50) / math.log(32)) ** 1.4, 3)
        point = Checkpoint(
            step, round(step * 0.02 * slowness, 3), step * 16_000, core_seconds=round(step * 0.034 * slowness, 3),
            psnr=psnr, rmse_linear=round(1.3 * 10 ** (-psnr / 20), 5), ssim=round(0.6 + psnr / 100, 4),
            dead_units={"density_net.0": 0.0, "density_net.1": round(step / 6400, 4)},
        )  # fmt: skip
        parts = {"density": _density(step), "alpha": 0.618 + 1e-4 * step, "beta": 1 + 8e-5 * step}
        curve.append(replace(point, **parts) if amplified else point)
    scores = {
        "psnr": final, "ssim": round(0.6 + final / 100, 4), "flip": round(0.4 - final / 100, 4),
        "delta_e": round(12 - final / 4, 3), "rmse_linear": round(1.3 * 10 ** (-final / 20), 5),
        "depth_rmse": round(0.31 + 0.01 * place, 4), "opacity_iou": round(0.97 - 0.004 * place, 4),
        "psnr_train": round(final + 1.1, 3), "psnr_ceiling": 38.0 + 0.5 * place, "psnr_floor": 15.0 + 0.4 * place,
    }  # fmt: skip
    of_view = {"ssim": 0.85, "flip": 0.12, "delta_e": 5.0, "rmse_linear": 0.06, "depth_rmse": 0.3, "opacity_iou": 0.96}
    norms = {"": 0.3, " density_net.0": 0.15, " density_net.1": 0.1}
    views = [
        ViewScore(f"r_{12 + view}", scores["psnr_ceiling"], psnr=round(final + 0.3 * (view - 2), 3), **of_view)
        for view in range(5)
    ]
    trace = {
        "step": [float(step) for step in STEPS],
        "loss": [10 ** (-(point.psnr or 0) / 10) for point in curve],
        "alpha": [point.alpha for point in curve],
        "beta": [point.beta for point in curve],
        "learning_rate": [0.005 * 0.8**k for k in range(len(STEPS))],
        **{f"gradient_norm{layer}": [norm / (1 + k) for k in range(len(STEPS))] for layer, norm in norms.items()},
    }
    weights = {"density_net": 21_000, "colour_net": 3_965, "amplifier": 2 * amplified}
    return CellRecord(
        scene, method, seed, "done", None, STEPS[-1], curve[-1].seconds, scores, curve, views, trace,
        train_core_seconds=curve[-1].core_seconds,
        parameters={**weights, "total": sum(weights.values())},
        properties={"chunk_max_difference": 0.031 * amplified, "largest_density": 1.0 if amplified else 41.5},
        warnings=["billboard: train PSNR 6.2 dB above test"] if scene == "ficus" and seed == 1 else [],
        costs={"view_seconds": 0.0421, "weights_bytes": 101_376.0, "memory_bytes": 0.91e9},
        settings={"steps": STEPS[-1]}, provenance={"threads": 1, "commit": "0123456789ab"},
    )  # fmt: skip


def diverged(cell: CellRecord) -> CellRecord:
    """Return the cell with a NaN in its density after step 400."""
    curve = [point for point in cell.curve if point.step <= 400]
    lost = {"status": "diverged", "reason": "not finite at step 412: density_head.weight", "steps": 412}
    return replace(cell, **lost, scores=dict.fromkeys(cell.scores), curve=curve, views=[])


def _density(step: int) -> dict[str, list[float]]:
    """Return histograms in which a tenth of the points is inside, where density is higher."""
    edges, points = [0.0, *(round(10 ** (-2 + 0.1 * k), 6) for k in range(41))], (3_277.0, 29_491.0)
    before = np.exp(-0.5 * ((np.arange(41) - [[30], [16]]) / (6 + step / 400)) ** 2)
    before /= before.sum(axis=1, keepdims=True)
    after = np.where(np.arange(41) < 21, before, 0.0)
    after[:, 20] += before[:, 21:].sum(axis=1)
    histograms = {"edges": edges, "points": list(points)}
    for side, shares in (("before", before), ("after", after)):
        histograms |= {f"{side}_inside": shares[0].tolist(), f"{side}_outside": shares[1].tolist()}
        histograms[side] = np.average(shares, axis=0, weights=points).tolist()
    return histograms


def fake_comparisons(scenes: list[str], cells: list[CellRecord]) -> list[Comparison]:
    """Return differences of means with fake intervals: the reports must show these, and compute no others."""
    by_key = {(cell.method, cell.scene, cell.seed): cell.scores.get("psnr") for cell in cells}
    duels = (("qnerf", "nerf"), ("qnerf", "nerf_matched"), ("nerf_matched", "nerf"))
    rows = []
    for (budget, loss), duel, scene in product((("steps", 0.0), ("seconds", 0.12)), duels, [*scenes, "all"]):
        keys = [key[1:] for key in by_key if key[0] == duel[0] and scene in (key[1], "all")]
        pairs = [tuple(by_key[method, *key] for method in duel) for key in keys if (duel[1], *key) in by_key]
        both = [a - b for a, b in pairs if a is not None and b is not None]
        if not both:
            continue
        mean = round(sum(both) / len(both) - (loss if duel[0] == "qnerf" else 0), 3)
        half = 0.12 if scene == "all" else 0.3
        low, high = round(mean - half, 3), round(mean + half, 3)
        verdict = verdict_of((low, high), 0.25)
        estimate = Estimate((low, high), (low, high), 1, verdict, 0.4, 4 * mean)
        near = (round(mean - 0.05, 3), round(mean + 0.05, 3))
        several = scene == "all" and len(scenes) > 1
        rows.append(
            Comparison(
                scene, *duel, "psnr", budget, mean, (low, high), verdict, 0.4, len(both), len(pairs) - len(both),
                (low, high), 1, Estimate(near, near, 1, verdict_of(near, 0.25), 0.1, 4 * mean) if several else estimate,
                estimate if several else None,
            )
        )  # fmt: skip
    return rows


def write_pictures(out: Path, cell: CellRecord, place: int, size: int, hdr: bool) -> CellRecord:
    """Write the truth and the pictures of a cell, a striped ball before white; return the cell with its pictures."""
    renders, truths = [], []
    steps = [point.step for point in cell.curve]
    for step in steps if cell.seed == 0 else steps[-1:] if cell.status == "done" else []:
        for number, view in enumerate(VIEWS):
            y, x = np.mgrid[0:size, 0:size] / size - 0.5
            radius = np.hypot(x - 0.05 * number, y)
            inside = np.clip((0.33 - radius) * size / 2, 0, 1)
            covered, stripes = inside[..., None], 0.5 + 0.5 * np.sin(40 * (x + y) + place)
            colour = np.stack([stripes, 0.3 + 0.4 * np.sin(place) ** 2 + 0 * x, 1 - stripes], -1)
            depth = np.where(inside > 0, 4.0 - np.sqrt(np.maximum(0.33**2 - radius**2, 0.0)), 0.0)
            display = colour * covered + 1 - covered
            light = np.where(display > 0.5, 8 * display, display) if hdr else display**2.2
            truths.append(Truth(view, half(display), half(inside), half(light), half(depth)))
            error = 0.06 * (1.2 - GAIN.get(cell.method, 0.0)) * (1 + 0.1 * cell.seed) * (STEPS[-1] / step) ** 0.3
            drawn = display + error * np.sin(90 * x + len(cell.method))[..., None] * covered
            renders.append(Render(view, step, half(drawn), half(inside * (1 - error)), half(depth * (1 - error))))
    if not renders:
        return cell
    path = cell_pictures(cell.scene.replace("/", "_"), cell.method, cell.seed)
    seen = truths[: len(VIEWS)]
    write_renders(records_folder(out) / path, renders, turn_of([render.colour for render in renders[-len(VIEWS) :]]))
    write_truth(records_folder(out) / truth_pictures(cell.scene), seen, turn_of([truth.display for truth in seen]))
    return replace(cell, pictures=path)


def turn_of(pictures: list[np.ndarray]) -> Turn:
    return Turn(list(VIEWS), np.round(255 * np.clip(np.stack(pictures), 0, 1)).astype(np.uint8))


def run_record(scenes: tuple[str, ...], methods: dict[str, str], seeds: int, size: int) -> RunRecord:
    lambertian = LeftOut("view-direction branch", "every surface is Lambertian", 1.25, -0.01, (-0.08, 0.06))
    return RunRecord(
        profile="reduced",
        command="python -m harness run --out out/latest",
        scenes=[
            SceneRecord(
                name=name, title=f"{name.capitalize()}, a procedural analogue", view_set=f"out/view_sets/{name}-{size}",
                width=size, height=size, views={"train": 100, "val": 10, "test": 25}, near=2.0, far=6.0,
                bounds=[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], psnr_ceiling=38.0 + 0.5 * place,
                psnr_floor=15.0 + 0.4 * place, rendered={"variant": "scalar_rgb", "spp": 64, "seconds": 12.5},
                left_out=[lambertian] * (place % 2),
            )
            for place, name in enumerate(scenes)
        ],
        methods=methods,
        deviations=["Listing 4 indexes a 2-D tensor with three indices: repaired.", "Eq. 3 ends in φ^(L−1)."],
        claims=[PAPER],
        seeds=list(range(seeds)),
        settings={
            "profile": "reduced",
            "budget": {"steps": STEPS[-1], "seconds": None},
            "train": {"network": {"depth": 6, "width": 64}, "rays": 2048, "bins": 96, "fine_bins": 0}
            | {"learning_rate": 0.005, "grid": {"cells": 32}},
            "views": {"resolution": size},
        },
        provenance={"commit": "abc1234", "python": "3.11.7", "versions": {"torch": "2.15.0", "mitsuba": "3.9.1"}},
        phases={"render": 100.0, "train": 900.0, "total": 1030.0},
        finished=True,
        not_tested=["800 × 800 pictures and 200 000 steps (profile full).", "LPIPS: it needs downloaded weights."],
    )  # fmt: skip


def write_fake_run(
    out: Path, scenes: tuple[str, ...] = ("chair", "drums"), methods: dict[str, str] = METHODS, seeds: int = 3,
    size: int = 32, pictures: bool = True, with_diverged: bool = True, hdr: tuple[str, ...] = (),
    change: Callable[[RunRecord], RunRecord] = lambda run: run,
    change_cell: Callable[[CellRecord], CellRecord] = lambda cell: cell,
) -> Path:  # fmt: skip
    """Return `out` with the run; its last qnerf cell diverged, the truth of scenes in `hdr` is brighter than white."""
    every = product(enumerate(scenes), methods, range(seeds))
    cells = [fake_cell(scene, place, method, seed) for (place, scene), method, seed in every]
    if with_diverged:
        lost = max(i for i, cell in enumerate(cells) if (cell.scene, cell.method) == (scenes[-1], "qnerf"))
        cells[lost] = diverged(cells[lost])
    if pictures:
        cells = [write_pictures(out, cell, scenes.index(cell.scene), size, cell.scene in hdr) for cell in cells]
    cells = [change_cell(cell) for cell in cells]
    for cell in cells:
        write_cell(out, cell)
    write_run(out, change(run_record(scenes, methods, seeds, size)))
    write_comparisons(out, fake_comparisons(list(scenes), cells))
    return out


def fake_records(out: Path, **options: Any) -> Records:
    """Write a run, without pictures and with every cell finished unless the options say otherwise, and read it."""
    return read_records(write_fake_run(out, **{"pictures": False, "with_diverged": False, **options}))


if __name__ == "__main__":
    write_fake_run(Path(sys.argv[1]), EIGHT, size=100)
