"""Methods of a user's package, found by entry point: name → `baselines.catalog.Method`.

    [project.entry-points."radiance_verdict.methods"]
    mine = "my_package:METHOD"

A package is imported only when one of its methods is named, and is then trusted like everything that its user has
installed: it runs in this process, with its user's rights. A package cannot take a name of the catalogue.
"""

import csv
import hashlib
import importlib.util
import json
import math
import multiprocessing
import pkgutil
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import EntryPoint, distributions, entry_points
from pathlib import Path, PurePath
from typing import Any, get_args

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG, UNTRAINED, Method
from baselines.composition import ACTIVATIONS, LADDERS, LOSSES, SKIPS, Parts
from baselines.numerics.quadrature import QUADRATURES
from harness.plan.schedule import Decay
from scenes.files.digest import file_digest
from scenes.files.errors import InputError, named
from scenes.files.trial import how_it_ends

GROUP = "radiance_verdict.methods"
OURS = frozenset(CATALOG)
TABLES: list[dict[str, Any]] = [CATALOG, LADDERS, AMPLIFIERS, SKIPS, ACTIVATIONS, LOSSES]
LOAD = "from importlib.metadata import EntryPoint; EntryPoint(*arguments).load()"
NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
"""The form of a method's name, which becomes a part of file names."""
_loaded: dict[str, dict[str, str]] = {}
"""Map method → its package, version, entry point, and the digest of the package's files as they were loaded."""


def offered() -> dict[str, list[EntryPoint]]:
    """Map name → the entry points of that name in all installed packages that can be read; nothing is imported."""
    points: dict[str, list[EntryPoint]] = {}
    for point in _points():
        if point not in points.setdefault(point.name, []):
            points[point.name].append(point)
    return points


def _points() -> Sequence[EntryPoint]:
    try:
        return tuple(entry_points(group=GROUP))
    except (ValueError, TypeError, OSError):  # one package has a fault: read each separately
        points: list[EntryPoint] = []
        for package in distributions():
            with suppress(ValueError, TypeError, OSError):
                points += package.entry_points.select(group=GROUP)
        return points


def method_names() -> list[str]:
    """Return all names that `--methods` accepts: those of the catalogue, then those of packages."""
    return [*CATALOG, *(name for name in offered() if name not in CATALOG)]


def require_methods(names: Iterable[str]) -> None:
    """Load those of `names` that packages offer into the catalogue; other names are ignored. Raises `InputError` for a
    name that is in the catalogue or offered twice, a package that cannot be imported, and an invalid method.
    """
    points = offered()
    for name in names:
        if name in points and name not in _loaded:
            _take(name, points[name])


def method_named(name: str) -> Method:
    """Return a method of the catalogue or of a package; raises `InputError` as `require_methods`, or if unknown."""
    if name in UNTRAINED:
        return UNTRAINED[name]
    if name not in CATALOG:
        require_methods([name])
    if name not in CATALOG:
        raise InputError(f"unknown method {name!r}; known: {' '.join(method_names())}")
    return CATALOG[name]


def own_settings(name: str, given: Mapping[str, object]) -> Any:
    """Return a method's own settings, given or of the catalogue, or None; raises `InputError` as `method_named`."""
    own = given.get(name)
    return method_named(name).settings if own is None else own


def origins(names: Iterable[str]) -> dict[str, object]:
    """Return the entry of a record: `{"plugins": {name: origin}}`, or nothing without methods of packages."""
    packages = {name: dict(_loaded[name]) for name in names if name in _loaded}
    return {"plugins": packages} if packages else {}


def title_of(name: str) -> str:
    """Return the method's title, with its package if it has one."""
    title, origin = method_named(name).title, _loaded.get(name)
    return title if origin is None else f"{title} (package {origin['package']} {origin['version']})"


