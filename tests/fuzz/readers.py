"""A table of all readers of files: a valid file, the reader, and what a refusal names."""

import contextlib
import io
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import torch

from baselines.amplifiers import AMPLIFIERS
from baselines.catalog import CATALOG
from baselines.composition import LADDERS, SKIPS
from baselines.splats.ply import read_ply
from harness.command.plan_options import planned
from harness.gate.gates import KINDS, gates
from harness.gate.images import biases, read_reference
from harness.gate.limits import LimitsFile, changes, read_stored, unfit
from harness.gate.references import References
from harness.plan import plugins
from harness.plan.needed import for_scene
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Machine
from harness.playback.run_loader import FinishedRun
from harness.playback.store import ViewStore
from harness.records.cells import read_cells, read_comparisons, read_run
from harness.records.judgements import read_judgement, write_judgement
from harness.records.pictures import last_of, read_renders, read_truth
from harness.run_folder.output_folder import claim
from harness.verdicts.judging.judgement import judge
from harness.verdicts.tables.result_table import read_table
from harness.viewer.requests import BadRequest, parsed
from reports.__main__ import main as reports
from reports.data.load import NoRecords, read_records
from reports.data.studies_load import find_studies
from reports.drawing import figure, series_charts
from reports.page import shell
from reports.studies import study_page
from scenes.catalog import scene_file
from scenes.catalog.mitsuba_xml import notes
from scenes.catalog.scene_file import mistakes_in, scene_from_file
from scenes.files.errors import DamagedRecord, InputError, readable
from scenes.modelling.needs import as_rows, left_out, needs, with_needs
from scenes.rendering.occupancy import _read as read_occupancy
from scenes.rendering.store import _folder, checked_order, is_complete
from scenes.view_sets.images import read_channels, read_image
from scenes.view_sets.manifest import read_manifest, salvaged
from scenes.view_sets.view_set import read_view_set
from tests.fuzz import material
from tests.fuzz.spoiling import CODE
from tests.harness.tiny import rays_and_colours

REFUSALS = (InputError, DamagedRecord, NoRecords, BadRequest)
"""The exceptions that a reader may raise."""


@dataclass(frozen=True)
class Reader:
    make: Callable[[Path], object]
    """Writes a folder of valid files."""
    files: str
    """Glob of the files to corrupt."""
    read: Callable[[Path, Path], object]
    """Gets the folder, which it may write to, and the corrupt file."""
    names: tuple[str, ...] = ()
    """A refusal contains one of these names, or the name of the file."""
    anything: bool = False
    """Whether a test may replace a file by a folder, a pipe, a link or nothing."""
    misses: bool = False
    """Whether nothing is refused: corrupt files are ignored."""
    slow: bool = False


def view_set(folder: Path, file: Path) -> None:
    is_complete(folder)
    views = read_view_set(folder, geometry=("train", "test"), scratch=folder)
    for_scene(PROFILES["smoke"].train, with_needs(views, ("view_direction",), ("empty_space",)))


def image(folder: Path, file: Path) -> None:
    assert read_image(file).ndim == 3
    read_channels(file)


def records(folder: Path, file: Path) -> None:
    read_records(folder)
    read_run(folder), list(read_cells(folder)), read_comparisons(folder)


def finished(folder: Path, file: Path) -> None:
    """Read a run like the viewer, a film and the measurement of serving."""
    run = FinishedRun.of(folder / "run")
    scene = run.scenes(None)[0]
    for method in run.methods(None):
        cell = run.trained(scene, method, 0, torch.device("cpu"))
        cell.camera(np.eye(4))
        assert cell.chunk > 0
    run.view_radius(scene, folder)
    run.views(scene, folder, train=1, scratch=folder)


def limits(folder: Path, file: Path) -> None:
    stored = read_stored(file, LimitsFile)
    for gate in gates():
        stored.limit_of(gate)
    changes(stored, stored)


def references(folder: Path, file: Path) -> None:
    stored = read_stored(file, References)
    for kind in KINDS:
        unfit(kind, stored.kinds)


def reference(folder: Path, file: Path) -> None:
    picture = read_reference(file.parent, file.stem)
    biases(np.zeros((2, *picture.mean.shape)), picture)


