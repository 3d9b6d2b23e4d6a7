"""Corrupt input to all readers of files and options is read, or refused with a message that names it; it never causes a
traceback, a hang, unlimited memory, or a file elsewhere.

Here each reader gets a few inputs, always the same. `nox -s fuzz` gives it thousands, `-k NAME` selects a reader. An
input that reveals a fault is kept in `.hypothesis` and tested first the next time; a repaired fault gets a line in
`FAULTS`.
"""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.catalog.mitsuba_xml import loaded
from scenes.files.errors import InputError
from tests.fuzz import material
from tests.fuzz.commands import PARSERS, call, command_lines, names_what_is_wrong
from tests.fuzz.readers import READERS, REFUSALS
from tests.fuzz.spoiling import FINITE, archived, members, reseal, spoilt
from tests.fuzz.watch import LIMITS, Watch, fault_of

pytestmark = pytest.mark.filterwarnings("ignore")
CHOSEN = settings.get_profile("fuzz" if settings.get_current_profile_name() == "fuzz" else "brief")
SLOW = [pytest.mark.slow, pytest.mark.thorough]
INSTEAD: dict[str, Callable[[Path], object]] = {
    "nothing": lambda path: None,
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to its folder": lambda path: path.symlink_to("."),
    "a link out of the folder": lambda path: path.symlink_to("/etc/hostname"),
    "a link to what has no end": lambda path: path.symlink_to("/dev/zero"),
    "a large file": lambda path: (path.touch(), os.truncate(path, 60 << 20)),
}
"""Replacements of a file or a folder."""


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def watch(scratch: Path) -> Iterator[Watch]:
    watch, before = Watch(scratch), sys.dont_write_bytecode
    sys.dont_write_bytecode = True  # bytecode of late imports is not a file written by an input
    yield watch
    watch.watching, sys.dont_write_bytecode = False, before


def remove(path: Path) -> None:
    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink(missing_ok=True)


def valid(make: Callable[[Path], object], scratch: Path) -> Path:
    """Return the folder of a maker, made once."""
    folder = scratch / "valid" / getattr(make, "__name__", str(id(make)))
    if not folder.exists():
        make(folder)
    return folder


def tried(name: str, scratch: Path, watch: Watch, spoil: Callable[[Path, Path], str]) -> bool:
    """Return whether a copy is read after `spoil` has changed a file in it; `spoil` returns the path of that file."""
    reader, whole, copy = READERS[name], valid(READERS[name].make, scratch), scratch / name
    remove(copy)
    shutil.copytree(whole, copy)
    file = copy / spoil(whole, copy)
    is_read = watch.is_read(lambda: reader.read(copy, file), REFUSALS, (*reader.names, file.name))
    assert is_read or not reader.misses, "refused instead of ignored"
    return is_read


def files_of(name: str, whole: Path) -> list[str]:
    paths = [path for path in sorted(whole.glob(READERS[name].files)) if path.is_file()]
    assert paths, f"{name}: nothing is {READERS[name].files}"
    return [path.relative_to(whole).as_posix() for path in paths]


NAMES = [pytest.param(name, marks=SLOW if reader.slow else []) for name, reader in READERS.items()]


@pytest.mark.parametrize("name", NAMES)
@CHOSEN
@given(data=st.data())
def test_corrupt_input_is_read_or_refused_with_a_reason(
    name: str, scratch: Path, watch: Watch, data: st.DataObject
) -> None:
    def spoil(whole: Path, copy: Path) -> str:
        files = files_of(name, whole)
        if READERS[name].anything and data.draw(st.integers(0, 2)) == 2:
            folders = {parent.as_posix() for file in files for parent in Path(file).parents} - {"."}
            path, what = data.draw(st.sampled_from([*files, *sorted(folders)])), data.draw(st.sampled_from([*INSTEAD]))
            remove(copy / path)
            INSTEAD[what](copy / path)
            return path
        file = data.draw(st.sampled_from(files))
        (copy / file).write_bytes(data.draw(spoilt(whole / file)))
        if data.draw(st.booleans()):
            reseal(copy, copy / file)
        return file

    tried(name, scratch, watch, spoil)


