"""`python -m harness study evidence | frontier | stability | speed | serving | conformance | scaling`: their options,
and what they do.

Nothing heavy is imported to show the help.
"""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.history_command import add_history_option, remember
from harness.command.options import add_finished_run, add_shared, require_between
from harness.plan.defaults import PLAIN_SECONDS, QUICK_PLAIN_SECONDS

if TYPE_CHECKING:
    from harness.execution.progress import Progress
    from harness.studies.framework import Shelf, StudyContext


PUBLISHED_FRONTIER = Path("docs/frontier")
ContextOf = Callable[[Path], "StudyContext"]
"""Output folder → the context of a shelf."""


def _add_shelf_options(
    command: argparse.ArgumentParser,
    shelf: str,
    noun: str,
    *former: str,
    beside: str = "",
    of_a_run: bool = False,
    amount: bool = True,
) -> None:
    """Add the options that every shelf of studies has; the folder of a finished run is named without one, and one with
    an `amount` of its own has no sizes for trying it.
    """
    todo = f"{noun} to do; --list prints them (default: all)"
    command.add_argument("--studies", *former, nargs="+", metavar="NAME", help=todo)
    add_shared(command, *(["--quick"] if amount else []), "--view-sets")
    if not of_a_run:
        add_shared(command, "--out", help=f"output folder{beside} (default: a fresh out/{shelf}-TIME)")
    add_shared(command, "--resume", "--list", "--quiet")


def _run_shelf(options: argparse.Namespace, shelf: "Shelf", show: "Progress", prepare: Callable[[], ContextOf]) -> int:
    """List the studies of `shelf`, or have those that `options` name measured into a locked folder; returns the exit
    code. `prepare` checks the shelf's own options before a folder is made. Raises `InputError`.
    """
    if options.list:  # before anything that imports torch
        from harness.studies.framework import list_lines

        sys.stdout.write("\n".join(list_lines(shelf)) + "\n")
        return 0
    from harness.plan.profiles import known_names
    from harness.run_folder.folder_lock import locked_folder
    from harness.run_folder.output_folder import fresh_folder
    from harness.studies import framework
    from scenes.files.errors import InputError

    if options.resume and options.out is None:
        raise InputError("--resume: name the folder to go on with, --out DIR")
    chosen = known_names("--studies", options.studies or list(shelf.studies), list(shelf.studies))
    studies = [name for name in shelf.studies if name in chosen]
    context_of = prepare()
    options.out = out = options.out or fresh_folder(shelf.name, resume=False)
    with locked_folder(out):
        code = framework.run(shelf, studies, context_of(out), options.resume)
    show.line(f"{shelf.noun} in {out / shelf.file}")
    return code


def add_evidence_options(command: argparse.ArgumentParser) -> None:
    beside = "; that of a finished run gets the studies into its report"
    _add_shelf_options(command, "evidence", "studies", beside=beside)
    add_shared(command, "--device")
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one a core, or one on a GPU)")


