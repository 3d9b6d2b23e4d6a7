"""A group of cells, which train in lockstep: the unit of work that an executor hands to a worker."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from harness.plan.defaults import KEPT_EVERY
from harness.plan.plugins import own_settings
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings, TrainSettings, ViewSettings


@dataclass(frozen=True)
class GroupTask:
    """The methods of one scene and one seed, all with the same settings; picklable, and all that a worker needs."""

    scene: str
    seed: int
    methods: tuple[str, ...]
    train: TrainSettings
    score: ScoreSettings
    budget: Budget
    out: Path
    view_set: Path = Path()
    """The folder to read `views` from; unread where a view set is handed on beside."""
    views: ViewSettings = field(default_factory=ViewSettings)
    content: str | None = None
    """The digest that the view set had when the run began; None if it is not held to one."""
    device: str = "cpu"
    threads: int = 1
    keep_every: float = KEPT_EVERY
    """The seconds between two times that the cells are kept in the middle of their training."""
    lpips: Path | None = None
    """The weights of LPIPS, if there are any."""

    def settings(self, method: str) -> dict[str, object]:
        """Return the settings of one of its cells, as records hold them."""
        own = own_settings(method, self.train.own)
        train = asdict(replace(self.train, own={} if own is None else {method: own}))
        return {"train": train, "score": asdict(self.score), "budget": self.budget.settings()}