def _take(name: str, points: list[EntryPoint]) -> None:
    where = " and ".join(said_of(point) for point in points)
    if name in OURS:
        raise InputError(
            f"method {name!r} belongs to radiance-verdict, and {where} offers it as well; rename that entry point or "
            "uninstall the package"
        )
    if len(points) > 1:
        raise InputError(f"method {name!r} is offered by {where}; uninstall one of them")
    point = points[0]
    if not NAME.fullmatch(name):
        raise InputError(f"{where}: a method's name is made of 1 to 64 letters, digits, _ and -; rename it")
    # the parent of a worker has already tried the import
    if multiprocessing.parent_process() is None and (ended := how_it_ends(LOAD, point.name, point.value, GROUP)):
        raise InputError(f"{where}: importing it {ended}; repair the package, or leave its method out")
    before = [dict(table) for table in TABLES]
    try:
        method = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # including SystemExit
        raise InputError(f"{where} cannot be loaded: {named(error)}") from error
    finally:
        replaced = [name for table, was in zip(TABLES, before, strict=True) for name in _restored(table, was)]
    if replaced:
        raise InputError(f"{where}: importing it replaces {replaced[0]!r} of this program; offer another name")
    if wrong := _wrong_with(method):
        raise InputError(f"{where}: {wrong}")
    try:
        package, version = package_of(point)
        origin = {"package": package, "version": version, "entry_point": point.value, "sources": sources_digest(point)}
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise InputError(f"{where}: its files cannot be read ({named(error)}); install it again") from error
    for _, table, own in _named_parts(method):
        table.update(own)
    CATALOG[name] = method
    _loaded[name] = origin


def _restored(table: dict[str, Any], before: dict[str, Any]) -> list[str]:
    """Put back the entries that were replaced in a table; return their names."""
    changed = [name for name, entry in before.items() if table.get(name) is not entry]
    table.update(before)
    return changed


def said_of(point: EntryPoint) -> str:
    return f"package {' '.join(package_of(point))} (entry point {point.name} = {point.value})"


def package_of(point: EntryPoint) -> tuple[str, str]:
    if point.dist is None:
        return "unknown", "?"
    # an incomplete installation has neither
    return str(point.dist.metadata["Name"] or "unknown"), str(point.dist.metadata["Version"] or "?")


def _wrong_in_records(method: Method) -> str | None:
    try:
        json.dumps(None if method.settings is None else asdict(method.settings), allow_nan=False)
    except (TypeError, ValueError) as error:
        return f"its settings are not JSON: {error}"
    if not all(isinstance(text, str) for text in method.deviations) or isinstance(method.deviations, str):
        return "its deviations are not a tuple of sentences"
    try:
        method.deviations_with(method.settings)
    except (KeyError, IndexError, ValueError, TypeError) as error:
        return f"its deviations name what its settings do not have: {named(error)}"
    return None


def _named_parts(method: Method) -> list[tuple[str, dict[str, Any], Mapping[str, Any]]]:
    """Return kind, table and the method's own entries for each part that `Parts` names."""
    return [
        ("encoding", LADDERS, method.ladders),
        ("amplifier", AMPLIFIERS, method.amplifiers),
        ("skip", SKIPS, method.skips),
        ("activation", ACTIVATIONS, method.activations),
        ("loss", LOSSES, method.losses),
    ]


