"""Command lines of the real parsers with bad values; nothing is trained, rendered or measured."""

import argparse
import contextlib
import importlib
import io
import re
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest import mock

from hypothesis import strategies as st

from harness.command.study_commands import PUBLISHED_FRONTIER
from scenes.files.atomic import write_atomically
from scenes.files.errors import InputError, readable
from scenes.rendering.variant import Variant
from tests.fuzz.spoiling import NASTY

PARSERS = {"harness": ("harness.command.main", "parser"), "scenes": ("scenes.__main__", "_parser"),
           "reports": ("reports.__main__", "parser")}  # fmt: skip
PATHS = ("run", "ball", "new", "new/deep", "run/records/run.json", "nothing there", "/dev/null/x", "/proc/x", "", ".",
         "x" * 300, "ball/../run", "é\n", "ball/train/r_0.png", "run/", "~", "new.png", "new.json")  # fmt: skip
GOOD = {
    "--profile": ("smoke", "reduced"), "--scenes": ("hotdog", "lego", "ball"), "--scene": ("ball",),
    "--methods": ("nerf", "qnerf"), "--without": ("hull", "grid"), "--need": ("view_direction",), "--cases": ("Q1",),
    "--studies": ("calibration",), "--only": ("images", "training.lego"), "--host": ("127.0.0.1", "::1", "1.2.3.4"),
    "--variant": ("scalar_rgb", "auto"), "methods": ("nerf", "qnerf"), "names": ("lego", "hotdog"), "name": ("lego",),
}  # fmt: skip
"""Valid names by option or positional argument."""
OF_THE_PARSER = re.compile(r"argument \S+: |the following arguments are required: |unrecognized arguments:")


class Reached(Exception):
    """The options were accepted, and the work would begin."""


def _reached(*_: Any, **__: Any) -> Any:
    raise Reached


def _loaded(scene: Any, variant: Any, width: int, *_: Any, **__: Any) -> Any:
    """Replace `LoadedScene.of`, which may end the process inside Mitsuba."""
    assert 1 <= width <= 16384, f"a scene of {width} pixels was to be loaded"
    raise Reached


def _write_page(subject: Any, path: Path, *_: Any) -> str:
    """Replace the writing of pages: only their path is tested."""
    write_atomically(path, "a page")
    return "a title"


@cache
def parser_of(package: str) -> argparse.ArgumentParser:
    module, name = PARSERS[package]
    made: argparse.ArgumentParser = getattr(importlib.import_module(module), name)()
    return made


STAND_INS: dict[str, dict[str, Any]] = {
    "harness": {
        **dict.fromkeys((
            "harness.execution.run.run", "harness.execution.ground_truth.view_set_folders",
            "harness.execution.cost.estimate", "harness.studies.framework.run", "harness.gate.gate_run.run",
            "harness.gate.gate_run.renew", "harness.viewer.film.film_making.make_film",
            "harness.viewer.server.application", "harness.studies.conformance.method_checks.conformance",
            "harness.machine.doctor.findings", "harness.run_folder.board.write_board",
            *(["ray.init"] if find_spec("ray") else []),
        ), _reached),
        "harness.viewer.film.film_plan.render_frame": lambda cell, camera: None,
    },
    "scenes": {
        "scenes.rendering.store.write_view_set": _reached,
        "scenes.rendering.variant._choose": lambda wanted: Variant(wanted or "scalar_rgb", None, "not asked"),
        "scenes.rendering.render.LoadedScene.of": staticmethod(_loaded),
    },
    "reports": {
        "reports.run.saving.publish.write_published": _reached,
        "reports.run.run_page.write_page": _write_page,
        "reports.run.outputs.write_outputs_page": _write_page,
    },
}  # fmt: skip
"""Package → the functions that begin the work after the options have been read, and what stands in for them."""


