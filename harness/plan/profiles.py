"""The plan of a run: scenes × methods × seeds, how much, and on what. Profiles hold the differences."""

import hashlib
import itertools
import re
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from baselines.catalog import CATALOG as METHODS
from baselines.composition import Parts
from baselines.contract import Accelerations, NetworkSize, Precision
from baselines.methods.chosen import chosen
from baselines.methods.explicit import VoxelSettings
from baselines.numerics.optimisers import OptimiserName, OptimiserSettings
from harness.plan.defaults import KEPT_EVERY
from harness.plan.group_task import GroupTask
from harness.plan.needed import FORCEABLE, LEFT_OUT_BY, kept
from harness.plan.plugins import OURS
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, ScoreSettings, TrainSettings, ViewSettings
from harness.records.cells import USUAL, Roles
from harness.records.claims import ClaimFile
from scenes.catalog.entries import CATALOG as SCENES
from scenes.catalog.entries import CLASSICS, RUNGS, STRESS
from scenes.catalog.scene_file import check_scene_file, name_of_file
from scenes.files.errors import InputError
from scenes.modelling.needs import PARTS
from scenes.view_sets.source import Region

APART = ("scenes", "methods", "seeds", "render_limit", "lpips", "guest", "claims", "roles")
"""The fields that settings have elsewhere or not at all."""
RANGES = {
    "seeds": (1, 1000),
    "first_seed": (0, 1_000_000),
    "budget_steps": (1, 10_000_000),
    "budget_seconds": (0.1, 3e7),
    "budget_core_seconds": (0.1, 3e7),
    "resolution": (8, 4096),
    "render_limit": (0.1, 3e7),
}
"""The least and the largest value of options."""


@dataclass(frozen=True)
class Extra:
    """Further methods on one scene, beside those that train on all: they explain a result and are no part of it."""

    scene: str
    methods: tuple[str, ...]
    seeds: tuple[int, ...]


