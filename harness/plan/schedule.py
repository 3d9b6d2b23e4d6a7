"""Progress through a budget, the learning rate over it, and the checkpoints where the test set is scored."""

import math
from dataclasses import asdict, dataclass
from typing import Literal

Decay = Literal["exponential", "linear"]


@dataclass(frozen=True)
class Budget:
    """The training time of a method in steps, seconds and core seconds on its own clock, whichever ends first."""

    steps: int | None
    seconds: float | None
    core_seconds: float | None = None

    def progress(self, step: int, seconds: float, core_seconds: float) -> float:
        """Return 0 at the start; 1 or more when the budget is spent."""
        spent = (step, self.steps), (seconds, self.seconds), (core_seconds, self.core_seconds)
        return max(used / given if given else 0.0 for used, given in spent)

    def settings(self) -> dict[str, object]:
        """Return the budget as JSON; without core seconds if there are none, as in old records."""
        return {name: value for name, value in asdict(self).items() if name != "core_seconds" or value is not None}

    @property
    def in_words(self) -> str:
        parts = (self.steps, "steps"), (self.seconds, "s of training"), (self.core_seconds, "core seconds of training")
        return " or ".join(f"{given:g} {unit}" for given, unit in parts if given)


def learning_rate(progress: float, step: int, first: float, last: float, warm_up_steps: int, decay: Decay) -> float:
    """Return the rate, from `first` to `last` after a linear warm-up; exponentially, it is the original NeRF's."""
    spent = min(progress, 1.0)
    decayed = first + (last - first) * spent if decay == "linear" else first * (last / first) ** spent
    return decayed * min(1.0, (step + 1) / (warm_up_steps + 1))


def checkpoint_fractions(count: int, earliest: float) -> list[float]:
    """Return `count` shares of the budget, evenly spaced in log time from `earliest` to 1."""
    if count == 1:
        return [1.0]
    return [math.exp(math.log(earliest) * (1 - i / (count - 1))) for i in range(count)]
