"""`python -m harness study evidence | frontier | stability | speed | serving | conformance`."""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.command.gate_command import remember
from harness.command.options import FINISHED_RUN, Command, Options, flag, option, require_between, require_use, shared
from harness.execution.progress import Progress
from harness.plan.defaults import PICK_SECONDS, PLAIN_SECONDS, QUICK_PLAIN_SECONDS
from harness.plan.names import known_names
from scenes.files.errors import InputError

if TYPE_CHECKING:
    from harness.plan.run_plan import Machine
    from harness.studies.framework import Shelf, StudyContext


PUBLISHED_FRONTIER = Path("docs/frontier")


def _shelf(noun: str, out: str, names: str = "--studies") -> Options:
    return {
        names: option(f"{noun} to measure; --list prints them (default: all)", "NAME", nargs="+"),
        **shared("--quick", "--view-sets"),
        "--out": option(f"output folder{out}"),
        **shared("--resume", "--list", "--quiet"),
    }


EVIDENCE: Options = {
    **_shelf(
        "studies", "; the report of a finished run then includes the studies (default: a fresh out/evidence-TIME)"
    ),
    "--device": {},
    "--workers": option("processes (default: one per core, or one on a GPU)", "N", int),
}
FRONTIER: Options = {
    **_shelf("questions", " (default: a fresh out/frontier-TIME)"),
    "--scenes": option("scenes to train on (default: the eight)"),
    "--methods": option("families to compare (default: one of each)"),
    "--budgets": option("core seconds of a cell's training", "S", float, nargs="+"),
    "--seeds": option("number of seeds, 0 … N−1", "N", int),
    "--resolution": option("width of the views"),
    "--quick": option("two scenes, two budgets: about eight minutes"),
    "--long": flag("budgets up to 240 core seconds, larger pictures up to 600, three seeds: a day"),
    "--pick": option("only print the family to choose for a scene, from --out", "SCENE"),
    "--seconds": option(f"core seconds for --pick (default: {PICK_SECONDS:g})", "S", float),
}
STABILITY: Options = {
    **_shelf("cases", " (default: a fresh out/stability-TIME)", "--studies --cases"),
    "--methods": option("methods to measure (default: those worth comparing)"),
}
SPEED: Options = {
    **_shelf("questions", " (default: a fresh out/speed-TIME)", "--studies --items"),
    "--plain-seconds": option(f"training of the plain program in question 3 ({PLAIN_SECONDS:g})", "S", float),
    **shared("--device", "--history"),
}
SERVING: Options = {
    "out": FINISHED_RUN,
    **{name: own for name, own in _shelf("studies", "").items() if name != "--out"},
    **shared("--scenes", "--methods", "--seed"),
    "--width": option("width of the pictures that are timed (default: 100)", "PX", int, default=100),
    "--device": {},
    "--threads": option("threads of rendering (default: 1; more wait for each other on a busy machine)", default=1),
}
CONFORMANCE: Options = {
    "methods": option("methods of the catalogue or of installed packages", "METHOD", nargs="*"),
    "--list": option("print all methods and checks, with their meaning"),
}


def _listed(shelf: "Shelf") -> int:
    from harness.studies.framework import list_lines

    print(*list_lines(shelf), sep="\n")
    return 0


def _measure(
    options: argparse.Namespace,
    show: Progress,
    shelf: "Shelf",
    context: "Callable[..., StudyContext]",
    machine: "Machine",
    *own: object,
    afterwards: Callable[[Path], None] | None = None,
) -> int:
    """Measure the studies that `options` name, in a locked folder; return the exit code. Raises `InputError`. `context`
    takes the fields of `StudyContext` and its `own`; `afterwards` is called before the folder is unlocked.
    """
    from harness.run_folder.folder_lock import locked_folder
    from harness.run_folder.output_folder import fresh_folder
    from harness.studies.framework import run

    if options.resume and options.out is None:
        raise InputError("--resume: name the folder to resume, --out DIR")
    chosen = known_names("--studies", options.studies or list(shelf.studies), list(shelf.studies))
    out = options.out or fresh_folder(shelf.name, resume=False)
    with locked_folder(out):
        made = context(out, options.view_sets, out, options.quick, show, machine, *own)
        code = run(shelf, [name for name in shelf.studies if name in chosen], made, options.resume)
        if afterwards is not None:
            afterwards(out)
    show.line(f"{shelf.noun} in {out / shelf.file}")
    return code