def view_cache(folder: Path, file: Path) -> None:
    """A picture is the stored one or a miss, whatever the folder contains."""
    store = ViewStore(0, folder, 1 << 20)
    for number in range(2):
        hit = store.get(64 * f"{number}", (4, 5, 5))
        assert hit is None or (hit[0] == np.float32(0.25 * number)).all()
    store.store(64 * "3", np.ones((2, 2, 5), dtype=np.float32))
    assert store.failure is None


def judged(folder: Path, file: Path) -> None:
    record = judge(read_table([file]), None, None)
    write_judgement(folder / "judgement.json", record)
    assert read_judgement(folder / "judgement.json") == record


def splats(folder: Path, file: Path) -> None:
    try:
        field = read_ply(file, 50.0)
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: {error}") from error
    assert bool(torch.isfinite(field.render(rays_and_colours(3)[0]).colour).all())


def tiny_nerf(folder: Path, file: Path) -> None:
    views = read_view_set(file, scratch=folder)
    assert np.isfinite(views.bounds).all()
    assert all(np.isfinite(image).all() for image in (views.train.rgba[0], views.test.rgba[0]))


COUNTS, SPP = {"train": 2, "val": 0, "test": 1}, {"train": 2, "val": 2, "test": 2}


def own_scene(folder: Path, file: Path) -> None:
    """Read a scene file like `python -m scenes render` and `scenes.rendering.store`, up to the first use of Mitsuba."""
    said = io.StringIO()
    with _forgotten("scene_file_"), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        with patch.object(scene_file, "how_it_ends", return_value=""):  # it starts a process for each file
            scene = scene_from_file(file)
        notes(scene)
        with mistakes_in(scene.file):
            order = checked_order(scene, 8, COUNTS, SPP)
            assert _folder(folder / "cache", order, "scalar_rgb").parent == folder / "cache"
            scene_needs = needs(order.description)
            json.dumps([as_rows(scene_needs), left_out(scene_needs), scene.title], allow_nan=False)


@contextlib.contextmanager
def _forgotten(prefix: str) -> Iterator[None]:
    """Forget modules that are imported within, so that they are imported again."""
    try:
        yield
    finally:
        for name in [name for name in sys.modules if name.startswith(prefix)]:
            del sys.modules[name]


def pictures(folder: Path, file: Path) -> None:
    if "qnerf" in file.name or "nerf" in file.name:
        assert all(np.isfinite(render.colour).all() for render in last_of(read_renders(file)))
    else:
        assert all(np.isfinite(view.display).all() for view in read_truth(file))


def occupancy(folder: Path, file: Path) -> None:
    cells = read_occupancy(folder, read_manifest(folder))
    assert cells is None or (cells.shape == (32, 32, 32) and cells.dtype == bool)


def journal(folder: Path, file: Path) -> None:
    """Read the views of an unfinished set like `scenes.rendering.store.write_view_set`."""
    (folder / "into").mkdir()
    names = ["train/r_0", "train/r_1", "test/r_0", "test/r_1"]
    kept = salvaged(folder / "into", [folder], material.order().digest("scalar_rgb"), names)
    assert set(kept) <= set(names)
    for view in kept.values():
        facts = [float(view["noise_mse"]), 0.0 + view.get("seconds", 0.0)]
        json.dumps([*facts, bool(view.get("seen", True)), bool(view.get("lit", True))], allow_nan=False)


def entry_points(folder: Path, file: Path) -> None:
    """Require every method of a package by name, like `--methods`."""
    with contextlib.ExitStack() as stack:
        for table in (CATALOG, LADDERS, AMPLIFIERS, SKIPS, plugins._loaded):
            stack.enter_context(patch.dict(table))
        stack.enter_context(_forgotten("fuzzed_"))
        stack.enter_context(patch.object(sys, "path", [str(folder), *sys.path]))
        stack.enter_context(patch.object(plugins, "how_it_ends", return_value=""))
        stack.callback(plugins.sources_digest.cache_clear)
        stack.callback(sys.path_importer_cache.pop, str(folder), None)
        offered = plugins.offered()
        plugins.method_names()
        refused: InputError | None = None
        for name in offered:
            try:
                plugins.require_methods([name])
                assert plugins.title_of(name)
                json.dumps(plugins.origins([name]))
            except InputError as error:
                assert readable(name)[:64] in str(error)  # noqa: PT017 - the other names are tested too
                refused = error
        if refused is not None:
            raise refused


