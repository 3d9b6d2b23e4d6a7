"""The distance from convergence: the PSNR that the last doubling of the steps gained.

At half of the steps the learning rate is still high. In short trainings the running mean of the weights, which is
scored (`baselines.numerics.weight_average`), compensates for that. In long ones a training of half the steps ends above
the checkpoint, and twice the steps gain less: docs/findings.md shows both.
"""

from dataclasses import dataclass

import numpy as np

from harness.records.cells import CellRecord
from harness.verdicts.comparisons import judged, keyed, score_on_curve
from harness.verdicts.failures import judgeable

STILL_RISING = 0.3
"""The gain in dB at which a method counts as still rising."""


@dataclass(frozen=True)
class LastDoubling:
    """The gain of a method by the last doubling of its steps, in dB of test PSNR."""

    method: str
    gain: float | None
    """The mean over scenes of the means over seeds; None if no cell has a gain."""
    interval: tuple[float, float] | None
    """The 95 % interval, for scenes like these if there are several, else over the seeds of the only scene."""
    cells: int


def gain_of_last_doubling(cell: CellRecord) -> float | None:
    """Return the PSNR at the end minus that at half of the steps, interpolated in the logarithm of steps; None for a
    cell that cannot be judged, and without a checkpoint in the first half.
    """
    if not judgeable(cell) or not cell.curve or cell.curve[-1].psnr is None:
        return None
    half = score_on_curve(cell, "psnr", "steps", cell.steps / 2)
    return None if half is None else cell.curve[-1].psnr - half


def last_doublings(cells: list[CellRecord], methods: list[str]) -> list[LastDoubling]:
    by_key, scenes, seeds = keyed(cells)
    gains = {key: gain_of_last_doubling(cell) for key, cell in by_key.items()}

    def of_method(method: str) -> LastDoubling:
        table = {
            scene: np.array([gains.get((scene, method, seed)) for seed in seeds], dtype=np.float64) for scene in scenes
        }
        mean = judged(table, "psnr", family=1)
        return LastDoubling(method, mean.difference, mean.chosen.interval, mean.pairs)

    return [of_method(method) for method in methods]


def in_words(row: LastDoubling) -> str:
    """Return a line of the terminal: `nerf: +0.91 dB [+0.62, +1.20] in its last doubling`."""
    if row.gain is None:
        return f"{row.method}: what its last doubling brought is not known"
    ends = ", ".join(f"{end:+.2f}" for end in row.interval or ())
    figures = f"{row.gain:+.2f} dB{f' [{ends}]' if ends else ''}".replace("-", "−")
    return f"{row.method}: {figures} in its last doubling{'; still rising' * (row.gain >= STILL_RISING)}"