@dataclass(frozen=True)
class Plan:
    """A plan of a run."""

    profile: str
    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]
    budget: Budget
    train: TrainSettings
    score: ScoreSettings
    views: ViewSettings
    view_set: tuple[str, ...] | None = None
    """The posed images of each scene, in any readable format (`scenes.view_sets.formats.foreign`), instead of
    rendered scenes.
    """
    scene_file: str | None = None
    """The file of a scene of the user's own (`scenes.catalog.scene_file`), to be rendered instead of
    the catalogue's.
    """
    scene_file_digest: str | None = None
    """The SHA-256 of its bytes."""
    render_limit: float | None = None
    """The seconds that the scene file, or one of its views, may take, else the default; no result depends on it."""
    extras: tuple[Extra, ...] = ()
    guest: str | None = None
    """A method of another family, trained with the first seed for the core seconds of the baseline on each scene: it
    shows what else these would have bought, and is compared with nothing.
    """
    lpips: str | None = None
    """The file of the weights of LPIPS; cells name its digest."""
    claims: tuple[ClaimFile, ...] = ()
    """What is claimed of the methods; no score depends on it."""
    roles: Roles = USUAL

    def groups(self) -> dict[tuple[str, int], tuple[str, ...]]:
        """Map (scene, seed) → the methods that train in lockstep there: those of the plan, then the further ones.

        Seeds are outermost, so that a stopped run has every scene.
        """
        groups = {}
        for seed, scene in itertools.product(self.seeds, self.scenes):
            further = (extra.methods for extra in self.extras if extra.scene == scene and seed in extra.seeds)
            groups[scene, seed] = tuple(dict.fromkeys(itertools.chain(self.methods, *further)))
        return groups

    def cells(self) -> list[tuple[str, str, int]]:
        """Return (scene, method, seed) in the order in which they are run."""
        return [(scene, method, seed) for (scene, seed), methods in self.groups().items() for method in methods]

    def all_methods(self) -> tuple[str, ...]:
        """Return the methods of all scenes, then those of single ones."""
        return tuple(dict.fromkeys(itertools.chain(self.methods, *(extra.methods for extra in self.extras))))

    def tasks(self, view_sets: dict[str, Path], machine: "Machine", out: Path) -> list[GroupTask]:
        """Return the work of every group, its view set taken from scene → folder."""
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
        ]

    def in_float32(self) -> "Plan":
        """Return the plan with matrix multiplications in float32, the rest as it is."""
        return replace(self, train=replace(self.train, precision="float32"))

    def settings(self) -> dict[str, Any]:
        """Return everything that the results depend on, as JSON."""
        kept = {key: value for key, value in asdict(self).items() if key not in APART}
        kept["budget"] = self.budget.settings()
        if self.scene_file is None:
            del kept["scene_file"], kept["scene_file_digest"]  # plans from before there was a choice are equal
        for name in ("region", "ceiling_train_db", "ceiling_test_db"):
            if getattr(self.views, name) is None:
                del kept["views"][name]
        if not self.extras:
            del kept["extras"]
        if self.view_set is not None and len(self.view_set) == 1:
            kept["view_set"] = self.view_set[0]  # as in plans from before there could be several
        names = {"scenes": list(self.scenes), "methods": list(self.methods), "seeds": list(self.seeds)}
        own = self.own_settings((*self.all_methods(), *self.guests))
        kept["train"]["own"] = {name: asdict(settings) for name, settings in own.items()}
        return {**kept, **names}

    @property
    def guests(self) -> tuple[str, ...]:
        return (self.guest,) if self.guest else ()

    def guest_cells(self) -> list[tuple[str, str, int]]:
        """Return (scene, method, seed) of the guest's cells."""
        return [(scene, guest, self.seeds[0]) for guest in self.guests for scene in self.scenes]

    def alone(self) -> "Plan":
        """Return the plan of its own methods, without those that explain a result or show its scale."""
        return replace(self, extras=(), guest=None)

    def _handed_on(self, methods: Collection[str]) -> dict[str, Any]:
        """Return the own settings that a worker is given; a package's are not, as it may lack their classes."""
        given = OURS | self.train.own.keys()
        return {name: own for name, own in self.own_settings(methods).items() if name in given}

    def own_settings(self, methods: Collection[str]) -> dict[str, Any]:
        """Map method → the settings that are its own, for methods that have any: those of the plan, else those of the
        catalogue, with the constants of density that were chosen for the profile.
        """
        own = {name: METHODS[name].settings for name in methods if name in METHODS}
        # by what a method is, not by its name: one of the searched methods may stand in the catalogue twice
        searched = {METHODS[name].parts: pair for name, pair in chosen(self.profile).items()}
        for name, parts in own.items():
            if isinstance(parts, Parts) and (pair := searched.get(parts)):
                own[name] = replace(parts, **pair.fields)
        own |= {name: given for name, given in self.train.own.items() if name in methods}
        return {name: settings for name, settings in own.items() if settings is not None}


@dataclass(frozen=True)
class Machine:
    """The part of the machine that a run uses: clocks are comparable only on the same machine."""

    device: str
    workers: int
    """The number of processes; on Ray as many groups run at once as the cluster has room for, and this is for
    measurements.
    """
    threads: int
    executor: Literal["local", "ray", "submitit"] = "local"
    keep_every: float = KEPT_EVERY
    """The seconds between two times that cells are kept in the middle of their training; changes no result."""
    job_options: tuple[str, ...] = ()
    """`NAME=VALUE` for the jobs of submitit; change no result."""

    def settings(self) -> dict[str, Any]:
        """Return the settings as JSON, without defaults, so that runs from before there was a choice can be resumed."""
        usual = ("device", "workers", "threads")
        return {key: getattr(self, key) for key in (usual if self.executor == "local" else (*usual, "executor"))}


EXPLAINED = "lego"
"""The scene of the paper's ablation, Table 4."""
EXPLAINING = ("qnerf_printed", "nerf_phi_encoding", "nerf_phi_encoding_amplifier")
"""The methods that explain the result: the form as printed, and the rows of Table 4 between NeRF and Q-NeRF."""

COMPARED = ("nerf", "nerf_matched", "qnerf")
"""The methods of every default run: the two methods of the paper, and the bandwidth control."""
JUDGED = (*COMPARED, "qnerf_repaired")
"""The methods that the headline judges: those of `COMPARED`, and the best reading that changes a listing."""

