"""Progress through a budget, the learning rate over it, and the checkpoints where the test set is scored."""

import math
from dataclasses import dataclass
from typing import Literal

Decay = Literal["exponential", "linear"]


@dataclass(frozen=True)
class Budget:
    """The training time of a method: steps, seconds on its own clock, or whichever ends first."""

    steps: int | None
    seconds: float | None

    def progress(self, step: int, seconds: float) -> float:
        """Return 0 at the start; 1 or more when the budget is spent."""
        by_steps = step / self.steps if self.steps else 0.0
        by_seconds = seconds / self.seconds if self.seconds else 0.0
        return max(by_steps, by_seconds)


def learning_rate(progress: float, step: int, first: float, last: float, warm_up_steps: int, decay: Decay) -> float:
    """Fall from `first` to `last` over the budget, after a linear warm-up; exponentially as the original NeRF's."""
    spent = min(progress, 1.0)
    decayed = first + (last - first) * spent if decay == "linear" else first * (last / first) ** spent
    return decayed * min(1.0, (step + 1) / (warm_up_steps + 1))


def checkpoint_fractions(count: int, earliest: float) -> list[float]:
    """Return `count` shares of the budget, evenly spaced in log time from `earliest` to 1."""
    if count == 1:
        return [1.0]
    return [math.exp(math.log(earliest) * (1 - i / (count - 1))) for i in range(count)]
