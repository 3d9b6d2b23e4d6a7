"""Everything that reads a file: what it is given when all is well, and how the program reads it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from baselines.numerics.attention.priorities import BadAttention
from harness.plan.profiles import Machine, planned
from harness.records.json_record import DamagedRecord
from harness.run_folder.output_folder import claim
from harness.viewer.asked import BadRequest, parsed
from reports.data.load import NoRecords
from reports.data.studies_load import find_studies
from scenes.files.errors import InputError
from scenes.view_sets.formats.transforms import read_transforms
from scenes.view_sets.view_set import read_view_set
from tests.fuzz import commands, material, mutations, pages, readers, seals
from tests.fuzz import file_mutations as spoilt
from tests.fuzz.readers import NotTried

Seal = Callable[[bytes], bytes]


@dataclass(frozen=True)
class Target:
    """One file of a folder, and who reads it."""

    make: Callable[[Path], None]
    """Writes the whole folder; called once."""
    files: str
    """Glob of the files that are inputs when all is well. The first one is what is overwritten."""
    read: Callable[[Path], object]
    """Gets the folder; `scratch` beside it may be written to."""
    names: str | tuple[str, ...] = ""
    """What a refusal must hold, or which words one of; the file's name where nothing is said."""
    mutate: Callable[[Random, bytes], bytes] = mutations.of_either
    seal: Seal = seals.same
    """Puts right the checksums of an input; half of them are."""
    place: Callable[[Path, str, bytes], None] | None = None
    """Where overwriting the file is not all."""
    renewed: bool = False
    """Whether reading may change the folder, so that each input needs a fresh one."""
    accepts_all: bool = False
    """Whether nothing may be refused: what is damaged is a miss."""


def _of_records(file: str) -> Target:
    return Target(material.small_run, f"records/{file}", readers.records, "records", seal=seals.record_sealed)


def _of_folder(make: Callable[[Path], None], read: Callable[[Path], object], names: str) -> Target:
    """A whole folder, of which files are changed."""
    return Target(make, "", read, names, spoilt.of_folder, place=spoilt.place_changes, renewed=True)


def _of_picture(file: str, read: Callable[[Path], object], seal: Seal = seals.same, **more: Any) -> Target:
    return Target(material.pictures, file, read, "tried", mutations.of_bytes, seal, seals.place_tried, **more)


def _of_numbers(file: str, read: Callable[[Path], object], *words: str) -> Target:
    """A refusal tells the number that is wrong by one of the words."""
    return Target(material.numbers, file, read, words, mutations.of_json)


def _of_listed(make: Callable[[Path], None], file: str, read: Callable[[Path], object], **more: Any) -> Target:
    """A file of `harness.records.pictures`."""
    return Target(make, file, read, mutate=spoilt.of_listed, seal=seals.listed_sealed, **more)


def _of_options(package: str) -> Target:
    """The reader sees to it that a refusal names option or file."""
    place = commands.place(package)
    return Target(
        material.trained, "", commands.reader(package), " ", commands.mutate(package), place=place, renewed=True
    )


def _of_page(file: str, make: Callable[[Path], None] = material.small_run, *options: str, **more: Any) -> Target:
    """A refusal names the folder or the file in it."""
    usual = {"names": make.__name__, "mutate": pages.mutate, "seal": seals.record_sealed}
    return Target(make, file, pages.page(*options), **{**usual, **more})


