"""A user's scene: a Mitsuba XML file, or a Python file that holds `SCENE = Scene(name, title, build)`.

Trust: a Python file is code, and runs with the user's rights, in the process that renders.
"""

import importlib.util
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from scenes.catalog.entries import CATALOG
from scenes.files.digest import digest_of
from scenes.files.errors import InputError
from scenes.files.trial import how_it_ends
from scenes.modelling.scene import Scene

SUFFIXES = (".xml", ".py")
BUILD = """
from pathlib import Path
from scenes.catalog.scene_file import _python_scene
_python_scene(Path(arguments[0])).build()
"""
LONGEST_TITLE = 500
"""The maximum length of a title, as `scenes.view_sets.manifest` reads it."""


def name_of_file(file: Path) -> str:
    """Derive a name for records from the file's: only letters, digits, `-` and `_`, and not in the catalogue."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "-", file.stem).strip("-") or "scene"
    return f"{name}-file" if name in CATALOG else name


def check_scene_file(file: Path) -> None:
    """Raise `InputError` unless the file exists and has the suffix of a scene."""
    if file.suffix.lower() not in SUFFIXES:
        raise InputError(f"--scene-file {file}: name a Mitsuba scene (.xml) or a Python file (.py)")
    if not file.is_file():
        raise InputError(f"--scene-file {file}: no such file")


def scene_from_file(file: Path) -> Scene:
    """Return the scene, under the file's name. Raises `InputError`, naming the file and the reason."""
    check_scene_file(file)
    if file.suffix.lower() == ".xml":
        from scenes.catalog.mitsuba_xml import xml_scene

        return xml_scene(file, name_of_file(file))
    if ended := how_it_ends(BUILD, str(file)):
        raise InputError(f"{file}: {ended}; fix the scene")
    with mistakes_in(file):
        scene = _python_scene(file)
        description = scene.build()
        if not isinstance(description, dict):
            raise InputError(f"{file}: build() gives {type(description).__name__}; it must give a dictionary")
        if digest_of(description) != digest_of(scene.build()):
            raise InputError(f"{file}: build() gives a different result each time; give its random numbers a seed")
        if not isinstance(scene.title, str) or len(scene.title) > LONGEST_TITLE or not scene.title.isprintable():
            raise InputError(f"{file}: title must be printable text of at most {LONGEST_TITLE} characters; change it")
    return replace(scene, name=name_of_file(file), file=file)


def _python_scene(file: Path) -> Scene:
    spec = importlib.util.spec_from_file_location(f"scene_file_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise InputError(f"{file}: cannot be imported; name a Python file (.py)")
    module = importlib.util.module_from_spec(spec)
    folder = str(file.resolve().parent)
    sys.path.insert(0, folder)  # as for a script: neighbouring files can be imported
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    scene = getattr(module, "SCENE", None)
    if not isinstance(scene, Scene):
        raise InputError(f"{file}: holds no SCENE; add SCENE = Scene(name, title, build) (scenes.modelling.scene)")
    return scene


@contextmanager
def mistakes_in(file: Path | None, but: type[Exception] | tuple[()] = ()) -> Iterator[None]:
    """Turn errors inside, except those of types `but`, into an `InputError` that names the file, if one is given."""
    try:
        yield
    except but:
        raise
    except InputError as error:
        if file is None or str(file) in str(error):
            raise
        raise InputError(f"{file}: {error}") from error  # the message names only a part of the scene
    except (Exception, SystemExit) as error:
        if file is None:
            raise
        steps = traceback.extract_tb(error.__traceback__)
        lines = [step.lineno for step in steps if Path(step.filename).resolve() == file.resolve()]
        line = f" in line {lines[-1]}" if lines else ""
        message = " ".join(str(error).split())[:300]
        raise InputError(f"{file}: {type(error).__name__}{line}: {message}; fix the scene") from error