@pytest.mark.parametrize("name", NAMES)
def test_valid_input_is_read_and_resealing_changes_nothing(name: str, scratch: Path, watch: Watch) -> None:
    for file in files_of(name, valid(READERS[name].make, scratch))[: 1 if READERS[name].slow else None]:

        def sealed(whole: Path, copy: Path, file: str = file) -> str:
            reseal(copy, copy / file)
            return file

        assert tried(name, scratch, watch, sealed), file


# --- former faults


def put(value: Any, *place: str | int) -> Callable[[bytes], bytes]:
    def change(data: bytes) -> bytes:
        whole = here = json.loads(data)
        for step in place[:-1]:
            here = here[step]
        here[place[-1]] = value
        return json.dumps(whole).encode()

    return change


def inside(text: str) -> Callable[[bytes], bytes]:
    ball = '<shape type="sphere"><bsdf type="diffuse"/></shape><emitter type="constant"/>'
    return lambda _: f'<scene version="3.0.0">{text}{ball}</scene>'.encode()


def scene(title: str, ball: str) -> Callable[[bytes], bytes]:
    program = f"from scenes.modelling.scene import Scene\nSCENE = Scene('a', {title}, lambda: {{'ball': {ball}}})\n"
    return lambda _: program.encode()


def with_shape(data: bytes) -> bytes:
    arrays = members(data)
    arrays["images.npy"] = arrays["images.npy"].replace(b"'shape': (10,", b"'shape': (True,")
    return archived(arrays)