TUNED: dict[OptimiserName, dict[str, Any]] = {
    "adam": {
        "optimiser": OptimiserSettings("adam", (0.9, 0.99)),
        "learning_rate": 2e-2,
        "last_learning_rate": 6e-4,
        "decay": "linear",
    },
    "soap": {
        "optimiser": OptimiserSettings("soap", (0.9, 0.99)),
        "learning_rate": 1e-2,
        "last_learning_rate": 3e-4,
        "decay": "linear",
    },
    "muon": {
        "optimiser": OptimiserSettings("muon", (0.95, 0.99)),
        "learning_rate": 1.4e-2,
        "last_learning_rate": 4e-4,
        "decay": "linear",
    },
}
"""Map optimiser → the settings of short runs with it, for all methods (`python -m harness study sweep`)."""

REDUCED_TRAINING = TrainSettings(
    network=NetworkSize(depth=6, width=64, colour_layers=2, colour_width=32),
    rays=512,
    bins=32,
    bins_per_pixel=0.4,
    first_bins=24,
    rendered_bins=64,
    fine_bins=0,
    covered_share=0.8,
    **TUNED["soap"],
    warm_up_steps=50,
    average=12.0,
    precision="bfloat16",
    grid=GridSettings(cells=48, first_step=100, every=25, per_pixel=0.6),
    own={"voxels_drjit": VoxelSettings(finest=64, bins=96, rate_factor=27.0)},
)

REDUCED_VIEWS = ViewSettings(
    resolution=100,
    train=100,
    val=5,
    test=15,
    spp_train=64,
    spp_test=256,
    ceiling_train_db=36.0,
    ceiling_test_db=45.0,
)
"""The views of scores about 30 dB: noise of the test views is 3 % of such an error. A fifth of that of the training
views goes into it (lego: 0.8 dB are lost with 26 dB in place of 33).
"""

SHORT_TRAINING = replace(
    REDUCED_TRAINING,
    rays=256,
    bins=24,
    bins_per_pixel=None,
    first_bins=12,
    rendered_bins=None,
    warm_up_steps=30,
    grid=GridSettings(cells=32, first_step=80, every=20),
    precision="float32",
)
"""The settings for scenes that are simple, and hard for one reason: a few hundred steps."""

PROFILES: dict[str, Plan] = {
    "smoke": Plan(
        profile="smoke",
        scenes=("hotdog", "lego"),
        methods=COMPARED,
        seeds=(0, 1),
        budget=Budget(steps=60, seconds=None),
        train=replace(REDUCED_TRAINING, grid=GridSettings(cells=24, first_step=30, every=10)),
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=1024, train_views=2, stored_views=1),
        views=ViewSettings(resolution=32, train=20, val=2, test=5, spp_train=16, spp_test=32),
        extras=(Extra(EXPLAINED, ("qnerf_printed",), (0,)),),
    ),
    "reduced": Plan(
        profile="reduced",
        scenes=tuple(CLASSICS),
        methods=JUDGED,
        seeds=(0, 1, 2),
        budget=Budget(steps=1000, seconds=None),
        train=REDUCED_TRAINING,
        score=ScoreSettings(checkpoints=4, earliest=0.125, chunk=2048),
        views=REDUCED_VIEWS,
        extras=(Extra(EXPLAINED, EXPLAINING, (0, 1, 2)),),
        guest="splats",
    ),
    "stress": Plan(
        profile="stress",
        scenes=tuple(STRESS),
        methods=COMPARED,
        seeds=(0,),
        budget=Budget(steps=300, seconds=None),
        train=SHORT_TRAINING,
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=2048, stored_views=1),
        views=ViewSettings(resolution=48, train=30, val=0, test=6, spp_train=16, spp_test=64),
    ),
    "ladder": Plan(
        profile="ladder",
        scenes=tuple(RUNGS),
        methods=COMPARED,
        seeds=(0,),
        budget=Budget(steps=200, seconds=None),
        train=SHORT_TRAINING,
        score=ScoreSettings(checkpoints=3, earliest=0.3, chunk=2048, stored_views=1),
        views=ViewSettings(resolution=40, train=20, val=0, test=4, spp_train=16, spp_test=32),
    ),
    "converged": Plan(
        profile="converged",
        scenes=tuple(CLASSICS),
        methods=JUDGED,
        seeds=(0, 1, 2),
        budget=Budget(steps=4000, seconds=None),
        train=replace(
            REDUCED_TRAINING,
            rays=1024,
            bins_per_pixel=0.8,
            rendered_bins=96,
            warm_up_steps=100,
            grid=replace(REDUCED_TRAINING.grid, per_pixel=1.2, every=50, share=0.1),
        ),
        score=ScoreSettings(checkpoints=5, earliest=0.0625, chunk=2048),
        views=REDUCED_VIEWS,
    ),
    "full": Plan(
        profile="full",
        scenes=tuple(CLASSICS),
        methods=COMPARED,
        seeds=(0, 1, 2),
        budget=Budget(steps=200_000, seconds=None),
        train=TrainSettings(grid=GridSettings(cells=0)),
        score=ScoreSettings(checkpoints=12, earliest=0.005),
        views=ViewSettings(),
    ),
}


