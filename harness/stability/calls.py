"""A2 and C2: does a pixel depend on which other pixels share its call?"""

import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from baselines.amplifiers import Amplifier, CallMeanAmplifier
from baselines.contract import Rays
from baselines.rendering import Sampling, render_rays
from harness import evaluate, metrics
from harness.chart_record import Table
from harness.rays import Cameras
from harness.seeds import generator_for
from harness.stability.situation import Finding, Situation, whose
from harness.stability.small_training import PROBES, new_trainer, not_made_of_parts, setup, trained
from harness.stability_record import Outcome, Picture, judged
from harness.trainer import Trainer
from scenes.images import write_png

BAR = 2e-6
"""Largest difference of a colour; measured 1.8e-7 for methods whose density is that of the point alone."""
EVERYTHING = 1 << 20
"""More rays than a view has: one call."""
PICTURED = {"nerf": "no amplifier", "qnerf": "Listing 2", "qnerf_theorem": "Eq. 4"}
MAGNIFIED = 4


def chunks(situation: Situation) -> Iterator[Finding]:
    """A2: every method of this run, trained, then asked for the same view in many ways."""
    rows: list[list[str | float | None]] = []
    for method in situation.methods:
        if reason := not_made_of_parts(method):
            yield Outcome("A2", method, whose(method), "not_applicable", why=reason)
            continue
        trainer = trained(situation, method).trainer
        found = differences(situation, trainer)
        rows.append([method, *found.values()])
        yield _outcome(method, whose(method), found)
        if not trainer.field.pointwise:
            cured = differences(situation, with_mean_held(trainer), with_reload=False)
            rows.append([f"{method}, mean held", *cured.values(), None])
            yield _outcome(f"{method}, mean held", "ours", cured)
    yield Table(
        "calls", 4, f"The same pixels in other company: largest difference of a colour ({OTHER_POINTS}: of an opacity)",
        ["subject", *WAYS], rows,
    )  # fmt: skip
    for method, reading in PICTURED.items():
        if method in situation.methods:
            yield _picture(situation, method, reading)


def _outcome(subject: str, theirs: str, found: dict[str, float]) -> Outcome:
    worst = max(found, key=lambda way: found[way] if math.isfinite(found[way]) else math.inf)
    what = "a colour (0 … 1), the same pixel" if worst != OTHER_POINTS else "the opacity of a bin, the same point"
    return judged(
        "A2", subject, theirs, found[worst], BAR,  # type: ignore[arg-type]
        what=f"largest difference of {what} in other company", why=f"worst: {worst}",
    )  # fmt: skip


OTHER_POINTS = "other points"
"""The only way in which an opacity is compared, and no colour."""
WAYS = ("calls of 1", "calls of 16", "calls of 256", "shuffled", "padded", OTHER_POINTS, "training mode", "reloaded")


