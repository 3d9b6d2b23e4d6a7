"""How the program reads each file, called as it calls them."""

import contextlib
import io
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG
from baselines.composition import LADDERS, SKIPS
from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.priorities import allocated_bins, priorities, region_order
from baselines.numerics.attention.regions import Regions
from harness.gate.gates import KINDS, gates
from harness.gate.images import biases, read_reference
from harness.gate.limits import LimitsFile, changes, read_stored, unfit
from harness.gate.references import References
from harness.plan import plugins
from harness.plan.needed import for_scene
from harness.plan.profiles import PROFILES
from harness.playback.camera_paths import PATHS
from harness.playback.run_loader import FinishedRun
from harness.playback.store import ViewStore
from harness.records.cells import read_cells, read_comparisons, read_run
from harness.records.judgements import read_judgement, write_judgement
from harness.records.pictures import last_of, read_renders, read_truth
from harness.verdicts.judging.judgement import judge
from harness.verdicts.judging.result_table import read_table
from reports.data.load import read_records
from reports.drawing.images import read
from scenes.catalog import scene_file
from scenes.catalog.mitsuba_xml import loaded, notes
from scenes.catalog.scene_file import mistakes_in, scene_from_file
from scenes.files.errors import InputError, readable
from scenes.modelling.needs import as_rows, left_out, needs, with_needs
from scenes.rendering.occupancy import _read
from scenes.rendering.store import _folder, checked_order, is_complete
from scenes.view_sets.images import read_channels, read_image
from scenes.view_sets.manifest import read_manifest, salvaged
from scenes.view_sets.view_set import read_view_set
from tests.fuzz.watch import Fault


class NotTried(ValueError):
    """The input is none that the reader could be given."""


def view_set(folder: Path) -> None:
    read_view_set(folder, geometry=("train", "test"), scratch=folder)


def needed_view_set(folder: Path) -> None:
    is_complete(folder)
    views = with_needs(read_view_set(folder, scratch=folder), ("view_direction",), ("empty_space",))
    for_scene(PROFILES["smoke"].train, views)


def image(folder: Path) -> None:
    for file in _first(folder):
        assert read_image(file).ndim == 3
        read_channels(file)


def report_picture(folder: Path) -> None:
    for file in _first(folder):
        picture = read(folder, file.name)
        assert picture is None or picture.shape[-1] == 3


def _first(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.stem == "tried"]


def records(folder: Path) -> None:
    read_records(folder)
    read_run(folder), list(read_cells(folder)), read_comparisons(folder)


def finished(folder: Path) -> None:
    """What the viewer, a film and the measurement of serving look at first."""

    run = FinishedRun.of(folder / "run")
    scene = run.scenes(None)[0]
    method = run.methods(None)[0]
    cell = run.trained(scene, method, 0, torch.device("cpu"))
    cell.camera(np.eye(4))
    run.view_radius(scene, folder)
    run.views(scene, folder, train=1, scratch=folder)
    assert cell.chunk > 0


def limits(folder: Path) -> None:
    stored = read_stored(folder / "limits.json", LimitsFile)
    for gate in gates():
        stored.limit_of(gate)
    changes(stored, stored)


def references(folder: Path) -> None:
    stored = read_stored(folder / "references.json", References)
    for kind in KINDS:
        unfit(kind, stored.kinds)


def reference(folder: Path) -> None:
    scene = next((folder / "images").glob("*.exr")).stem
    reference = read_reference(folder / "images", scene)
    biases(np.zeros((2, *reference.mean.shape)), reference)


def cache(folder: Path) -> None:
    """Whatever lies in the folder, a picture is the one that was stored, or a miss."""
    if (folder / "cache").is_symlink():
        raise NotTried("a user may have the whole cache elsewhere")
    store = ViewStore(0, folder / "cache", 1 << 20)
    for number in range(2):
        hit = store.get(64 * f"{number}", (4, 5, 5))
        assert hit is None or (hit[0] == np.float32(0.25 * number)).all()
    store.store(64 * "3", np.ones((2, 2, 5), dtype=np.float32))
    assert store.failure is None


# --- numbers as functions are given them


def _given(folder: Path, name: str) -> dict[str, Any]:
    with _as_parsed():
        data = json.loads((folder / name).read_bytes())
        if not isinstance(data, dict):
            raise NotTried("no arguments")
        return data


@contextlib.contextmanager
def _as_parsed() -> Iterator[None]:
    """What an option's parser has made sure of: the keys are there, numbers are numbers of their kind."""
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError) as error:
        raise NotTried(str(error)) from error


def camera_path(folder: Path) -> None:
    given = _given(folder, "path.json")
    with _as_parsed():
        frames, radius = int(given["frames"]), float(given["radius"])
        if not 0 < frames <= 10_000:
            raise NotTried("checked before")
        path = PATHS[given["path"]]
    poses = path(frames, radius=radius)
    assert poses.shape == (frames, 4, 4)
    assert np.isfinite(poses).all()


