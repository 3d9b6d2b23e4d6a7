"""A Mitsuba XML file as a scene: the facts that can be read without Mitsuba, and how Mitsuba loads it.

Its shapes, materials and lights are used unchanged. Its sensors, film and integrator are ignored: the cameras are those
of all scenes, about the box of the visible geometry (`scenes.modelling.scene`).

Trust: Mitsuba reads every file that the XML names, anywhere on the disk, in a separate process with the user's rights.
"""

import os
import re
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scenes.files.digest import file_digest
from scenes.files.errors import InputError, short
from scenes.modelling.needs import Need, Needs
from scenes.modelling.normalise import check_unit
from scenes.modelling.placement import Placement, upright
from scenes.modelling.scene import Scene
from scenes.view_sets.viewpoints import Z_AXIS

LARGEST_FILE = 50 * 1024 * 1024
DEEPEST = 15
"""The deepest level of `include`, as in Mitsuba."""
MOST_FILES = 1000
"""The maximum number of included files; a file included twice counts twice: 15 levels of two are 32 768."""
LONGEST_NAME = 4096
LONGEST_VALUE = 1 << 16
"""The maximum length of a value after its defaults are inserted, each of which may hold others."""
MOST_PARTS = 100_000
"""The maximum number of described parts; a part referred to twice counts twice."""
DEEPEST_PART = 8
_PLUGINS = frozenset({"shape", "bsdf", "emitter", "medium", "texture", "volume", "phase"})
_NUMBERS = frozenset({"float", "rgb", "spectrum"})


def xml_scene(file: Path, name: str) -> Scene:
    """Return the scene of an XML file; its images depend on the bytes of that and of every file that it names. Raises
    `InputError`, naming the file, if it is not XML or not a scene.
    """
    reader = _Reader(file)
    if reader.root.tag != "scene":
        raise InputError(f"{file}: its outermost element is <{reader.root.tag}>; a Mitsuba file has <scene>")
    tags = {element.tag for element in reader.elements}
    if "shape" not in tags:
        raise InputError(f"{file}: holds no <shape>, so nothing can be seen; add one")
    if "emitter" not in tags:
        raise InputError(f"{file}: holds no <emitter>, so everything is black; add one, such as a constant one")
    up = reader.up()
    facts = {"type": "scene", "files": reader.files, "up": up.tolist(), **reader.described()}
    title = f"{file.name}, a Mitsuba scene of the user's own"
    return Scene(
        name, title, lambda: {"file": facts}, max_depth=reader.max_depth(), file=file,
        load=lambda mi: loaded(mi, file, up),
    )  # fmt: skip


def notes(scene: Scene) -> list[str]:
    """Return sentences that tell the user how the file is read."""
    if scene.file is None:
        return []
    if scene.load is None:
        return [f"{scene.file} is Python code: it runs with your rights."]
    up = "xyz"[int(np.abs(scene.build()["file"]["up"]).argmax())]
    return [
        f"{scene.file}: Mitsuba reads every file that it names, with your rights. Its sensors and integrator are not "
        f"used: cameras stand about the box of the visible shapes, {up} up."
    ]


