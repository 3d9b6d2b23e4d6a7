"""Every option of the commands, with values that nobody should give; nothing is trained, rendered or measured.

An input is the JSON list of a command line's arguments. A refusal names an option that was given or is missing, or a
file.
"""

import argparse
import contextlib
import importlib
import io
import json
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from harness.command.study_commands import PUBLISHED_FRONTIER
from reports.run import outputs, run_page
from reports.run.saving import publish
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError, readable
from tests.fuzz.mutations import NUMBERS, TEXTS
from tests.fuzz.readers import NotTried
from tests.fuzz.watch import Fault, kind_of_refusal

PATHS = ("run", "ball", "new", "new/deep", "run/records/run.json", "nothing there", "/dev/null/x", "/proc/x", "",
         "x" * 300, "ball/../run", "é\n", "ball/train/r_0.png", ".", "run/", "~", "new.png", "new.npz", "new.json",
         "ball/transforms_train.json")  # fmt: skip
HOSTS = ("127.0.0.1", "::1", "0.0.0.0", "", "1.2.3.4", "x" * 300, "é" * 70)
GOOD = {
    "--profile": ("smoke", "reduced"), "--scenes": ("hotdog", "lego", "ball"), "--scene": ("ball",), "--seed": ("0",),
    "--methods": ("nerf", "qnerf"), "--frames": ("1", "3"), "--width": ("16",), "--resolution": ("16",),
    "--without": ("fused", "grid"), "--need": ("view_direction",), "--no-need": ("empty_space",), "--cases": ("Q1",),
    "--studies": ("calibration",), "--only": ("images", "training.lego"), "--items": ("1", "2"), "--port": ("0",),
    "--view-set": ("ball",), "--view-sets": (".",), "--out": ("new",),
    "--variant": ("scalar_rgb", "auto"), "--folders": ("ball",), "--spp": ("2", "4"), "--page": ("new.html",),
    "methods": ("nerf", "qnerf"), "names": ("lego", "hotdog"), "name": ("lego",), "folder": ("ball",),
    "out": ("run", "new.png", "new"), "run": ("run",),
}  # fmt: skip
"""By option, or by the name of what has none."""
OF_THE_PARSER = re.compile(r"(argument \S+: |the following arguments are required: |unrecognized arguments:)")


def mutate(package: str) -> Callable[[Random, bytes], bytes]:
    """Makes a command line of a package; nothing of the valid input, which is none."""
    return lambda random, valid: _arguments(random, parser_of(package))


def place(package: str) -> Callable[[Path, str, bytes], None]:
    """What takes the place of the work is imported here: reading is watched, importing takes as long as it takes."""

    def placed(folder: Path, file: str, data: bytes) -> None:
        _stand_ins(package)
        (folder / "arguments.json").write_bytes(data)

    return placed


def reader(package: str) -> Callable[[Path], None]:
    """Return `python -m PACKAGE ARGUMENTS`, in the folder that it gets."""

    def read(folder: Path) -> None:
        arguments = json.loads((folder / "arguments.json").read_bytes())
        if not isinstance(arguments, list) or not all(isinstance(argument, str) for argument in arguments):
            raise NotTried("no arguments")
        code, printed = called(package, arguments, folder)
        if code == 2:
            text = refusal_in(printed)
            if not names_its_option(text, arguments, package):
                raise Fault(f"a refusal that names neither option nor file, {kind_of_refusal(text)}: {text[:200]!r}")
            raise InputError(f"error: {text}")
        assert code in (0, 3, 4), f"exit code {code} for {arguments}: {printed[-300:]}"

    return read


def refusal_in(printed: str) -> str:
    """Return a refusal without the list of all options that argparse shows first, and without the program's name."""
    text = printed.strip()
    if text.startswith("usage: "):
        text = text[text.rindex("error:") :]
    return re.sub(r"^(error|scenes): ", "", text)


