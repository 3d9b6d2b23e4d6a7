"""`python -m harness conformance METHOD …`: its options, and what they do."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.progress import Progress


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("methods", nargs="*", metavar="METHOD", help="of the catalogue or of an installed package")
    command.add_argument("--list", action="store_true", help="print all methods and checks, with what they mean")


def run_conformance(options: argparse.Namespace, show: "Progress") -> int:
    """0, or 3 where a check is broken. Raises `InputError` for a method that nobody has or that cannot be loaded."""
    import torch

    from harness.conformance.catalog import CHECKS, conformance, meaning
    from harness.conformance.subject import Subject
    from harness.device import use_threads
    from harness.plan import known_names
    from harness.plugins import method_names, require_methods, title_of
    from scenes.errors import InputError

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
    """All methods that can be named; those of packages by package, which is not imported for it."""
    from baselines.catalog import CATALOG
    from harness.plugins import OURS, offered, said_of

    ours = [f"method  {name}: {CATALOG[name].title}" for name in CATALOG if name in OURS]
    return ours + [f"method  {point.name}: {said_of(point)}" for points in offered().values() for point in points]