def planned(
    profile: str,
    *,
    scenes: list[str] | None = None,
    methods: list[str] | None = None,
    seeds: int | None = None,
    first_seed: int | None = None,
    budget_steps: int | None = None,
    budget_seconds: float | None = None,
    budget_core_seconds: float | None = None,
    resolution: int | None = None,
    view_set: Sequence[Path] | None = None,
    scene_file: Path | None = None,
    render_limit: float | None = None,
    region: Region | None = None,
    precision: Precision | None = None,
    optimiser: OptimiserName | None = None,
    without: list[str] | None = None,
    need: list[str] | None = None,
    no_need: list[str] | None = None,
) -> Plan:
    """Return a profile with the user's changes; raises `InputError` naming the option, the value and the known ones.

    `precision` and `optimiser` None keep the profile's; another optimiser comes with the rates of `TUNED`. `without`
    names accelerations to switch off. `need` and `no_need` force parts in and out, whatever a scene needs: `need` also
    stands for switching off the acceleration that leaves it out. `region` bounds the visible geometry of the images of
    `view_set`.
    """
    from harness.plan.plugins import method_names, require_methods

    if profile not in PROFILES:
        raise InputError(f"--profile: unknown profile {profile!r}; known profiles: {' '.join(PROFILES)}")
    for name, value in {
        "seeds": seeds,
        "first_seed": first_seed,
        "budget_steps": budget_steps,
        "budget_seconds": budget_seconds,
        "budget_core_seconds": budget_core_seconds,
        "resolution": resolution,
        "render_limit": render_limit,
    }.items():
        least, most = RANGES[name]
        if value is not None and not least <= value <= most:
            option = "--" + name.replace("_", "-")
            raise InputError(f"{option} {value}: must lie between {least} and {most:g}")
    plan = PROFILES[profile]
    if scenes is not None and view_set is not None:
        raise InputError("--scenes and --view-set exclude each other: a view set is a scene of its own")
    if scene_file is not None and (scenes is not None or view_set is not None):
        raise InputError("--scene-file excludes --scenes and --view-set: it is one scene of its own")
    if scenes is not None:
        plan = replace(plan, scenes=known_names("--scenes", scenes, list(SCENES)))
    if view_set is not None:
        own, views = _names_of(view_set), replace(plan.views, region=region)
        plan = replace(plan, scenes=own, view_set=tuple(map(str, view_set)), views=views)
    if scene_file is not None:
        check_scene_file(scene_file)
        digest = hashlib.sha256(scene_file.read_bytes()).hexdigest()
        own = (name_of_file(scene_file),)
        plan = replace(
            plan, scenes=own, scene_file=str(scene_file), scene_file_digest=digest, render_limit=render_limit
        )
    if methods is not None:  # a user who names methods wants these and no others
        plan = replace(plan.alone(), methods=known_names("--methods", methods, method_names()))
    require_methods(plan.methods)
    if seeds is not None or first_seed is not None:
        first, many = first_seed or 0, seeds or len(plan.seeds)
        plan = replace(plan, seeds=tuple(range(first, first + many)))
    there = [extra for extra in plan.extras if extra.scene in plan.scenes]
    there = [replace(extra, seeds=tuple(seed for seed in extra.seeds if seed in plan.seeds)) for extra in there]
    plan = replace(plan, extras=tuple(extra for extra in there if extra.seeds))
    if budget_steps is not None or budget_seconds is not None or budget_core_seconds is not None:
        plan = replace(plan, budget=Budget(budget_steps, budget_seconds, budget_core_seconds))
    if resolution is not None:
        plan = replace(plan, views=replace(plan.views, resolution=resolution))
    if precision is not None:
        plan = replace(plan, train=replace(plan.train, precision=precision))
    if optimiser is not None and optimiser != plan.train.optimiser.name:
        plan = replace(plan, train=replace(plan.train, **TUNED[optimiser]))
    if without is not None:
        off = known_names("--without", without, [extra.name for extra in fields(Accelerations)])
        plan = replace(plan, train=replace(plan.train, accelerations=plan.train.accelerations.without(off)))
    return _forced(plan, need or [], no_need or [])