def loaded(mi: ModuleType, file: Path, up: np.ndarray) -> tuple[Any, Placement, np.ndarray]:
    """Return Mitsuba's scene, its placement in the view set, and its box [2, 3] in units of the file. Raises
    `InputError` with Mitsuba's message, or if nothing is visible or the scale is invalid.
    """
    try:
        scene = mi.load_file(str(file))
    except RuntimeError as error:
        raise InputError(f"{file}: Mitsuba cannot load it: {short(error)}") from error
    boxes = [shape.bbox() for shape in scene.shapes() if not shape.is_emitter()]
    if not boxes:
        raise InputError(f"{file}: no shape that is seen: those that glow are hidden from the cameras; add another")
    corners = np.array([[box.min, box.max] for box in boxes], dtype=np.float64).reshape(-1, 2, 3)
    extent = np.array([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
    if not np.isfinite(extent).all() or not (extent[1] > extent[0]).any():
        raise InputError(f"{file}: its shapes lie between {extent[0].tolist()} and {extent[1].tolist()}; bound them")
    if not scene.emitters():
        raise InputError(f"{file}: no light, so everything is black; add an <emitter>")
    try:
        check_unit(extent)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    return scene, upright(extent, up), extent


def cautious(known: Needs) -> Needs:
    """Return the needs of a file of which only the kinds of parts are known: needs that numbers decide are set."""
    unknown = {"hdr_metrics"}
    if known["participating_media"].needed:
        unknown |= {"empty_space", "fine_pass", "linear_quadrature", "behind_opaque"}
    reason = "not known of a Mitsuba file"
    return {name: Need(name, True, reason) if name in unknown else need for name, need in known.items()}


class _Reader:
    def __init__(self, file: Path) -> None:
        """Read the file. Raises `InputError` if it, or a file that it includes, cannot be read."""
        self.files: dict[str, str] = {}
        """Map path relative to the outermost file's folder → SHA-256."""
        self.elements: list[ET.Element] = []
        self._file = file
        self._folders = [file.resolve().parent, Path.cwd()]
        """The folders where names are looked for, as in Mitsuba."""
        self._top: list[ET.Element] = []
        self._defaults: dict[str, str] = {}
        self._described = 0
        self._counts: dict[Path, int] = {}
        """The number of files that a file stands for: itself and those it includes."""
        self.root = _parsed(file)
        self._read(file.resolve(), self.root, ())
        for element in self.elements:
            for key in ("value", "filename"):
                for path in self._named(element.get(key, ""), self._file.parent):
                    self._note(path)

    def _read(self, file: Path, root: ET.Element, within: tuple[Path, ...]) -> None:
        within = (*within, file)
        self._note(file)
        self._top.append(root)
        self._counts[file] = 1
        for element in root.iter():
            self.elements.append(element)
            if element.tag == "default":
                self._defaults.setdefault(element.get("name", ""), element.get("value", ""))
            elif element.tag == "path":
                self._folders += [folder / self._plain(element.get("value", "")) for folder in self._folders[:2]]
            elif element.tag == "include":
                self._include(element, within)

    def _include(self, element: ET.Element, within: tuple[Path, ...]) -> None:
        name, file = element.get("filename", ""), within[-1]
        included = self._named(name, file.parent)
        if not included:
            raise InputError(f"{self._file}: includes {self._plain(name)[:200]!r}, which is not there")
        for inner in included:
            if inner in within:
                raise InputError(
                    f"{self._file}: {file.name} includes {inner.name}, which includes it; break the circle"
                )
            if len(within) > DEEPEST:
                raise InputError(f"{self._file}: includes more than {DEEPEST} levels deep; include fewer")
            if inner not in self._counts:
                try:
                    root = _parsed(inner)
                except InputError as error:
                    raise InputError(f"{self._file}: includes {error}") from error
                self._read(inner, root, within)
            self._counts[file] += self._counts[inner]
            if self._counts[file] > MOST_FILES:
                raise InputError(f"{self._file}: includes more than {MOST_FILES} files; include fewer")

    def _named(self, value: str, folder: Path) -> list[Path]:
        """Return all files that a value may mean: an extra one costs a rendering, a missing one an old picture."""
        value = self._plain(value)
        if not value or len(value) > LONGEST_NAME:
            return []
        files = []
        for parent in (folder, *self._folders):
            with suppress(OSError, ValueError, RuntimeError):  # not a path, or a circle of links
                path = (parent / value).resolve()
                if path.is_file() and path not in files:
                    files.append(path)
        return files

    def _note(self, file: Path) -> None:
        name = os.path.relpath(file, self._folders[0])
        if name not in self.files:
            try:
                self.files[name] = file_digest(file)
            except OSError as error:
                raise InputError(f"{file}: cannot be read ({error.strerror})") from error

    def _plain(self, value: str) -> str:
        for name, default in sorted(self._defaults.items(), key=lambda item: -len(item[0])):  # $ab before $a
            times = value.count(f"${name}")
            if times and times * len(default) + len(value) > LONGEST_VALUE:
                raise InputError(f"{self._file}: the default {name!r} makes values too long; shorten it")
            value = value.replace(f"${name}", default)
        return value

    def up(self) -> np.ndarray:
        """Return the upward direction of the first sensor with a place, by its <lookat> or matrices; else z."""
        for element in self.elements:
            if element.tag != "sensor":
                continue
            up = None
            for step in element.findall("./transform/*"):
                up = self._turned(step, np.array([0.0, 1.0, 0.0]) if up is None else up)
            if up is not None and np.isfinite(up).all() and np.abs(up).max() > 0:
                return up
        return Z_AXIS

    def _turned(self, step: ET.Element, up: np.ndarray) -> np.ndarray:
        """Return a direction after one step of a <transform>, as Mitsuba applies it."""

        def numbers(name: str) -> np.ndarray:
            return _floats(self._plain(step.get(name, "")))

        if step.tag == "lookat" and len(given := numbers("up")) == 3:
            return given
        if step.tag == "matrix" and (side := {9: 3, 16: 4}.get(len(values := numbers("value")))):
            return np.asarray(values.reshape(side, side)[:3, :3] @ up)
        if step.tag == "rotate" and len(angle := numbers("angle")) == 1:
            axis = np.array([next(iter(numbers(name)), 0.0) for name in "xyz"])
            axis = axis if np.any(axis) or len(axis := numbers("value")) == 3 else Z_AXIS
            return np.asarray(Rotation.from_rotvec(np.radians(angle) * axis / np.linalg.norm(axis)).apply(up))
        return up

    def max_depth(self) -> int:
        """Return the depth of the file's integrator, at most 64; 8 if it has none or is unlimited."""
        for element in self.elements:
            for inner in element.iter("integer") if element.tag == "integrator" else ():
                value = self._plain(inner.get("value", ""))
                if inner.get("name") == "max_depth" and value.isdecimal():
                    return min(max(int(value), 2), 64) if len(value) < 10 else 64
        return 8

    def described(self) -> dict[str, Any]:
        """Return the types and numbers of all parts, nested as in the file, for `scenes.modelling.needs`."""
        known = {part.get("id"): part for part in self.elements if part.get("id") and part.tag != "ref"}
        parts = [inner for root in self._top for inner in root if inner.tag in _PLUGINS]
        return {f"part {number}": self._entry(part, known, ()) for number, part in enumerate(parts)}

    def _entry(
        self, element: ET.Element, known: dict[str | None, ET.Element], within: tuple[ET.Element, ...]
    ) -> dict[str, Any]:
        within = (*within, element)
        entry: dict[str, object] = {"type": self._plain(element.get("type", "unknown"))}
        self._described += 1
        if self._described > MOST_PARTS:
            raise InputError(f"{self._file}: more than {MOST_PARTS} parts, each counted once per <ref>; share fewer")
        for number, inner in enumerate(element):
            key = inner.get("name") or f"{inner.tag} {number}"
            key = f"{key} {number}" if key == "type" else key
            if inner.tag == "ref":
                inner = known.get(inner.get("id"), inner)
            if any(inner is outer for outer in within):
                raise InputError(f"{self._file}: {inner.get('id')!r} holds itself by a <ref>; break the circle")
            if inner.tag in _PLUGINS and len(within) <= DEEPEST_PART:
                entry[key] = self._entry(inner, known, within)
            elif inner.tag in _NUMBERS and len(values := _floats(self._plain(inner.get("value", "")))):
                entry[key] = values.tolist() if len(values) > 1 else float(values[0])
        return entry


def _parsed(file: Path) -> ET.Element:
    try:
        if file.stat().st_size > LARGEST_FILE:
            raise InputError(f"{file}: more than {LARGEST_FILE} bytes; keep meshes in separate files")
        data = file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from error
    plain = data.replace(b"\0", b"")  # as in UTF-16
    if b"<!DOCTYPE" in plain or b"<!ENTITY" in plain:
        raise InputError(f"{file}: declares a document type or entities, which no scene needs; remove them")
    try:
        root = ET.fromstring(data)
    except (ET.ParseError, ValueError) as error:
        raise InputError(f"{file}: not well-formed XML ({error})") from error
    if root.get("version", "").startswith(("0.", "1.")):  # Mitsuba renames as well: maxDepth is max_depth
        for element in root.iter():
            if element.tag != "default" and (name := element.get("name")):
                element.set("name", re.sub("(?<=[a-z])[A-Z]+", lambda capitals: f"_{capitals[0].lower()}", name))
    return root


def _floats(text: str) -> np.ndarray:
    """Return the numbers separated by commas or blanks, or an empty array if one is not a number."""
    try:
        return np.array([float(part) for part in text.replace(",", " ").split()])
    except ValueError:
        return np.zeros(0)