def run_evidence(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.evidence.evidence_studies import SHELF

    require_between(options, workers=(1, 256))
    if options.list:
        return _listed(SHELF)
    from harness.machine.device import available_cores, chosen_device, multiplies_bfloat16
    from harness.plan.run_plan import Machine
    from harness.studies.evidence.evidence_context import EvidenceContext

    device = chosen_device(options.device)
    machine = Machine(device.type, options.workers or (available_cores() if device.type == "cpu" else 1), 1)
    return _measure(options, show, SHELF, EvidenceContext, machine, multiplies_bfloat16(device))


def run_frontier(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.frontier.frontier_studies import SHELF

    require_use(options, "without --quick", not options.quick, "long")
    require_use(options, "with --pick", options.pick is not None, "seconds")
    measuring = "studies", "scenes", "methods", "budgets", "seeds", "resolution", "quick", "long", "resume"
    require_use(options, "without --pick", options.pick is None, *measuring)
    require_between(options, seeds=(1, 100), resolution=(8, 4096), seconds=(0.1, 1e6))
    for budget in options.budgets or ():
        if not 0.1 <= budget <= 1e6:
            raise InputError(f"--budgets {budget:g}: must lie between 0.1 and 1e6 core seconds")
    if options.pick is not None:
        from harness.records.study import read_studies
        from harness.studies.frontier.needs import pick

        record = read_studies((options.out or PUBLISHED_FRONTIER) / SHELF.file)
        print(pick(record.study("needs"), options.pick, options.seconds or PICK_SECONDS))
        return 0
    if options.list:
        return _listed(SHELF)
    from baselines.catalog import CATALOG
    from harness.machine.device import available_cores, chosen_device, multiplies_bfloat16
    from harness.plan.run_plan import Machine
    from harness.studies.frontier.frontier_context import AMOUNTS, FrontierContext
    from scenes.catalog.entries import CATALOG as SCENES

    given: dict[str, Any] = {"resolution": options.resolution}
    if options.scenes:
        given["scenes"] = given["large_scenes"] = known_names("--scenes", options.scenes, list(SCENES))
    if options.methods:
        given["families"] = given["large_families"] = known_names("--methods", options.methods, list(CATALOG))
    if options.budgets:
        given["budgets"] = tuple(sorted(set(options.budgets)))
        given["large_budgets"] = given["budgets"][-1:]
    if options.seeds:
        given["seeds"] = given["phi_seeds"] = tuple(range(options.seeds))
    amount = AMOUNTS["quick" if options.quick else "long" if options.long else "default"]
    amount = replace(amount, **{name: value for name, value in given.items() if value})
    as_planned = multiplies_bfloat16(chosen_device("cpu"))
    return _measure(options, show, SHELF, FrontierContext, Machine("cpu", available_cores(), 1), as_planned, amount)


def run_stability(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.stability.cases import SHELF

    if options.list:
        return _listed(SHELF)
    from baselines.catalog import CATALOG
    from harness.machine.device import available_cores
    from harness.plan.run_plan import Machine
    from harness.studies.stability.stability_context import METHODS, StabilityContext

    methods = known_names("--methods", options.methods or list(METHODS), list(CATALOG))
    cores = available_cores()
    return _measure(options, show, SHELF, StabilityContext, Machine("cpu", cores, cores), methods)


def run_speed(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.speed.questions import SHELF

    require_between(options, plain_seconds=(1, 86400))
    require_use(options, "without --quick", not options.quick, "history")
    if options.list:
        return _listed(SHELF)
    from harness.machine.device import available_cores, chosen_device
    from harness.machine.processor_class import class_here
    from harness.plan.run_plan import Machine
    from harness.studies.speed.speed_context import SpeedContext

    seconds = options.plain_seconds or (QUICK_PLAIN_SECONDS if options.quick else PLAIN_SECONDS)
    # the sizes of `quick` gain nothing from threads, which wait for each other on a busy machine
    machine = Machine(chosen_device(options.device).type, 1, 1 if options.quick else available_cores())

    def append_to_history(out: Path) -> None:
        if not options.quick:
            remember(options.history, out / SHELF.file, class_here(), show)

    return _measure(options, show, SHELF, SpeedContext, machine, seconds, afterwards=append_to_history)


def run_serving(options: argparse.Namespace, show: Progress) -> int:
    from harness.studies.serving.serving_studies import SHELF

    require_between(options, width=(8, 4096), threads=(1, 256))
    if options.list:
        return _listed(SHELF)
    from harness.machine.device import chosen_device
    from harness.plan.run_plan import Machine
    from harness.playback.run_loader import FinishedRun
    from harness.studies.serving.serving_context import ServingContext

    finished = FinishedRun.of(options.out)
    scenes, methods = finished.scenes(options.scenes), finished.methods(options.methods)
    if options.seed not in finished.run.seeds:
        known = " ".join(map(str, finished.run.seeds))
        raise InputError(f"--seed {options.seed}: the run does not have it; it has {known}")
    machine = Machine(chosen_device(options.device).type, 1, options.threads)
    own = finished, scenes, methods, options.seed, options.width
    return _measure(options, show, SHELF, ServingContext, machine, *own)


def run_conformance(options: argparse.Namespace, show: Progress) -> int:
    import torch

    from harness.machine.device import use_threads
    from harness.plan.plugins import method_names, require_methods, title_of
    from harness.studies.conformance.method_checks import CHECKS, conformance, meaning
    from harness.studies.conformance.subject import Subject

    if options.list:
        for line in (*methods_lines(), *(f"check   {name}: {meaning(name)}" for name in CHECKS)):
            show.line(line)
        return 0
    if not options.methods:
        raise InputError("conformance: name at least one method; --list prints them")
    names = known_names("conformance", options.methods, method_names())
    require_methods(names)
    threads, deterministic = torch.get_num_threads(), torch.get_deterministic_debug_mode()
    use_threads(1)
    broken = 0
    try:
        for name in names:
            show.line(f"{name}: {title_of(name)}")
            counts = {"held": 0, "broken": 0, "not applicable": 0}
            for outcome in conformance(Subject(name)):
                counts[outcome.verdict] += 1
                show.line(f"  {outcome.verdict:14} {outcome.check}" + (f": {outcome.reason}" if outcome.reason else ""))
            broken += counts["broken"]
            show.line(f"  {', '.join(f'{count} {verdict}' for verdict, count in counts.items() if count)}")
    finally:
        torch.set_num_threads(threads)
        torch.set_deterministic_debug_mode(deterministic)
    return 3 if broken else 0


def methods_lines() -> list[str]:
    """Return a line per method that can be named; methods of packages without importing them."""
    from baselines.catalog import CATALOG
    from harness.plan.plugins import OURS, offered, said_of

    lines = [f"method  {name}: {CATALOG[name].title}" for name in CATALOG if name in OURS]
    return lines + [f"method  {point.name}: {said_of(point)}" for points in offered().values() for point in points]


STUDIES = {
    "evidence": Command("measure what a verdict depends on", EVIDENCE, run_evidence),
    "frontier": Command("compare families of radiance fields at budgets of core seconds", FRONTIER, run_frontier),
    "stability": Command("try the catalogue of stiff and extreme cases", STABILITY, run_stability),
    "speed": Command("measure how fast training, rendering and scoring are on this machine", SPEED, run_speed),
    "serving": Command("measure view cache, attention and first frame on a finished run", SERVING, run_serving),
    "conformance": Command("hold methods to the contract of the catalogue (exit code 3)", CONFORMANCE, run_conformance),
}