def _forced(plan: Plan, need: list[str], no_need: list[str]) -> Plan:
    """Return the plan with forced parts; those that `plan` does not leave out already count as needed."""
    for option, asked in (("--need", need), ("--no-need", no_need)):
        if fixed := [name for name in asked if name in PARTS and name not in FORCEABLE]:
            raise InputError(
                f"{option} {' '.join(fixed)}: there is no choice about it; choose of {' '.join(FORCEABLE)}"
            )
    given, out = known_names("--need", need, list(FORCEABLE)), known_names("--no-need", no_need, list(FORCEABLE))
    if both := [name for name in given if name in out]:
        raise InputError(f"--need and --no-need: {' '.join(both)} in both; known: {' '.join(FORCEABLE)}")
    off = [name for name, acceleration in LEFT_OUT_BY.items() if not getattr(plan.train.accelerations, acceleration)]
    if both := [name for name in off if name in out]:
        names = " ".join(LEFT_OUT_BY[name] for name in both)
        raise InputError(f"--no-need {' '.join(both)}: --without {names} forces just that in; give one of them")
    everything = tuple(name for name in FORCEABLE if name in given or name in off)
    train = kept(plan.train, everything)
    if "fine_pass" in out:
        train = replace(train, fine_bins=0)
    if "empty_space" in out and not train.grid.cells:
        train = replace(train, grid=GridSettings())
    if "background_rays" in out and not train.covered_share:
        train = replace(train, covered_share=REDUCED_TRAINING.covered_share)
    return replace(plan, train=train, views=replace(plan.views, need=everything, no_need=out))


def _names_of(view_sets: Sequence[Path]) -> tuple[str, ...]:
    """Return the names of the scenes; raises `InputError` for a path that is no view set, and for two of one name."""
    from scenes.view_sets.formats.foreign import check_listed

    known: dict[str, Path] = {}
    for path in view_sets:
        try:
            check_listed(path)
        except InputError as error:
            raise InputError(f"--view-set {error}") from error
        name = scene_name_of(path)
        if name in known:
            raise InputError(f"--view-set {known[name]} {path}: both would be the scene {name}; rename one of them")
        known[name] = path
    return tuple(known)


def scene_name_of(view_set: Path) -> str:
    """Make a name for records from the folder's: letters, digits, `-` and `_` alone."""
    folder = view_set.resolve()
    name = folder.stem if folder.suffix in (".npz", ".json") and folder.is_file() else folder.name
    return re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-") or "view-set"


def known_names(option: str, names: list[str], known: list[str]) -> tuple[str, ...]:
    """Return `names` as they are; raises `InputError` for one that is unknown or named twice."""
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"{option}: unknown {' '.join(map(repr, unknown))}; known: {' '.join(known)}")
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InputError(f"{option}: {' '.join(repeated)} named twice")
    return tuple(names)
