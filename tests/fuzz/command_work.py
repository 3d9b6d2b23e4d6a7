"""Commands in this process up to where their work would begin: parsed and checked by what parses and checks them."""

import contextlib
import importlib
import io
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

WORK = {
    "harness.execution.run": ("run", "view_set_folders"),
    "harness.studies.speed.speed_run": ("run",),
    "harness.studies.stability.stability_context": ("run",),
    "harness.studies.evidence.evidence_context": ("run",),
    "harness.studies.serving.serving_run": ("run",),
    "harness.gate.gate_run": ("run", "renew"),
    "harness.viewer.film.film_making": ("filmed",),
    "harness.execution.cost": ("estimate_lines",),
    "harness.viewer.server": ("application",),
    "harness.studies.conformance.method_checks": ("conformance",),
    "harness.machine.doctor": ("findings",),
    "harness.command.board": ("write_board",),
    "scenes.rendering.store": ("write_view_set",),
}
"""Where options have been read and work would begin."""
LARGEST_WIDTH = 16384
PATIENCE_SECONDS = 100.0


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


def prepare(package: str) -> None:
    """Imports what `called` needs."""
    _stand_ins(package), _page_stand_ins(package)


def called(package: str, arguments: list[str], folder: Path) -> tuple[int | str | None, str]:
    """Exit code and what was said of `python -m PACKAGE ARGUMENTS` in `folder`; 0 where work would begin."""
    module = _home_of(package)
    said, before = io.StringIO(), Path.cwd()
    with _cut_off(package), contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        os.chdir(folder)
        try:
            code: int | str | None = module.main(arguments)
        except SystemExit as ended:
            code = ended.code
        except Reached:
            code = 0
        finally:
            os.chdir(before)
    return code, said.getvalue()


def called_in_process(package: str, arguments: list[str], folder: Path) -> tuple[int, str]:
    """The same by a process of its own, of which nothing is cut off: for what was refused."""
    import subprocess

    root = Path(__file__).parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1", "HOME": str(folder)}
    try:
        done = subprocess.run(
            [sys.executable, "-m", package, *arguments], cwd=folder, env=environment, capture_output=True,
            stdin=subprocess.DEVNULL, timeout=PATIENCE_SECONDS, check=False,
        )  # fmt: skip
    except (ValueError, UnicodeError):  # no system passes such arguments on
        return 2, ""
    return done.returncode, done.stderr.decode("utf-8", "replace")


@contextlib.contextmanager
def _cut_off(package: str) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        for owner, name, new in (*_stand_ins(package), *_page_stand_ins(package)):
            stack.enter_context(mock.patch.object(owner, name, new))
        yield


@cache
def _stand_ins(package: str) -> list[tuple[Any, str, Any]]:
    found: list[tuple[Any, str, Any]] = []
    for module, names in WORK.items():
        if module.startswith(package):
            owner = importlib.import_module(module)
            found += [(owner, name, reached) for name in names]
    main = _home_of(package)
    name = "parser" if hasattr(main, "parser") else "_parser"
    make = getattr(main, name)
    found.append((main, name, lambda: _parser(make)))
    if package == "harness":
        found.append((importlib.import_module("harness.viewer.film.film_plan"), "rendered", lambda cell, camera: None))
        with contextlib.suppress(ImportError):
            found.append((importlib.import_module("ray"), "init", reached))
    if package == "scenes":
        variant, render = (
            importlib.import_module("scenes.rendering.variant"),
            importlib.import_module("scenes.rendering.render"),
        )
        found.append((variant, "_choose", lambda wanted: variant.Variant(wanted or "scalar_rgb", None, "not asked")))
        found.append((render.LoadedScene, "of", staticmethod(loaded)))
    return found


@cache
def _page_stand_ins(package: str) -> list[tuple[Any, str, Any]]:
    """Pages are files of a line: where they go is checked, what is in them is for `tests.fuzz.pages`."""
    if package != "reports":
        return []
    from reports.run import outputs, publish, run_page
    from scenes.files.atomic import write_atomically

    def of_run(records: Any, path: Path, beside: Any = None) -> None:
        write_atomically(path, "a page")

    def of_outputs(found: Any, path: Path) -> str:
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
