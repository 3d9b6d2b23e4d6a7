"""A group of cells, which train in lockstep: the unit of work that an executor hands to a worker."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from harness.plan.defaults import KEPT_EVERY
from harness.plan.plugins import own_settings
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings, TrainSettings, ViewSettings


@dataclass(frozen=True)
class GroupTask:
    """The methods of one scene and one seed, with the same settings; picklable, and all that a worker needs."""

    scene: str
    seed: int
    methods: tuple[str, ...]
    train: TrainSettings
    score: ScoreSettings
    budget: Budget
    out: Path
    view_set: Path = Path()
    """The folder of `views`; not read if the view set itself is passed to the worker."""
    views: ViewSettings = field(default_factory=ViewSettings)
    decoded: Path | None = None
    """The folder where the user's decoded images are kept for the next group, as long as the run lasts."""
    content: str | None = None
    """The digest of the view set when the run began; None: unchecked."""
    hull: bytes | None = None
    """The hull of its silhouettes, packed, if it is known."""
    device: str = "cpu"
    threads: int = 1
    keep_every: float = KEPT_EVERY
    lpips: Path | None = None
    """The file of the weights of LPIPS, if there is one."""

    def settings(self, method: str) -> dict[str, object]:
        """Return the settings of one of its cells, as records hold them."""
        own = own_settings(method, self.train.own)
        train = asdict(replace(self.train, own={} if own is None else {method: own}))
        return {"train": train, "score": asdict(self.score), "budget": self.budget.settings()}