_STUDIES = ("speed", "stability", "evidence", "serving")
TARGETS: dict[str, Target] = {
    "transforms": Target(material.ball, "transforms_train.json", lambda folder: read_transforms(folder, "train")),
    "view_set": Target(material.ball, "transforms_test.json", readers.view_set, "ball"),
    "own_view_set": Target(material.own, "transforms_train.json", readers.view_set, "own", place=seals.place_listed),
    "own_exr": Target(material.own, "t*/r_0.exr", readers.view_set, "own", mutations.of_bytes,
                      place=seals.place_listed),
    "manifest": Target(material.own, "view_set.json", readers.needed_view_set, "own", seal=seals.manifest_sealed),
    "view_set_folder": _of_folder(material.ball, readers.view_set, "ball"),
    "own_folder": _of_folder(material.own, readers.needed_view_set, "own"),
    "png": _of_picture("*.png", readers.image, seals.png_sealed),
    "jpeg": _of_picture("*.jpg", readers.image),
    "exr": _of_picture("*.exr", readers.image),
    "report_picture": _of_picture("*.png", readers.report_picture, seals.png_sealed, accepts_all=True),
    "run": _of_records("run.json"),
    "cell": _of_records("cells/*.json"),
    "comparisons": _of_records("comparisons.json"),
    "targets": _of_records("targets.json"),
    "records_folder": _of_folder(material.small_run, readers.records, "records"),
    **{
        study: Target(material.report, f"{study}.json", partial(find_studies, shelf=study), seal=seals.record_sealed)
        for study in _STUDIES
    },
    "plan": Target(material.started, "run/records/plan.json",
                   lambda folder: claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=True), "run",
                   seal=seals.record_sealed),
    "film": Target(material.started, "film/film.json", material.claimed_film, "film",
                   seal=seals.record_sealed, renewed=True),
    "finished_run": Target(material.trained, "run/records/run.json", readers.finished, "run", seal=seals.record_sealed),
    "finished_cell": Target(material.trained, "run/records/cells/ball.nerf.0.json", readers.finished, "ball.nerf.0",
                            seal=seals.record_sealed),
    "checkpoint": Target(material.trained, "run/checkpoints/ball.nerf.0.safetensors", readers.finished,
                         mutate=mutations.of_safetensors),
    "limits": Target(material.gates, "limits.json", readers.limits),
    "references": Target(material.gates, "references.json", readers.references),
    "reference": Target(material.gates, "images/*.exr", readers.reference, mutate=mutations.of_bytes),
    "view_cache": Target(material.view_cache, "cache/*", readers.cache, mutate=mutations.of_bytes,
                         renewed=True, accepts_all=True),
    "view_cache_folder": _of_folder(material.view_cache, readers.cache, "cache"),
    "camera_path": _of_numbers("path.json", readers.camera_path, "frames", "radius", "target", "keep", "elevation"),
    "attention": _of_numbers("attention.json", readers.attention, "region", "point", "fovea", "attention", "image",
                             "picture"),
    "viewer_request": Target(material.numbers, "request.json",
                             lambda folder: parsed((folder / "request.json").read_bytes()), " "),
    "scene_order": _of_numbers("order.json", readers.order, "resolution", "train", "val", "test", "scene", "view"),
    "harness_options": _of_options("harness"),
    "scenes_options": _of_options("scenes"),
    "reports_options": _of_options("reports"),
    "nerfstudio": Target(material.captured, "transforms.json",
                         lambda folder: read_view_set(folder, scratch=folder), "captured"),
    "judged_csv": Target(material.tables, "table.csv", readers.judged("table.csv"), mutate=mutations.of_bytes),
    "judged_json": Target(material.tables, "table.json", readers.judged("table.json")),
    "tiny_nerf": Target(material.tiny, "tiny.npz", readers.tiny_nerf, mutate=spoilt.of_npz),
    "xml_scene": Target(material.scene_files, "mine.xml", lambda folder: readers.own_scene(folder / "mine.xml"),
                        "scene_files", spoilt.of_xml),
    "python_scene": Target(material.scene_files, "mine.py", lambda folder: readers.own_scene(folder / "mine.py"),
                           "scene_files", spoilt.of_python),
    "placement": Target(material.boxes, "boxes.json", readers.placed, mutate=mutations.of_json),
    "pictures_truth": _of_listed(material.kept_pictures, "truth.safetensors", readers.truth),
    "pictures_renders": _of_listed(material.kept_pictures, "renders.safetensors", readers.renders),
    "cell_in_training": _of_listed(material.half_way, "unfinished/ball.nerf.0.safetensors", material.train_on,
                                   renewed=True),
    "occupancy": Target(material.inside, "occupancy.json", readers.occupancy, seal=seals.occupancy_sealed),
    "journal": Target(material.unfinished, "donor/rendered.jsonl", readers.journal, mutate=spoilt.of_lines,
                      seal=seals.journal_sealed, renewed=True, accepts_all=True),
    "journal_manifest": Target(material.unfinished, "donor/view_set.json", readers.journal, seal=seals.manifest_sealed,
                               renewed=True, accepts_all=True),
    "entry_points": Target(material.packages, "*/entry_points.txt", readers.entry_points, " ", spoilt.of_points),
    "page_run": _of_page("records/run.json"),
    "page_cell": _of_page("records/cells/*.json"),
    "page_comparisons": _of_page("records/comparisons.json"),
    "page_targets": _of_page("records/targets.json"),
    "page_pictures": _of_page("records/pictures/*", mutate=spoilt.of_listed, seal=seals.listed_sealed),
    "page_serving": _of_page("serving.json", material.small_run_served),
    "page_partial": _of_page("records/cells/*.json", material.small_run, "--partial"),
    "page_speed": _of_page("speed.json", material.alone_speed),
    "page_stability": _of_page("stability.json", material.alone_stability),
    "page_evidence": _of_page("evidence.json", material.alone_evidence),
}  # fmt: skip
"""By name. Folders are made under the name of the function that makes them."""


REFUSALS = (InputError, DamagedRecord, NoRecords, BadAttention, BadRequest, NotTried)
"""What a reader may raise."""


def whole_folder(target: Target, scratch: Path) -> Path:
    """The folder with everything that the target reads, made where it is not there yet, beside `scratch`, for all."""
    folder = scratch.parent / "whole" / target.make.__name__ / target.make.__name__
    if not folder.exists():
        try:
            target.make(folder)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    return folder


def fresh_copy(folder: Path, scratch: Path) -> Path:
    copy = scratch / folder.name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy, symlinks=True)
    return copy