POINTS, REQUEST = "fuzzed_method-1.2.dist-info/entry_points.txt", "request.json"
GROWING = "".join(f'<default name="v{i:02}" value="{f"$v{i + 1:02}" * 9}"/>' for i in range(20))
FAULTS: dict[str, tuple[str, str, Callable[[bytes], bytes]]] = {
    "nested deeply": ("limits", "limits.json", lambda _: b"[" * 5000),
    "a control character in a kind": ("limits", "limits.json", put({"\x1b[31m": 1}, "kinds", "images")),
    "beyond a float": ("limits", "limits.json", put([10**400], "values", "families.planes")),
    "a box of text": ("own_view_set", "view_set.json", put("x", "bounds")),
    "needs of another kind": ("own_view_set", "view_set.json", put([{"what": "x"}], "needs")),
    "views without noise": ("own_view_set", "view_set.json", put({}, "views", "train/r_0")),
    "a curve of no method": ("records", "records/targets.json", put("nan", "curves", 0, "method")),
    "a line without files": ("journal", "rendered.jsonl", lambda data: data.replace(b'"files"', b'"file"')),
    "a line without value": ("entry_points", POINTS, lambda data: data.replace(b"= fuzzed_method:METHOD", b"")),
    "points that are not UTF-8": ("entry_points", POINTS, lambda data: data.replace(b"method:", b";\xda")),
    "a truth value in a shape": ("tiny_nerf", "tiny.npz", with_shape),
    "a control character in a key": ("request", REQUEST, put(0.5, "attention", "a\0b")),
    "half a character in a key": ("request", REQUEST, put(0.5, "attention", "\ud800")),
    "an extent that is not finite": ("scene_file", "mine.py", scene("'t'", "{'type': 'sphere', 'radius': 1e400}")),
    "a class for a part": ("scene_file", "mine.py", scene("'t'", "{'type': 'sphere', 'bsdf': Scene}")),
    "a type that is a list": ("scene_file", "mine.py", scene("'t'", "{'type': 'sphere', 'bsdf': {'type': []}}")),
    "no title": ("scene_file", "mine.py", scene("None", "{'type': 'sphere'}")),
    "defaults that grow": ("scene_file", "mine.xml", inside(f'{GROWING}<include filename="$v00"/>')),
    "an endless name": ("scene_file", "mine.xml", inside(f'<include filename="{"x" * 300}"/>')),
    "a part called type": ("scene_file", "mine.xml", inside('<shape type="cube"><bsdf name="type" type="x"/></shape>')),
    "a part of itself": ("scene_file", "mine.xml",
                         inside('<bsdf type="twosided" id="a">' + '<ref id="a"/>' * 40 + "</bsdf>")),
}  # fmt: skip
"""Former fault → reader, file, and its change; checksums are corrected."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_former_fault_does_not_return(fault: str, scratch: Path, watch: Watch) -> None:
    name, file, change = FAULTS[fault]

    def spoil(whole: Path, copy: Path) -> str:
        before = (whole / file).read_bytes()
        (copy / file).write_bytes(change(before))
        reseal(copy, copy / file)
        assert (copy / file).read_bytes() != before
        return file

    tried(name, scratch, watch, spoil)


# --- command lines, and boxes as Mitsuba measures them


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("package", PARSERS)
@CHOSEN
@given(data=st.data())
def test_options_are_accepted_or_refused_by_name(
    package: str, scratch: Path, watch: Watch, data: st.DataObject
) -> None:
    arguments = data.draw(command_lines(package))
    copy = scratch / "command"
    remove(copy)
    shutil.copytree(valid(material.trained, scratch), copy)

    def read() -> None:
        try:
            call(package, arguments, copy)
        except InputError as refusal:
            assert names_what_is_wrong(str(refusal), arguments, package), str(refusal)  # noqa: PT017
            raise

    watch.is_read(read, (InputError,), (" ",))


LENGTHS = FINITE | st.floats()


@CHOSEN
@given(
    boxes=st.lists(st.lists(st.tuples(LENGTHS, LENGTHS, LENGTHS), min_size=2, max_size=2), max_size=3),
    up=st.tuples(FINITE, FINITE, FINITE).filter(any),
    is_lit=st.booleans(),
)
def test_a_scene_of_any_size_is_placed_or_refused(boxes: Any, up: Any, is_lit: bool, watch: Watch) -> None:
    shapes = [
        SimpleNamespace(bbox=lambda box=box: SimpleNamespace(min=box[0], max=box[1]), is_emitter=lambda: False)
        for box in np.array(boxes, dtype=float).reshape(-1, 2, 3)
    ]
    whole = SimpleNamespace(shapes=lambda: shapes, emitters=lambda: [None] * is_lit)
    mitsuba = SimpleNamespace(load_file=lambda name: whole)

    def read() -> None:
        _, place, extent = loaded(mitsuba, Path("boxes.xml"), np.array(up))
        placed = place.box(extent)
        assert np.isfinite(placed).all()
        assert np.isclose(np.linalg.norm(placed[1] - placed[0]), 2 * 1.36)
        assert np.isfinite(place.camera(np.eye(4))).all()

    watch.is_read(read, (InputError,), ("boxes.xml",))


# --- the watch itself


def endless() -> None:
    while True:
        pass


def test_the_watch_sees_faults(watch: Watch, scratch: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outside = scratch.parent / "outside"
    for write in (lambda: outside.write_text("x"), outside.mkdir, lambda: outside.symlink_to("x")):
        with pytest.raises(AssertionError, match="outside of its folder"):
            watch.is_read(write, (ValueError,), ("a",))
    assert not outside.exists()
    assert watch.is_read(lambda: (scratch / "inside").write_text("x"), (ValueError,), ("a",))
    with pytest.raises(MemoryError):
        watch.is_read(lambda: bytearray(3 << 30), (ValueError,), ("a",))
    monkeypatch.setitem(LIMITS, "processor", 0.05)
    with pytest.raises(AssertionError, match="took longer"):
        watch.is_read(endless, (ValueError,), ("a",))


def test_a_refusal_names_what_is_wrong_and_the_reason() -> None:
    assert fault_of("a.json: holds a list, not an object", ("a.json",)) is None
    wrong = "a.json: this is wrong"
    for message in ("holds a list, not an object", "a.json: 7", f"{wrong}\x1b[2J", wrong + "x" * 5000):
        assert fault_of(message, ("a.json",))


def test_a_refusal_names_an_option_or_a_file() -> None:
    for text in ("argument --page: expected one argument", "--page: goes with several outputs alone", "a/b: missing"):
        assert names_what_is_wrong(text, ["a/b", "--page"], "reports")
    for text in ("--pages: goes with several outputs alone", "goes with several outputs alone", "no such folder"):
        assert not names_what_is_wrong(text, ["a/b", "--page"], "reports")