def names_its_option(text: str, arguments: list[str], package: str) -> bool:
    """Tell whether a refusal starts as the parser's own do or with an option of the command, holds an option that was
    given, tells the name that is unknown, or starts with a path that was given or that is meant where none is.
    """
    if OF_THE_PARSER.match(text):
        return True
    command = command_of(arguments, package)
    known = {option for action in command._actions for option in action.option_strings}
    options = known & {argument.partition("=")[0] for argument in arguments}
    if text.split(" ")[0].rstrip(":") in known or options & set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)):
        return True
    defaults = [str(action.default) for action in command._actions if isinstance(action.default, Path)]
    values = [argument for argument in arguments if argument not in options]
    if any(f"unknown {thing}{value!r}"[:200] in text for value in values for thing in ("", "scene ")):
        return True
    # the beginning of a long one, as messages are cut; the folder itself holds the arguments
    meant = [*values, *defaults, "arguments.json", str(PUBLISHED_FRONTIER)]
    paths = [str(Path(value)).strip()[:200] for value in meant]
    return any(text.startswith((path, readable(path).replace("\n", "\\n"))) for path in paths)


def command_of(arguments: list[str], package: str) -> argparse.ArgumentParser:
    """Return the parser of the command that is named, and of the study within it; or the whole parser."""
    parser: argparse.ArgumentParser = parser_of(package)
    while inner := commands_of(parser):
        named = [inner[name] for name in arguments if name in inner]
        named += [part for group in map(commands_of, inner.values()) for name, part in group.items()
                  if name in arguments]  # fmt: skip
        if not named:
            break
        parser = named[0]
    return parser


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    choices = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(choices[0]) if choices else {}


def _arguments(random: Random, parser: argparse.ArgumentParser) -> bytes:
    """A command and some of its options; most values are such as somebody might give."""
    arguments: list[str] = []
    while inner := commands_of(parser):
        command = random.choice(list(inner))
        arguments.append(command if random.randrange(30) else random.choice(TEXTS))
        parser = inner[command]
    actions = [action for action in parser._actions if not isinstance(action, argparse._HelpAction)]
    often = random.choice((3, 6))  # with many options it is mostly the parser that refuses one
    for action in actions:
        if action.required or random.randrange(often) == 0:
            arguments += ([random.choice(action.option_strings)] if action.option_strings else []) + [
                _value(random, action) for _ in range(_count(random, action))
            ]
    if random.randrange(10) == 0:
        arguments.insert(random.randrange(len(arguments) + 1), random.choice(TEXTS))
    # no system passes on a NUL, and of halves of characters those alone that stand for a byte; and what is written
    # where somebody wants it is no fault
    arguments = [
        argument.replace("\0", "0").replace("\ud800", "\udcff").replace("../..", "..").replace("/etc/", "/proc/")
        for argument in arguments
    ]
    return json.dumps(arguments).encode("utf-8", "surrogatepass")


def _count(random: Random, action: argparse.Action) -> int:
    if isinstance(action.nargs, int):
        return action.nargs if random.randrange(6) else random.randrange(action.nargs + 2)
    return random.choice((1, 1, 1, 2, 3)) if action.nargs in ("+", "*") else 1


def _value(random: Random, action: argparse.Action) -> str:
    name = next(iter(action.option_strings), action.dest)
    if random.randrange(6) == 0:
        return str(random.choice((random.choice(TEXTS), random.choice(NUMBERS[:20]), random.choice(NUMBERS[22:]))))
    if name == "--host":
        return random.choice(HOSTS)
    if action.choices:
        return str(random.choice(list(action.choices)))
    if action.type is Path:
        return random.choice((*PATHS, *GOOD.get(name, ("run",)) * 8))
    if action.type in (int, float):
        return str(random.choice((*GOOD.get(name, ("1", "3")) * 4, 0, -1, 8, 100, 4096, 10**9, "1e9")))
    return random.choice(GOOD.get(name, TEXTS))


# --- commands in this process up to where their work would begin