def run_evidence(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 3 if a check fails; raises `InputError` for invalid options."""
    from harness.studies.evidence.evidence_studies import SHELF

    require_between(options, workers=(1, 256))

    def prepare() -> ContextOf:
        from harness.machine.device import available_cores, chosen_device, multiplies_bfloat16
        from harness.plan.profiles import Machine
        from harness.studies.evidence.evidence_context import EvidenceContext

        device, cores = chosen_device(options.device), available_cores()
        machine = Machine(device.type, options.workers or (cores if device.type == "cpu" else 1), 1)
        sets, as_planned = options.view_sets, multiplies_bfloat16(device)
        return lambda out: EvidenceContext(out, sets, out, options.quick, show, machine, as_planned)

    return _run_shelf(options, SHELF, show, prepare)


def add_frontier_options(command: argparse.ArgumentParser) -> None:
    _add_shelf_options(command, "frontier", "questions", amount=False)
    add_shared(command, "--scenes", help="scenes to train on (default: the eight)")
    add_shared(command, "--methods", help="families to compare (default: one of each)")
    command.add_argument("--budgets", nargs="+", type=float, metavar="S", help="core seconds of a cell's training")
    command.add_argument("--seeds", type=int, metavar="N", help="number of seeds, 0 … N−1")
    add_shared(command, "--resolution", help="width of the views")
    size = command.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="two scenes, two budgets: about eight minutes")
    size.add_argument("--long", action="store_true", help="seven budgets up to 600 core seconds, three seeds")
    command.add_argument("--pick", metavar="SCENE", help="print the family to take for a scene, from --out, do nothing")
    command.add_argument("--seconds", type=float, default=60.0, metavar="S", help="core seconds for --pick (60)")


def run_frontier(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 3 if a check fails; raises `InputError` for invalid options."""
    from harness.studies.frontier.frontier_studies import SHELF
    from scenes.files.errors import InputError

    require_between(options, seeds=(1, 100), resolution=(8, 4096), seconds=(0.1, 1e6))
    for budget in options.budgets or ():
        if not 0.1 <= budget <= 1e6:
            raise InputError(f"--budgets {budget:g}: must lie between 0.1 and 1e6 core seconds")
    if options.pick is not None:
        from harness.records.study import read_studies
        from harness.studies.frontier.needs import pick

        record = read_studies((options.out or PUBLISHED_FRONTIER) / SHELF.file)
        print(pick(record.study("needs"), options.pick, options.seconds))
        return 0

    def prepare() -> ContextOf:
        from dataclasses import replace

        import torch

        from baselines.catalog import CATALOG
        from harness.machine.device import available_cores, multiplies_bfloat16
        from harness.plan.profiles import Machine, known_names
        from harness.studies.frontier.frontier_context import AMOUNTS, FrontierContext
        from scenes.catalog.entries import CATALOG as SCENES

        amount = AMOUNTS["quick" if options.quick else "long" if options.long else "default"]
        if options.scenes:
            amount = replace(amount, scenes=known_names("--scenes", options.scenes, list(SCENES)))
        if options.methods:
            amount = replace(amount, families=known_names("--methods", options.methods, list(CATALOG)))
        if options.budgets:
            amount = replace(amount, budgets=tuple(sorted(set(options.budgets))))
        if options.seeds:
            seeds = tuple(range(options.seeds))
            amount = replace(amount, seeds=seeds, phi_seeds=seeds)
        if options.resolution:
            amount = replace(amount, resolution=options.resolution)
        machine, as_planned = Machine("cpu", available_cores(), 1), multiplies_bfloat16(torch.device("cpu"))
        return lambda out: FrontierContext(out, options.view_sets, out, False, show, machine, as_planned, amount)

    return _run_shelf(options, SHELF, show, prepare)


def add_stability_options(command: argparse.ArgumentParser) -> None:
    _add_shelf_options(command, "stability", "cases", "--cases")
    add_shared(command, "--methods", help="methods to try them on (default: those worth comparing)")


def run_stability(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 3 if a case that must pass failed; raises `InputError` for invalid options."""
    from harness.studies.stability.cases import SHELF

    def prepare() -> ContextOf:
        from baselines.catalog import CATALOG
        from harness.machine.device import available_cores
        from harness.plan.profiles import Machine, known_names
        from harness.studies.stability.stability_context import METHODS, StabilityContext

        methods = known_names("--methods", options.methods or list(METHODS), list(CATALOG))
        sets, cores = options.view_sets, available_cores()
        machine = Machine("cpu", cores, cores)
        return lambda out: StabilityContext(out, sets, out, options.quick, show, machine, methods)

    return _run_shelf(options, SHELF, show, prepare)


def add_speed_options(command: argparse.ArgumentParser) -> None:
    _add_shelf_options(command, "speed", "questions", "--items")
    usual = f"training of the plain side, question 3 ({PLAIN_SECONDS:g})"
    command.add_argument("--plain-seconds", type=float, metavar="S", help=usual)
    add_shared(command, "--device")
    add_history_option(command)


def run_speed(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0; raises `InputError` for invalid options."""
    from harness.studies.speed.questions import SHELF

    require_between(options, plain_seconds=(1, 86400))

    def prepare() -> ContextOf:
        from harness.machine.device import available_cores, chosen_device
        from harness.plan.profiles import Machine
        from harness.studies.speed.speed_context import SpeedContext

        seconds = options.plain_seconds or (QUICK_PLAIN_SECONDS if options.quick else PLAIN_SECONDS)
        # sizes of `quick` gain nothing from threads, which wait for each other on a machine that does something else
        machine = Machine(chosen_device(options.device).type, 1, 1 if options.quick else available_cores())
        sets = options.view_sets
        return lambda out: SpeedContext(out, sets, out, options.quick, show, machine, seconds)

    code = _run_shelf(options, SHELF, show, prepare)
    if not options.list and not options.quick:
        from harness.machine.processor_class import class_here

        remember(options.history, options.out / SHELF.file, class_here(), show)
    return code


def add_serving_options(command: argparse.ArgumentParser) -> None:
    add_finished_run(command)
    _add_shelf_options(command, "serving", "studies", of_a_run=True)
    add_shared(command, "--scenes", "--methods", "--seed")
    width = "of the pictures that are timed (default: 100)"
    command.add_argument("--width", type=int, default=100, metavar="PX", help=width)
    add_shared(command, "--device")
    add_shared(command, "--threads", default=1, help="of rendering (default: 1; more wait for a busy machine)")


def run_serving(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 3 if a study or a check of ours fails; raises `InputError` for invalid options."""
    from harness.studies.serving.serving_studies import SHELF

    require_between(options, width=(8, 4096), threads=(1, 256))

    def prepare() -> ContextOf:
        from harness.machine.device import chosen_device
        from harness.plan.profiles import Machine
        from harness.playback.run_loader import FinishedRun
        from harness.studies.serving.serving_context import ServingContext
        from scenes.files.errors import InputError

        finished = FinishedRun.of(options.out)
        scenes, methods = finished.scenes(options.scenes), finished.methods(options.methods)
        if options.seed not in finished.run.seeds:
            known = " ".join(map(str, finished.run.seeds))
            raise InputError(f"--seed {options.seed}: the run does not have it; it has {known}")
        machine = Machine(chosen_device(options.device).type, 1, options.threads)
        return lambda out: ServingContext(
            out, options.view_sets, out, options.quick, show, machine,
            finished, scenes, methods, options.seed, options.width,
        )  # fmt: skip

    return _run_shelf(options, SHELF, show, prepare)


def add_conformance_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("methods", nargs="*", metavar="METHOD", help="of the catalogue or of an installed package")
    command.add_argument("--list", action="store_true", help="print all methods and checks, with what they mean")


def run_conformance(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 3 if a check is broken. Raises `InputError` for a method that does not exist or cannot be loaded."""
    import torch

    from harness.machine.device import use_threads
    from harness.plan.plugins import method_names, require_methods, title_of
    from harness.plan.profiles import known_names
    from harness.studies.conformance.method_checks import CHECKS, conformance, meaning
    from harness.studies.conformance.subject import Subject
    from scenes.files.errors import InputError

    if options.list:
        for line in methods_lines():
            show.line(line)
        for name in CHECKS:
            show.line(f"check   {name}: {meaning(name)}")
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
    """Return all methods that can be named; those of packages by package, which is not imported for it."""
    from baselines.catalog import CATALOG
    from harness.plan.plugins import OURS, offered, said_of

    ours = [f"method  {name}: {CATALOG[name].title}" for name in CATALOG if name in OURS]
    return ours + [f"method  {point.name}: {said_of(point)}" for points in offered().values() for point in points]


def add_scaling_options(command: argparse.ArgumentParser) -> None:
    measured = "what `nox -s speed` measured here"
    command.add_argument("--speed", type=Path, default=Path("docs/speed.json"), metavar="FILE", help=measured)


def run_scaling(options: argparse.Namespace, show: "Progress") -> int:
    """Print the page; raises `DamagedRecord` or `InputError` for a file that does not say enough."""
    from harness.records.study import read_studies
    from harness.studies.speed.full_setting import page

    sys.stdout.write(page(read_studies(options.speed)))
    return 0