def _wrong_with(method: object) -> str | None:
    if not isinstance(method, Method):
        return f"gives a {type(method).__name__}, not a baselines.catalog.Method"
    if not isinstance(method.title, str) or not method.title.strip():
        return "its method has no title"
    dataclass_facts = getattr(type(method.settings), "__dataclass_params__", None)
    if method.settings is not None and not getattr(dataclass_facts, "frozen", False):
        return f"its settings are of type {type(method.settings).__name__}, not a frozen dataclass"
    if not (isinstance(method.trainer, str) or callable(method.trainer)):
        return f"its trainer is of type {type(method.trainer).__name__}, not a callable or 'module:name'"
    if [method.parts is not None, method.make_field is not None, not method.is_field].count(True) != 1:
        return "gives parts as its settings, make_field, or a trainer: one of them"
    if wrong := _wrong_in_records(method):
        return wrong
    for kind, table, own in _named_parts(method):
        if taken := [name for name in own if name in table and table[name] is not own[name]]:
            return f"its {kind} {taken[0]!r} is taken already; give it another name"
        if method.parts is not None and getattr(method.parts, kind) not in {**table, **own}:
            known = " ".join([*table, *own])
            return f"its {kind} {getattr(method.parts, kind)!r} is unknown; known: {known}"
    if isinstance(method.parts, Parts) and method.parts.quadrature not in QUADRATURES:
        return f"its quadrature {method.parts.quadrature!r} is unknown; known: {' '.join(QUADRATURES)}"
    return None if method.parts is None else _wrong_in_replaced(method.parts)


def _wrong_in_replaced(parts: Parts) -> str | None:
    for name, least in (("depth", 1), ("width", 1), ("warm_up_steps", 0)):
        if (count := getattr(parts, name)) is not None and count < least:
            return f"its {name} {count} is below {least}; leave it out for the run's"
    for name in ("learning_rate", "last_learning_rate"):
        if (rate := getattr(parts, name)) is not None and not 0.0 < rate < math.inf:
            return f"its {name} {rate} is not a positive number; leave it out for the run's"
    if parts.decay not in (None, *get_args(Decay)):
        return f"its decay {parts.decay!r} is unknown; known: {' '.join(get_args(Decay))}"
    return None


@cache
def sources_digest(point: EntryPoint) -> str:
    """Return 64 hexadecimal digits of the names and contents of all files of the package that offers `point`.

    These are the files that its installation lists, and all files in the folder of the entry point's package; in an
    editable installation, which lists no files, also the packages and modules next to that folder. Excluded are files
    of the installer, programs and data outside of the folder of packages, hidden files and Python's caches.

    Raises `OSError`, and `ValueError`, `TypeError` or `csv.Error` if the installer's files cannot be read.
    """
    digest = hashlib.sha256()
    for name, file in sorted(_files(point)):
        digest.update(f"{name} {file_digest(file)}\n".encode())
    return digest.hexdigest()


def _files(point: EntryPoint) -> set[tuple[str, Path]]:
    places = _places(importlib.util.find_spec(point.module.partition(".")[0]))
    listed = []
    if _is_editable(point):
        for folder in {str(place.parent) for place in places}:
            for module in pkgutil.iter_modules([folder]):
                places |= _places(PathFinder.find_spec(module.name, [folder]))
    elif point.dist is not None:
        listed = [file for file in point.dist.files or () if not file.parts[0].endswith((".dist-info", ".egg-info"))]
    files: set[tuple[PurePath, Path]] = {(file, Path(str(file.locate()))) for file in listed}
    for place in places:
        files |= {(file.relative_to(place.parent), file) for file in (place, *place.rglob("*"))}
    return {
        (name.as_posix(), file.resolve())
        for name, file in files
        if file.is_file() and not any(part == "__pycache__" or part.startswith(".") for part in name.parts)
    }


def _places(spec: ModuleSpec | None) -> set[Path]:
    """Return the folders of a package, or the file of a module; an empty set if there is none."""
    if spec is not None and spec.submodule_search_locations is not None:
        return {Path(place) for place in spec.submodule_search_locations}
    return {Path(spec.origin)} if spec is not None and spec.has_location and spec.origin is not None else set()


def _is_editable(point: EntryPoint) -> bool:
    """Return whether the installation is editable (direct_url.json, PEP 610)."""
    text = point.dist.read_text("direct_url.json") if point.dist is not None else None
    recorded = json.loads(text) if text else {}
    return isinstance(recorded, dict) and bool((recorded.get("dir_info") or {}).get("editable"))
