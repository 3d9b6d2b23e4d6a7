"""The options that decide what is trained on what: a table of their arguments, and one of their changes of a plan."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.command.machine_options import device_and_bfloat16
from harness.command.options import Options, option, require_between, require_use
from harness.plan.defaults import RENDER_LIMIT
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import torch

    from harness.plan.run_plan import Plan

PLAN_OPTIONS: Options = {
    "--profile": option(
        "plan (default: reduced)", "smoke|reduced|stress|ladder|converged|full|full_skipping", default="reduced"
    ),
    "--scenes": option("scenes to train on (default: the profile's)"),
    "--methods": option("methods to compare (default: the profile's)"),
    "--seeds": option("number of seeds", "N", int),
    "--first-seed": option("first seed (default: 0)", "K", int),
    "--budget-steps": option("training steps of each cell", "N", int),
    "--budget-seconds": option("training seconds of each cell, on its own clock", "S", float),
    "--budget-core-seconds": option("processor seconds of each cell's training, all threads", "S", float),
    "--resolution": option("width of the views"),
    "--checkpoints": option("times at which the test views are scored, the end included", "N", int),
    "--test-views": option("number of test views (default: the profile's)", "N", int),
    "--curve-views": option("number of test views of which the curves are means (default: the profile's)", "N", int),
    "--device": {},
    "--precision": option(
        "precision of matrix multiplications (default: the profile's, if the processor has units for it)",
        default="auto",
        choices=("auto", "float32", "bfloat16", "float16"),
    ),
    "--optimiser": option(
        "optimiser of all methods, with its own rates (default: the profile's)", choices=("adam", "soap", "muon")
    ),
    "--without": option("accelerations to switch off: grid clipping early_stop …", "NAME", nargs="+"),
    "--need": option("parts to keep even where not needed: view_direction outside_box …", "NAME", nargs="+"),
    "--no-need": option("parts to leave out even where needed", "NAME", nargs="+"),
    "--view-set": option(
        "train on these images, each a scene: Blender's, nerfstudio's, COLMAP's or LLFF's folder, or a tiny-NeRF .npz",
        "PATH",
        Path,
        nargs="+",
    ),
    "--scene-file": option(
        "render your own scene instead: Mitsuba .xml, or .py with SCENE. It has your rights: Python is code, and an "
        "XML file can make Mitsuba read any file; use only files that you trust",
        "FILE",
        Path,
    ),
    "--render-limit": option(
        f"seconds that --scene-file, or one of its views, may take (default: {RENDER_LIMIT:g}, or more if large)",
        "S",
        float,
    ),
    "--bounds": option(
        "box around everything visible, for every --view-set", ("X0", "Y0", "Z0", "X1", "Y1", "Z1"), float, nargs=6
    ),
    "--near": option("smallest distance of anything visible from the camera, for --view-set", "D", float),
    "--far": option("largest distance of anything visible from the camera, for --view-set", "D", float),
    "--view-sets": {},
}
RANGES = {
    "seeds": (1, 1000),
    "first_seed": (0, 1_000_000),
    "budget_steps": (1, 10_000_000),
    "budget_seconds": (0.1, 3e7),
    "budget_core_seconds": (0.1, 3e7),
    "resolution": (8, 4096),
    "checkpoints": (1, 100),
    "test_views": (1, 100_000),
    "curve_views": (1, 100_000),
    "render_limit": (0.1, 3e7),
}
REGION = ("bounds", "near", "far")
Change = Callable[["Plan", Any], "Plan"]


def planned(profile: str, **given: Any) -> "Plan":
    """Return the plan of a profile with the options that are not None; `budget_steps` is `--budget-steps`. Raises
    `InputError` with the option, its value and the known values.
    """
    from harness.plan.names import known_names
    from harness.plan.plugins import require_methods
    from harness.plan.profiles import PROFILES
    from harness.plan.schedule import Budget

    known_names("--profile", [profile], list(PROFILES))
    given = {name: value for name, value in given.items() if value is not None}
    require_between(argparse.Namespace(**given), **RANGES)
    require_use(argparse.Namespace(**given), "with --scene-file", "scene_file" in given, "render_limit")
    if "scene_file" in given and given.keys() & {"scenes", "view_set"}:
        raise InputError("--scene-file excludes --scenes and --view-set, as it is the only scene")
    if given.keys() >= {"scenes", "view_set"}:
        raise InputError("--scenes and --view-set exclude each other, as view sets are the scenes")
    plan = PROFILES[profile]
    if any(name.startswith("budget_") for name in given):
        plan = replace(plan, budget=Budget(None, None))
    need, no_need = given.pop("need", []), given.pop("no_need", [])
    changes = _changes()
    for name in sorted(given, key=list(changes).index):
        plan = changes[name](plan, given[name])
    require_methods(plan.methods)
    extras = [extra for extra in plan.extras if extra.scene in plan.scenes]
    extras = [replace(extra, seeds=tuple(seed for seed in extra.seeds if seed in plan.seeds)) for extra in extras]
    plan = replace(plan, extras=tuple(extra for extra in extras if extra.seeds))
    return _with_needs(plan, need, no_need)


def _changes() -> dict[str, Change]:
    """Map option → the change of a plan by its value, in the order of the changes."""
    from baselines.contract import Accelerations
    from harness.plan.names import known_names
    from harness.plan.plugins import method_names
    from harness.plan.profiles import TUNED
    from scenes.catalog.entries import CATALOG

    accelerations = [acceleration.name for acceleration in fields(Accelerations)]

    def views(plan: "Plan", **changes: Any) -> "Plan":
        return replace(plan, views=replace(plan.views, **changes))

    def train(plan: "Plan", **changes: Any) -> "Plan":
        return replace(plan, train=replace(plan.train, **changes))

    def without(plan: "Plan", names: list[str]) -> "Plan":
        off = known_names("--without", names, accelerations)
        return train(plan, accelerations=plan.train.accelerations.without(off))

    def budget(name: str) -> Change:
        return lambda plan, value: replace(plan, budget=replace(plan.budget, **{name: value}))

    return {
        "scenes": lambda plan, names: replace(plan, scenes=known_names("--scenes", names, list(CATALOG))),
        "view_set": _with_view_sets,
        "region": lambda plan, region: views(plan, region=region),
        "scene_file": _with_scene_file,
        "render_limit": lambda plan, seconds: replace(plan, render_limit=seconds),
        # a user who names methods wants only these
        "methods": lambda plan, names: replace(
            plan.without_extras(), methods=known_names("--methods", names, method_names())
        ),
        "seeds": lambda plan, count: replace(plan, seeds=tuple(range(count))),
        "first_seed": lambda plan, first: replace(plan, seeds=tuple(range(first, first + len(plan.seeds)))),
        "budget_steps": budget("steps"),
        "budget_seconds": budget("seconds"),
        "budget_core_seconds": budget("core_seconds"),
        "resolution": lambda plan, pixels: views(plan, resolution=pixels),
        "checkpoints": lambda plan, count: replace(plan, score=replace(plan.score, checkpoints=count)),
        "test_views": lambda plan, count: views(plan, test=count),
        "curve_views": lambda plan, count: replace(plan, score=replace(plan.score, curve_views=count)),
        "precision": lambda plan, name: train(plan, precision=name),
        "optimiser": lambda plan, name: plan if name == plan.train.optimiser.name else train(plan, **TUNED[name]),
        "without": without,
    }


def _with_view_sets(plan: "Plan", view_sets: Sequence[Path]) -> "Plan":
    from harness.plan.names import scene_name_of
    from scenes.view_sets.view_set import check_listed

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
    return replace(plan, scenes=tuple(known), view_set=tuple(map(str, view_sets)))


def _with_scene_file(plan: "Plan", file: Path) -> "Plan":
    from scenes.catalog.scene_file import check_scene_file, name_of_file
    from scenes.files.digest import file_digest

    check_scene_file(file)
    return replace(plan, scenes=(name_of_file(file),), scene_file=str(file), scene_file_digest=file_digest(file))


def _with_needs(plan: "Plan", need: list[str], no_need: list[str]) -> "Plan":
    """Return the plan with forced parts; those whose acceleration is off in `plan` count as needed."""
    from harness.plan.names import known_names
    from harness.plan.needed import FORCEABLE, LEFT_OUT_BY, kept
    from harness.plan.profiles import REDUCED_TRAINING
    from harness.plan.settings import GridSettings
    from scenes.modelling.needs import PARTS

    choices = " ".join(FORCEABLE)
    for name_of, names in (("--need", need), ("--no-need", no_need)):
        if fixed := [name for name in names if name in PARTS and name not in FORCEABLE]:
            raise InputError(f"{name_of} {' '.join(fixed)}: cannot be forced; known: {choices}")
    given, out = known_names("--need", need, list(FORCEABLE)), known_names("--no-need", no_need, list(FORCEABLE))
    if both := [name for name in given if name in out]:
        raise InputError(f"--need and --no-need: both have {' '.join(both)}; known: {choices}")
    off = [name for name, acceleration in LEFT_OUT_BY.items() if not getattr(plan.train.accelerations, acceleration)]
    if both := [name for name in off if name in out]:
        names = [LEFT_OUT_BY[name] for name in both]
        raise InputError(f"--no-need {' '.join(both)}: --without {' '.join(names)} keeps it; give one of the options")
    everything = tuple(name for name in FORCEABLE if name in given or name in off)
    train = kept(plan.train, everything)
    if "fine_pass" in out:
        train = replace(train, fine_bins=0)
    if "empty_space" in out and not train.grid.cells:
        train = replace(train, grid=GridSettings())
    if "background_rays" in out and not train.covered_share:
        train = replace(train, covered_share=REDUCED_TRAINING.covered_share)
    return replace(plan, train=train, views=replace(plan.views, need=everything, no_need=out))


def planned_by(options: argparse.Namespace, *say: Callable[[str], None]) -> "tuple[Plan, torch.device]":
    from scenes.view_sets.source import Region

    given = {name.removeprefix("--").replace("-", "_") for name in PLAN_OPTIONS} - {"profile", "device", "view_sets"}
    values = {name: getattr(options, name) for name in given - set(REGION)}
    values["precision"] = None if options.precision == "auto" else options.precision
    require_use(options, "with --view-set", options.view_set is not None, *REGION)
    if seen := [f"--{name}" for name in REGION if getattr(options, name) is not None]:
        try:
            values["region"] = Region(tuple(options.bounds) if options.bounds else None, options.near, options.far)
        except InputError as error:
            raise InputError(f"{' '.join(seen)}: {error}") from error
    plan = planned(options.profile, **values)
    if options.command != "run":  # further methods and the guest explain only the result of a run
        plan = plan.without_extras()
    # last, as it may join a cluster
    device, bfloat16 = device_and_bfloat16(options, *say)
    if options.precision == "auto" and not bfloat16:
        plan = plan.in_float32()
    return plan, device
