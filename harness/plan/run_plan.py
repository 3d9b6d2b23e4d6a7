"""The plan of a run: scenes × methods × seeds, with all settings."""

import itertools
from collections.abc import Collection
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from baselines.catalog import CATALOG as METHODS
from baselines.catalog import GIVEN
from baselines.composition import Parts
from baselines.methods.chosen import chosen
from harness.plan.defaults import KEPT_EVERY
from harness.plan.group_task import GroupTask
from harness.plan.plugins import OURS
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings, TrainSettings, ViewSettings
from harness.records.cells import USUAL, Roles
from harness.records.claims import ClaimFile

APART = ("scenes", "methods", "seeds", "render_limit", "lpips", "claims", "roles")
"""The fields of `Plan` that `Plan.settings` writes elsewhere or not at all."""
VALIDATION_VIEWS = 5
"""The minimum of validation views of a search."""


@dataclass(frozen=True)
class Extra:
    """Further methods on one scene, which explain a result without being part of it."""

    scene: str
    methods: tuple[str, ...]
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    profile: str
    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]
    budget: Budget
    train: TrainSettings
    score: ScoreSettings
    views: ViewSettings
    view_set: tuple[str, ...] | None = None
    """The posed images of each scene (`scenes.view_sets.formats.foreign`), in place of rendered scenes."""
    scene_file: str | None = None
    """A user's scene (`scenes.catalog.scene_file`), to be rendered instead of the catalogue's."""
    scene_file_digest: str | None = None
    render_limit: float | None = None
    """The seconds that the scene file, or one of its views, may take; None: the default. No result depends on it."""
    extras: tuple[Extra, ...] = ()
    given: tuple[tuple[str, str], ...] = ()
    """File and SHA-256 of the Gaussians of each scene that another program trained: scored, but not compared."""
    lpips: str | None = None
    """The file of the weights of LPIPS; cells name its digest."""
    claims: tuple[ClaimFile, ...] = ()
    """The claims to test; no score depends on them."""
    roles: Roles = USUAL

    def groups(self) -> dict[tuple[str, int], tuple[str, ...]]:
        """Map (scene, seed) → the methods trained in lockstep. Seeds are outermost: a stopped run has every scene."""
        groups = {}
        for seed, scene in itertools.product(self.seeds, self.scenes):
            further = (extra.methods for extra in self.extras if extra.scene == scene and seed in extra.seeds)
            groups[scene, seed] = tuple(dict.fromkeys(itertools.chain(self.methods, *further)))
        return groups

    def cells(self) -> list[tuple[str, str, int]]:
        return [(scene, method, seed) for (scene, seed), methods in self.groups().items() for method in methods]

    def all_methods(self) -> tuple[str, ...]:
        """Return the methods of all scenes, then those of single scenes."""
        return tuple(dict.fromkeys(itertools.chain(self.methods, *(extra.methods for extra in self.extras))))

    def tasks(self, view_sets: dict[str, Path], machine: "Machine", out: Path) -> list[GroupTask]:
        """Return the work of the groups of some scenes; `view_sets` maps scene → folder."""
        return [
            GroupTask(
                scene=scene,
                seed=seed,
                methods=methods,
                view_set=view_sets[scene],
                views=self.views,
                train=replace(self.train, own=self._handed_on((*methods, *self.guests))),
                score=self.score,
                budget=self.budget,
                out=out,
                device=machine.device,
                threads=machine.threads,
                keep_every=machine.keep_every,
                lpips=None if self.lpips is None else Path(self.lpips),
            )
            for (scene, seed), methods in self.groups().items()
            if scene in view_sets
        ]

    def in_float32(self) -> "Plan":
        """Return the plan with matrix multiplications in float32."""
        return replace(self, train=replace(self.train, precision="float32"))

    def settings(self) -> dict[str, object]:
        """Return everything that the results depend on, as JSON; without the defaults that older plans lack."""
        kept = {key: value for key, value in asdict(self).items() if key not in APART}
        kept["budget"] = self.budget.settings()
        if self.scene_file is None:
            del kept["scene_file"], kept["scene_file_digest"]
        for name in ("region", "ceiling_train_db", "ceiling_test_db"):
            if getattr(self.views, name) is None:
                del kept["views"][name]
        kept["given"] = [digest for _, digest in self.given]
        for name in ("extras", "given"):
            if not kept[name]:
                del kept[name]
        if self.view_set is not None and len(self.view_set) == 1:
            kept["view_set"] = self.view_set[0]  # as older plans, which have only one
        names = {"scenes": list(self.scenes), "methods": list(self.methods), "seeds": list(self.seeds)}
        own = self.own_settings((*self.all_methods(), *self.guests))
        kept["train"]["own"] = {name: asdict(settings) for name, settings in own.items()}
        return {**kept, **names}

    @property
    def guests(self) -> tuple[str, ...]:
        """Return what is scored but not compared."""
        return (GIVEN,) if self.given else ()

    def guest_cells(self) -> list[tuple[str, str, int]]:
        """Return (scene, method, seed) of the guests' cells."""
        return [(scene, guest, self.seeds[0]) for guest in self.guests for scene in self.scenes]

    def without_extras(self) -> "Plan":
        """Return the plan without further methods."""
        return replace(self, extras=())

    def with_validation_views(self) -> "Plan":
        """Return the plan of a search: settings are chosen on validation views, which a run does not need."""
        return replace(self, views=replace(self.views, val=max(self.views.val, VALIDATION_VIEWS)))

    def _handed_on(self, methods: Collection[str]) -> dict[str, Any]:
        """Return the own settings for a worker, without those of packages, whose classes it may lack."""
        given = OURS | self.train.own.keys()
        return {name: own for name, own in self.own_settings(methods).items() if name in given}

    def own_settings(self, methods: Collection[str]) -> dict[str, Any]:
        """Map method → its own settings: those of the plan, else the catalogue's with the profile's constants."""
        own = {name: METHODS[name].settings for name in methods if name in METHODS}
        # by settings, as a searched method may have two names in the catalogue
        searched = {METHODS[name].parts: pair for name, pair in chosen(self.profile).items()}
        for name, parts in own.items():
            if isinstance(parts, Parts) and (pair := searched.get(replace(parts, precision=None))):
                own[name] = replace(parts, **pair.fields)
        own |= {name: given for name, given in self.train.own.items() if name in methods}
        return {name: settings for name, settings in own.items() if settings is not None}


@dataclass(frozen=True)
class Machine:
    """The part of the machine that a run uses. Clocks are comparable only on the same machine."""

    device: str
    workers: int
    """The number of processes; on Ray, where the cluster decides how many groups run at once, only of measurements."""
    threads: int
    executor: Literal["local", "ray", "submitit"] = "local"
    keep_every: float = KEPT_EVERY
    """The seconds between two snapshots of a cell in training; no result depends on it."""
    job_options: tuple[str, ...] = ()
    """`NAME=VALUE` for the jobs of submitit; no result depends on them."""

    def settings(self) -> dict[str, object]:
        """Return the settings as JSON; without those that older plans lack, so that older runs can be resumed."""
        usual = ("device", "workers", "threads")
        return {key: getattr(self, key) for key in (usual if self.executor == "local" else (*usual, "executor"))}