def page(folder: Path, file: Path, *options: str) -> None:
    """`python -m reports OUT`: exit code 0 or 3, or 2 with a reason, and no code from a record in the page."""
    out = folder if (folder / "records").exists() else file.parent
    errors, printed = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        stack.enter_context(patch.object(shell, "environment", ENVIRONMENT))
        for module in (figure, series_charts, study_page):
            stack.enter_context(patch.object(module, "svg", _drawn))
        stack.enter_context(contextlib.redirect_stderr(errors))
        stack.enter_context(contextlib.redirect_stdout(printed))
        code = reports([str(out), *options])
    if code == 2:
        raise InputError(errors.getvalue().strip())
    assert code in (0, 3), f"exit code {code}: {errors.getvalue()[-300:]}"
    text = Path(printed.getvalue().splitlines()[-1]).read_text(encoding="utf-8")
    assert len(text) > 1000
    assert CODE not in text, f"text of a record has become code: {text[text.index(CODE) - 80 :][:200]!r}"


ENVIRONMENT = cache(shell.environment)
SVG, DRAWN = figure.svg, dict[tuple[str, str], Any]()


def _drawn(panel: Any, name: str) -> Any:
    """Draw each panel only once, as the drawing depends only on panel and name."""
    key = repr(panel), name
    if key not in DRAWN:
        DRAWN[key] = SVG(panel, name)
    return DRAWN[key]


def started(folder: Path, file: Path) -> None:
    claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=True)


READERS: dict[str, Reader] = {
    "view_set": Reader(material.ball, "**/*", view_set, ("view_set",), anything=True),
    "own_view_set": Reader(material.own, "**/*[!l]", view_set, ("own_view_set",), anything=True, slow=True),
    "nerfstudio": Reader(material.captured, "*.json", view_set, ("nerfstudio",)),
    "tiny_nerf": Reader(material.tiny, "tiny.npz", tiny_nerf),
    "splats": Reader(material.splats, "*.ply", splats),
    "image": Reader(material.pictures, "*", image),
    "records": Reader(material.small_run, "records/**/*.json", records, ("records",), anything=True),
    "pictures": Reader(material.small_run, "records/pictures/*", pictures),
    "study": Reader(material.studies, "*/*.json", lambda folder, file: find_studies(file.parent, file.stem)),
    "page": Reader(material.small_run, "**/*.*", page, ("page",), slow=True),
    "page_in_part": Reader(
        material.small_run, "**/*.*", lambda folder, file: page(folder, file, "--partial"), ("page_in_part",), slow=True
    ),
    "study_page": Reader(material.studies, "*/*.json", page, slow=True),
    "plan": Reader(material.started, "run/records/plan.json", started, ("run",)),
    "film": Reader(material.started, "film/film.json", lambda folder, file: material.claimed_film(folder), ("film",)),
    "finished": Reader(material.trained, "run/[rc]*/**/*.*", finished, ("run", "ball"), slow=True),
    "snapshot": Reader(material.half_way, "unfinished/*", lambda folder, file: material.train_on(folder), slow=True),
    "limits": Reader(material.gates, "limits.json", limits),
    "references": Reader(material.gates, "references.json", references),
    "reference": Reader(material.gates, "images/*.exr", reference),
    "view_cache": Reader(material.view_cache, "*", view_cache, anything=True, misses=True),
    "request": Reader(material.request, "*.json", lambda folder, file: parsed(file.read_bytes()), (" ",)),
    "table": Reader(material.tables, "*", judged),
    "scene_file": Reader(material.scene_files, "mine.*", own_scene, ("scene_file",)),
    "occupancy": Reader(material.own, "occupancy.json", occupancy),
    "journal": Reader(material.own, "[rv]*.json*", journal, misses=True),
    "entry_points": Reader(material.package, "*/entry_points.txt", entry_points, (" ",)),
}
"""By name, which is also the name of the folder."""