def call(package: str, arguments: list[str], folder: Path) -> None:
    """Call `python -m PACKAGE ARGUMENTS` in `folder`; raises `InputError` for exit code 2."""
    errors, (module, name) = io.StringIO(), PARSERS[package]
    made = parser_of(package)
    with contextlib.ExitStack() as stack:
        for target, new in {**STAND_INS[package], f"{module}.{name}": lambda *_: made}.items():
            stack.enter_context(mock.patch(target, new))
        stack.enter_context(contextlib.redirect_stderr(errors))
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        stack.enter_context(contextlib.chdir(folder))
        try:
            code = importlib.import_module(module).main(arguments)
        except SystemExit as ended:
            code = ended.code
        except Reached:
            code = 0
    if code == 2:
        message = errors.getvalue().strip()
        if message.startswith("usage: "):
            message = message[message.rindex("error:") :]
        raise InputError(re.sub(r"^(error|scenes): ", "", message))
    assert code in (0, 3, 4), f"exit code {code}: {errors.getvalue()[-300:]}"


def names_what_is_wrong(message: str, arguments: list[str], package: str) -> bool:
    """Return whether a refusal starts like the parser's own refusals or with an option of the command, contains a given
    option or an unknown name, or starts with a given or default path.
    """
    if OF_THE_PARSER.match(message):
        return True
    command = _command_of(arguments, package)
    known = {option for action in command._actions for option in action.option_strings}
    given = known & {argument.partition("=")[0] for argument in arguments}
    if message.split(" ")[0].rstrip(":") in known or given & set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", message)):
        return True
    values = [argument for argument in arguments if argument not in given]
    if any(f"unknown {thing}{value!r}"[:200] in message for value in values for thing in ("", "scene ")):
        return True
    defaults = [str(action.default) for action in command._actions if isinstance(action.default, Path)]
    # only the beginning of a long path, as messages are shortened
    paths = [str(Path(value)).strip()[:200] for value in [*values, *defaults, str(PUBLISHED_FRONTIER)]]
    return any(message.startswith((path, readable(path).replace("\n", "\\n"))) for path in paths)


def _command_of(arguments: list[str], package: str) -> argparse.ArgumentParser:
    parser = parser_of(package)
    while named := [inner for name, inner in _commands_of(parser).items() if name in arguments]:
        parser = named[0]
    return parser


def _commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    choices = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(choices[0]) if choices else {}


@st.composite
def command_lines(draw: st.DrawFn, package: str) -> list[str]:
    """Draw a command and some of its options; most values are plausible."""
    parser, words = parser_of(package), []
    while inner := _commands_of(parser):
        words.append(draw(st.sampled_from(sorted(inner))))
        parser = inner[words[-1]]
    for action in parser._actions:
        wanted = action.required or draw(st.integers(0, 4)) == 4
        if not wanted or isinstance(action, argparse._HelpAction):
            continue
        words += action.option_strings[:1]
        most = {None: 1, 0: 0, "?": 1}.get(action.nargs, action.nargs if isinstance(action.nargs, int) else 3)
        count = most if isinstance(action.nargs, int) or action.nargs is None else draw(st.integers(1, most))
        words += [draw(_values(action)) for _ in range(count)]
    # no system passes a NUL, or a surrogate that does not stand for a byte; writing to a requested path is not a fault
    harmless = (("\0", "0"), ("\ud800", "\udcff"), ("../..", ".."), ("/etc/", "/proc/"))
    for before, after in harmless:
        words = [word.replace(before, after) for word in words]
    return words


def _values(action: argparse.Action) -> st.SearchStrategy[str]:
    good = GOOD.get(next(iter(action.option_strings), action.dest), ())
    if action.choices:
        good = tuple(map(str, action.choices))
    elif action.type is Path:
        good = PATHS + ("run", "ball") * 5
    elif not good:
        good = ("1", "3", "0", "-1", "100", "4096", "1000000000", "1e9", "nan", "0.5")
    usual = st.sampled_from(good)
    return st.one_of(*[usual] * 5, st.sampled_from([text for text in NASTY if len(text) < 1000]))