def differences(situation: Situation, trainer: Trainer, with_reload: bool = True) -> dict[str, float]:
    """Way → largest difference of a colour to the whole view in one call, of an opacity at `OTHER_POINTS`; in the order
    of `WAYS`.
    """
    rays = setup(situation).test.all_rays(0)
    whole = trainer.render(rays, EVERYTHING).colour
    few = slice(3 * len(rays) // 8, 3 * len(rays) // 8 + (16 if situation.quick else 256))

    def apart(colour: Tensor, reference: Tensor) -> float:
        return float((colour - reference).abs().max())

    order = torch.randperm(len(rays), generator=generator_for("stability", "order"))
    origins, directions = (torch.cat([one[few], one.flip(0)[:300]]) for one in (rays.origins, rays.directions))
    padded = Rays(origins, directions, rays.near, rays.far)
    found = {
        "calls of 1": apart(trainer.render(rays.part(few.start, few.stop), 1).colour, whole[few]),
        "calls of 16": apart(trainer.render(rays, 16).colour, whole),
        "calls of 256": apart(trainer.render(rays, 256).colour, whole),
        "shuffled": apart(trainer.render(rays.chosen(order), 256).colour, whole[order]),
        "padded": apart(trainer.render(padded, EVERYTHING).colour[: len(whole[few])], whole[few]),
        OTHER_POINTS: opacity_in_other_company(trainer),
        "training mode": recorded_or_not(trainer, rays.part(few.start, few.stop)),
    }
    if with_reload:
        found["reloaded"] = apart(reloaded(situation, trainer).render(rays, EVERYTHING).colour, whole)
    return found


@torch.no_grad()
def opacity_in_other_company(trainer: Trainer) -> float:
    """Largest difference of the opacity of a bin whose density is asked for with evenly spread points, as a coarse
    pass does, and with the densest ones alone, as a fine pass does.
    """
    x = trainer.box.from_unit(torch.rand(PROBES, 3, generator=generator_for("stability", "company")))
    sigma = trainer.field.density(x)
    densest = torch.topk(sigma, len(x) // 8).indices
    bin_length = float((trainer.box.upper - trainer.box.lower).max()) / trainer.settings.bins
    alone = trainer.field.density(x[densest])
    return float((torch.exp(-alone * bin_length) - torch.exp(-sigma[densest] * bin_length)).abs().max())


def recorded_or_not(trainer: Trainer, rays: Rays) -> float:
    """Largest difference of a colour with gradients recorded, as in training, and without."""
    sampling = Sampling(trainer.settings.bins, quadrature=trainer.quadrature, clip_to_box=not trainer.whole_rays)

    def colour() -> Tensor:
        return render_rays(
            trainer.coarse, trainer.fine, rays, trainer.box, sampling, trainer.grid, trainer.background, None
        ).colour.detach()

    recorded = colour()
    with torch.no_grad():
        return float((recorded - colour()).abs().max())


def reloaded(situation: Situation, trainer: Trainer) -> Trainer:
    """A new trainer with what a checkpoint keeps: weights and the mask of empty space."""
    file: Path = situation.scratch / f"reload-{trainer.method}.safetensors"
    kept = {name: value.contiguous() for name, value in trainer.fields.state_dict().items()}
    if trainer.grid is not None:
        kept["occupied"] = trainer.grid.occupied
    save_file(kept, file)
    read = load_file(file)
    fresh = new_trainer(situation, trainer.method, trainer.settings)
    fresh.step = trainer.step
    if fresh.grid is not None:
        fresh.grid.occupied = read.pop("occupied")
    fresh.fields.load_state_dict(read)
    return fresh


class MeanHeld(Amplifier):
    """A reading of the amplifier about a mean that stays as it is, whatever shares the call: density is a field again.

    The cure for statistics of a batch; what it does to scores is another question, which no case here answers.
    """

    pointwise = True

    def __init__(self, source: CallMeanAmplifier, mean: Tensor) -> None:
        super().__init__()
        self.bounded = source.bounded
        self.source = source
        self.register_buffer("mean", mean)

    def before_and_after(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        quantity = self.source.quantity(raw)
        return quantity, self.source.about(quantity, self.get_buffer("mean"))


@torch.no_grad()
def with_mean_held(trainer: Trainer) -> Trainer:
    """A copy whose amplifier keeps the mean that evenly spread points of the box have."""
    copy = deepcopy(trainer)
    for one in copy.fields.children():
        source = one.amplifier
        assert isinstance(source, CallMeanAmplifier), "an amplifier without a mean of the call has none to hold"
        one.amplifier = MeanHeld(source, source.quantity(one.raw_in_box()).mean())  # type: ignore
    return copy


def _picture(situation: Situation, method: str, reading: str) -> Picture:
    """The test view in one call, row by row, and their difference."""
    trainer, test = trained(situation, method).trainer, setup(situation).test
    rays = test.all_rays(0)
    views = [trainer.render(rays, chunk).colour.reshape(test.height, test.width, 3).numpy()
             for chunk in (EVERYTHING, test.width)]  # fmt: skip
    difference = np.abs(views[0] - views[1])
    largest, rms = float(difference.max()), float(np.sqrt(np.mean(difference**2)))
    factor = 10 ** min(6, max(0, math.floor(-math.log10(max(largest, 1e-12)))))
    file = f"calls-{method}.png"
    write_png(situation.picture_file(file), side_by_side([*views, difference * factor], MAGNIFIED))
    psnr = metrics.psnr_from_mse(rms**2)
    between = "identical" if math.isinf(psnr) else f"{psnr:.1f} dB between two pictures of the same model"
    return Picture(
        4, f"{method}: {reading}",
        f"One call for the view; one call a row; their difference × {factor}. Largest {largest:.2g}, {between}.",
        f"stability/{file}",
    )  # fmt: skip


def side_by_side(images: list[np.ndarray], magnified: int, gap: int = 2) -> np.ndarray:
    """[height, width, 3] each → one picture with white gaps, each pixel `magnified` times as large."""
    white = np.ones((images[0].shape[0], gap, 3), dtype=images[0].dtype)
    parts = [part for image in images for part in (image, white)][:-1]
    return np.concatenate(parts, axis=1).repeat(magnified, axis=0).repeat(magnified, axis=1)


SIZES = ((1, 1), (9, 1), (1, 9), (5, 3), (12, 11))
"""(width, height)."""


def odd_sizes(situation: Situation) -> Iterator[Finding]:
    """C2: pictures of odd sizes through the renderer of every run against a loop over rays, and their scores."""
    for method in situation.methods:
        if reason := not_made_of_parts(method):
            yield Outcome("C2", method, whose(method), "not_applicable", why=reason)
            continue
        found = {f"{width} × {height}": _odd(situation, trained(situation, method).trainer, width, height)
                 for width, height in (SIZES[:3] if situation.quick else SIZES)}  # fmt: skip
        worst = max(found, key=lambda size: found[size] if math.isfinite(found[size]) else math.inf)
        yield judged(
            "C2", method, whose(method), found[worst], BAR,
            what="largest difference of a colour to a loop over rays", why=f"worst at {worst}",
        )  # fmt: skip
    yield judged(
        "C2", "metrics", "ours", sum(1 for size in SIZES for score in scores_of(*size) if not math.isfinite(score)), 0,
        what="scores of small pictures that are not finite (PSNR, SSIM, linear error)",
    )  # fmt: skip


def _odd(situation: Situation, trainer: Trainer, width: int, height: int) -> float:
    """Calls of 4 rays leave a last, partial one for most of these sizes."""
    test = setup(situation).test
    cameras = Cameras(test.camera_to_world[:1], width, height, 1.6 * max(width, height), test.near, test.far)
    rendered = evaluate.render_view(trainer, cameras, 0, 4).colour
    rays = cameras.all_rays(0)
    one_by_one = torch.cat([trainer.render(rays.part(i, i + 1), 1).colour for i in range(len(rays))])
    return float(np.abs(rendered - one_by_one.numpy().reshape(height, width, 3)).max())


def scores_of(width: int, height: int) -> list[float]:
    """Scores of random pictures, against others and, where a score of equal ones is a number, against themselves."""
    generator = np.random.default_rng(width * 100 + height)
    first, second = generator.uniform(size=(2, height, width, 3)).astype(np.float32)
    both: tuple[Callable[[np.ndarray, np.ndarray], float], ...] = (metrics.ssim, metrics.rmse_linear)
    return [score(a, b) for score in both for a, b in ((first, second), (first, first))] + [metrics.psnr(first, second)]