def attention(folder: Path) -> None:
    given = _given(folder, "attention.json")
    with _as_parsed():
        sizes = [int(given[name]) for name in ("height", "width", "region")]
        row, column, radius, focal = (float(given[name]) for name in ("row", "column", "radius", "focal"))
        values = np.array(given["values"], dtype=np.float64)
        if max(sizes) > 1024 or min(sizes) < 1 or given["map"] not in MAPS:
            raise NotTried("checked before")
    regions = Regions(*sizes)
    inputs = MapInputs(regions, row, column, radius, focal, lambda: values, lambda: values, lambda: values)
    weights = MAPS[given["map"]](inputs)
    assert weights.shape == (regions.count,)
    assert np.isfinite(priorities(weights)).all()
    assert sorted(region_order(weights)) == list(range(regions.count))
    assert (allocated_bins(weights, regions.rays, 8.0) >= 1).all()


def order(folder: Path) -> None:
    given = _given(folder, "order.json")
    with _as_parsed():
        numbers = [given["resolution"], *given["counts"].values(), *given["spp"].values()]
        if not isinstance(given["scene"], str) or any(type(number) is not int for number in numbers):
            raise NotTried("checked before")
    checked_order(given["scene"], given["resolution"], given["counts"], given["spp"])


def judged(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        record = judge(read_table([folder / name]), None, None, {})
        write_judgement(folder / "judgement.json", record)
        assert read_judgement(folder / "judgement.json") == record

    return read


# --- what describes scenes, pictures and packages

COUNTS, SPP = {"train": 2, "val": 0, "test": 1}, {"train": 2, "val": 2, "test": 2}


def tiny_nerf(folder: Path) -> None:
    views = read_view_set(folder / "tiny.npz", scratch=folder)
    assert np.isfinite(views.bounds).all()
    assert all(np.isfinite(image).all() for image in (views.train.rgba[0], views.test.rgba[0]))


def own_scene(file: Path) -> None:
    """Up to where Mitsuba is asked, as `python -m scenes render` and `scenes.rendering.store` do."""
    known = set(sys.modules)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            with patch.object(scene_file, "how_it_ends", return_value=""):  # which takes a process for each
                scene = scene_from_file(file)
            notes(scene)
            with mistakes_in(scene.file):
                order = checked_order(scene, 8, COUNTS, SPP)
                assert _folder(file.parent / "cache", order, "scalar_rgb").parent == file.parent / "cache"
                scene_needs = needs(order.description)
                json.dumps([as_rows(scene_needs), left_out(scene_needs), scene.title], allow_nan=False)
        finally:
            for name in set(sys.modules) - known:
                if name.startswith("scene_file_"):
                    del sys.modules[name]


def placed(folder: Path) -> None:
    """Boxes of shapes as Mitsuba might tell them, of a file that it could load."""
    given = _given(folder, "boxes.json")
    with _as_parsed():
        boxes = [np.array(box, dtype=np.float64) for box in given["boxes"]]
        up, lights = np.array(given["up"], dtype=np.float64), int(given["lights"])
    # what the XML's reader and Mitsuba make sure of
    if any(box.shape != (2, 3) for box in boxes) or up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise NotTried("no boxes")
    shapes = [
        SimpleNamespace(bbox=lambda box=box: SimpleNamespace(min=box[0], max=box[1]), is_emitter=lambda: False)
        for box in boxes
    ]
    scene = SimpleNamespace(shapes=lambda: shapes, emitters=lambda: [None] * min(max(lights, 0), 1))
    mitsuba = SimpleNamespace(load_file=lambda name: scene)
    _, place, whole = loaded(mitsuba, folder / "boxes.json", up)
    placed_box = place.box(whole)
    assert np.isfinite(placed_box).all()
    assert np.isclose(np.linalg.norm(placed_box[1] - placed_box[0]), 2 * 1.36)
    assert np.isfinite(place.camera(np.eye(4))).all()


def truth(folder: Path) -> None:
    for view in read_truth(folder / "truth.safetensors"):
        assert np.isfinite(view.display).all()


def renders(folder: Path) -> None:
    saved = read_renders(folder / "renders.safetensors")
    assert all(np.isfinite(render.colour).all() for render in last_of(saved))


def occupancy(folder: Path) -> None:
    cells = _read(folder, read_manifest(folder))
    assert cells is None or (cells.shape == (32, 32, 32) and cells.dtype == bool)


def journal(folder: Path) -> None:
    """Views of an unfinished set, and what `scenes.rendering.store.write_view_set` takes of them; damage is a miss."""
    into = folder / "into"
    into.mkdir()
    names = ["train/r_0", "train/r_1", "test/r_0", "test/r_1"]
    kept = salvaged(into, [folder / "donor"], "0" * 64, names)
    assert set(kept) <= set(names)
    for view in kept.values():
        facts = [float(view["noise_mse"]), 0.0 + view.get("seconds", 0.0)]
        json.dumps([*facts, bool(view.get("seen", True)), bool(view.get("lit", True))], allow_nan=False)


def entry_points(folder: Path) -> None:
    """Every method that a package offers, asked for by name as `--methods` does."""
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
                with patch.object(plugins, "how_it_ends", return_value=""):
                    plugins.require_methods([name])
                assert plugins.title_of(name)
                json.dumps(plugins.origins([name]))
            except InputError as error:
                told = readable(name)[:64] in str(error)  # of a longer one a message may leave out the middle
                refused = error if told else Fault(f"a refusal without {name!r}: {error}")
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
