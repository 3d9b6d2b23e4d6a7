"""How the program reads what describes scenes, pictures and packages, called as it calls them."""

import contextlib
import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tests.fuzz.readers import NotTried

COUNTS, SPP = {"train": 2, "val": 0, "test": 1}, {"train": 2, "val": 2, "test": 2}


def nerfstudio(folder: Path) -> None:
    from scenes.view_sets.view_set import read_view_set

    read_view_set(folder, scratch=folder)


def tiny_nerf(folder: Path) -> None:
    from scenes.view_sets.view_set import read_view_set

    views = read_view_set(folder / "tiny.npz", scratch=folder)
    assert np.isfinite(views.bounds).all()
    assert all(np.isfinite(one).all() for one in (views.train.rgba[0], views.test.rgba[0]))


def xml_file(folder: Path) -> None:
    _own_scene(folder / "mine.xml")


def python_file(folder: Path) -> None:
    _own_scene(folder / "mine.py")


def _own_scene(file: Path) -> None:
    """Up to where Mitsuba is asked, as `python -m scenes render` and `scenes.rendering.store` do."""
    from dataclasses import replace

    from scenes.catalog.mitsuba_xml import notes
    from scenes.catalog.scene_file import mistakes_in, scene_from_file
    from scenes.modelling.needs import as_rows, left_out, needs
    from scenes.rendering.store import _folder, checked_order

    known = set(sys.modules)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            scene = scene_from_file(file)
            notes(scene)
            with mistakes_in(scene.file):
                order = replace(checked_order(scene, 8, COUNTS, SPP), integrator=None)
            with mistakes_in(scene.file):
                assert _folder(file.parent / "cache", order, "scalar_rgb").parent == file.parent / "cache"
                found = needs(order.description)
                json.dumps([as_rows(found), left_out(found), scene.title], allow_nan=False)
        finally:
            for name in set(sys.modules) - known:
                if name.startswith("scene_file_"):
                    del sys.modules[name]


class _Box:
    def __init__(self, low: object, high: object) -> None:
        self.min, self.max = low, high


def placed(folder: Path) -> None:
    """Boxes of shapes as Mitsuba might tell them, of a file that it could load."""
    from scenes.catalog.mitsuba_xml import loaded

    try:
        told = json.loads((folder / "boxes.json").read_bytes())
        boxes = [np.array(one, dtype=np.float64) for one in told["boxes"]]
        up = np.array(told["up"], dtype=np.float64)
        lights = int(told["lights"])
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise NotTried("no boxes") from error
    # what the XML's reader and Mitsuba make sure of
    if any(one.shape != (2, 3) for one in boxes) or up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise NotTried("no boxes")
    shapes = [SimpleNamespace(bbox=lambda one=one: _Box(*one), is_emitter=lambda: False) for one in boxes]
    scene = SimpleNamespace(shapes=lambda: shapes, emitters=lambda: [None] * min(max(lights, 0), 1))
    mitsuba = SimpleNamespace(load_file=lambda name: scene)
    _, place, whole = loaded(mitsuba, folder / "boxes.json", up)
    found = place.box(whole)
    assert np.isfinite(found).all()
    assert np.isclose(np.linalg.norm(found[1] - found[0]), 2 * 1.36)
    assert np.isfinite(place.camera(np.eye(4))).all()


def truth(folder: Path) -> None:
    from harness.records.pictures import read_truth

    for one in read_truth(folder / "truth.safetensors"):
        assert np.isfinite(one.display).all()


def renders(folder: Path) -> None:
    from harness.records.pictures import last_of, read_renders

    found = read_renders(folder / "renders.safetensors")
    assert all(np.isfinite(one.colour).all() for one in last_of(found))


def half_way(folder: Path) -> None:
    from tests.fuzz.scene_material import train_on

    train_on(folder)


def occupancy(folder: Path) -> None:
    from scenes.rendering.occupancy import _read
    from scenes.view_sets.manifest import read_manifest

    found = _read(folder, read_manifest(folder))
    assert found is None or (found.shape == (32, 32, 32) and found.dtype == bool)


def journal(folder: Path) -> None:
    """Views of an unfinished set, and what `scenes.rendering.store.write_view_set` takes of them; damage is a miss."""
    from scenes.view_sets.manifest import salvaged

    into = folder / "into"
    into.mkdir()
    names = ["train/r_0", "train/r_1", "test/r_0", "test/r_1"]
    kept = salvaged(into, [folder / "donor"], "0" * 64, names)
    assert set(kept) <= set(names)
    for one in kept.values():
        facts = [float(one["noise_mse"]), 0.0 + one.get("seconds", 0.0)]
        json.dumps([*facts, bool(one.get("seen", True)), bool(one.get("lit", True))], allow_nan=False)


def entry_points(folder: Path) -> None:
    """Every method that a package offers, asked for by name as `--methods` does."""
    from baselines.amplifiers import AMPLIFIERS
    from baselines.catalog import CATALOG
    from baselines.composition import LADDERS, SKIPS
    from harness.plan import plugins
    from scenes.files.errors import InputError, readable
    from tests.fuzz.watch import Fault

    tables = (CATALOG, LADDERS, AMPLIFIERS, SKIPS, plugins._loaded)
    before = [dict(table) for table in tables]
    known, path = set(sys.modules), str(folder)
    sys.path.insert(0, path)
    refused: BaseException | None = None
    try:
        offered = plugins.offered()
        plugins.method_names()
        for name in offered:
            try:
                plugins.require_methods([name])
                assert plugins.title_of(name)
                json.dumps(plugins.origins([name]))
            except InputError as error:
                refused = error if readable(name) in str(error) else Fault(f"a refusal without {name!r}: {error}")
    finally:
        sys.path.remove(path)
        sys.path_importer_cache.pop(path, None)
        for table, kept in zip(tables, before, strict=True):
            for name in set(table) - set(kept):
                del table[name]  # type: ignore[attr-defined]
        for name in set(sys.modules) - known:
            if name.startswith("fuzzed_"):
                del sys.modules[name]
        plugins.sources_digest.cache_clear()
    if refused is not None:
        raise refused