WORK = {
    "harness.execution.run": ("run",),
    "harness.execution.ground_truth": ("view_set_folders",),
    "harness.studies.framework": ("run",),
    "harness.gate.gate_run": ("run", "renew"),
    "harness.viewer.film.film_making": ("filmed",),
    "harness.execution.cost": ("estimate_apart",),
    "harness.viewer.server": ("application",),
    "harness.studies.conformance.method_checks": ("conformance",),
    "harness.machine.doctor": ("findings",),
    "harness.run_folder.board": ("write_board",),
    "scenes.rendering.store": ("write_view_set",),
}
"""Where options have been read and work would begin."""
LARGEST_WIDTH = 16384


class Reached(Exception):
    """The options were accepted: here the work would begin."""


def reached(*_: Any, **__: Any) -> Any:
    raise Reached


def loaded(scene: Any, variant: Any, width: int, *_: Any, **__: Any) -> Any:
    """In the place of `LoadedScene.of`, which Mitsuba would end in its own way."""
    assert 1 <= width <= LARGEST_WIDTH, f"a scene of {width} pixels was to be loaded"
    raise Reached


def _home_of(package: str) -> Any:
    """The module in which options are read."""
    return importlib.import_module("harness.command.main" if package == "harness" else f"{package}.__main__")


def parser_of(package: str) -> Any:
    """Its real parser, made once."""
    module = _home_of(package)
    return _parser(getattr(module, "parser", None) or module._parser)


@cache
def _parser(make: Callable[[], Any]) -> Any:
    return make()


def called(package: str, arguments: list[str], folder: Path) -> tuple[int | str | None, str]:
    """Return exit code and errors of `python -m PACKAGE ARGUMENTS` in `folder`; 0 where work would begin."""
    module = _home_of(package)
    errors = io.StringIO()
    with contextlib.ExitStack() as stack:
        for owner, name, new in _stand_ins(package):
            stack.enter_context(mock.patch.object(owner, name, new))
        stack.enter_context(contextlib.redirect_stderr(errors))
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        stack.enter_context(contextlib.chdir(folder))
        try:
            code: int | str | None = module.main(arguments)
        except SystemExit as ended:
            code = ended.code
        except Reached:
            code = 0
    return code, errors.getvalue()


@cache
def _stand_ins(package: str) -> list[tuple[Any, str, Any]]:
    replaced: list[tuple[Any, str, Any]] = []
    for module, names in WORK.items():
        if module.startswith(package):
            owner = importlib.import_module(module)
            replaced += [(owner, name, reached) for name in names]
    main = _home_of(package)
    name = "parser" if hasattr(main, "parser") else "_parser"
    make = getattr(main, name)
    replaced.append((main, name, lambda *_: _parser(make)))
    if package == "harness":
        replaced.append(
            (importlib.import_module("harness.viewer.film.film_plan"), "rendered", lambda cell, camera: None)
        )
        with contextlib.suppress(ImportError):
            replaced.append((importlib.import_module("ray"), "init", reached))
    if package == "scenes":
        variant = importlib.import_module("scenes.rendering.variant")
        render = importlib.import_module("scenes.rendering.render")
        replaced.append((variant, "_choose", lambda wanted: variant.Variant(wanted or "scalar_rgb", None, "not asked")))
        replaced.append((render.LoadedScene, "of", staticmethod(loaded)))
    return replaced + (_page_stand_ins() if package == "reports" else [])


def _page_stand_ins() -> list[tuple[Any, str, Any]]:
    """Pages are files of a line: where they go is checked, what is in them is for `tests.fuzz.pages`."""

    def of_run(records: Any, path: Path, beside: Any, shown: Any) -> None:
        write_atomically(path, "a page")

    def of_outputs(outputs: Any, path: Path) -> str:
        write_atomically(path, "a page")
        return "a title"

    def published(records: Any, folder: Path, beside: Any = None) -> list[Path]:
        folder.mkdir(parents=True, exist_ok=True)
        publish.write_summary(records, folder / "summary.json", beside)
        return []

    return [
        (run_page, "write_page", of_run), (outputs, "write_outputs_page", of_outputs),
        (publish, "write_published", published),
    ]  # fmt: skip
