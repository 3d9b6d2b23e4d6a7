"""Fake figures of twenty runs on each of two machines; one figure changes on one machine."""

import numpy as np

from harness.records.study import Studies
from harness.verdicts.history.figures_over_runs import figures_over_runs
from harness.verdicts.history.past_runs import PastRun
from tests.reports.fake_studies import PROVENANCE

SLOWER_FROM = 12


def past_runs() -> list[PastRun]:
    """Return runs that alternate between two machines; the commits count the runs."""
    noise = np.random.default_rng(0).normal(1.0, 0.02, (40, 2))
    return [
        PastRun(
            when=f"2026-10-{1 + number // 2:02d}T10:00:00Z",
            command="gate",
            commit=f"{number:012x}",
            of_class=("avx2", "avx512")[number % 2],
            processor="AMD EPYC 9R14",
            threads=2,
            values={
                "speed.train.nerf": noise[number, 0] * (1.25 if number % 2 == 0 and number // 2 >= SLOWER_FROM else 1),
                "speed.score": noise[number, 1],
                "fairness.batches": 0.0,
            },
            units={"speed.train.nerf": "×", "speed.score": "×"},
        )
        for number in range(40)
    ]


def fake_history(damaged: tuple[str, ...] = ()) -> Studies:
    return figures_over_runs(past_runs(), damaged, {"file": "out/history.jsonl"}, PROVENANCE)
