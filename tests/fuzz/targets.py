"""Everything that reads a file: what it is given when all is well, and how the program reads it."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz import commands, file_mutations, folders, material, mutations, pages, scene_material, scene_readers
from tests.fuzz.readers import (
    NotTried,
    _attention,
    _beside,
    _cache,
    _claimed,
    _class,
    _filmed,
    _finished,
    _image,
    _judged,
    _limits,
    _mask,
    _needed_view_set,
    _order,
    _path,
    _records,
    _reference,
    _report_picture,
    _search,
    _through,
    _transforms,
    _view_set,
)
from tests.fuzz.seals import (
    journal_sealed,
    listed_sealed,
    manifest_sealed,
    occupancy_sealed,
    place_listed,
    place_tried,
    png_sealed,
    record_sealed,
    same,
)
from tests.fuzz.viewer_requests import asked

Mutate = Callable[[Random, bytes], bytes]


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
    mutate: Mutate = mutations.of_either
    seal: Callable[[bytes], bytes] = same
    """Puts right the checksums of an input; half of them are."""
    place: Callable[[Path, str, bytes], None] | None = None
    """Where overwriting the file is not all."""
    renewed: bool = False
    """Whether reading may change the folder, so that each input needs a fresh one."""
    accepts_all: bool = False
    """Whether nothing may be refused: what is damaged is a miss."""


def _of_records(file: str, **more: Any) -> Target:
    return Target(
        scene_material.small_run, file and f"records/{file}", _records, names="records", seal=record_sealed, **more
    )


def _of_numbers(file: str, read: Callable[[Path], None], *words: str) -> Target:
    """A refusal tells the number that is wrong by one of the words."""
    return Target(material.numbers, file, read, names=words, mutate=mutations.of_json)


def _of_options(package: str) -> Target:
    """The reader sees to it that a refusal names option or file."""
    return Target(material.trained, "", commands.reader(package), names=" ", mutate=commands.mutate(package),
                  place=commands.place(package), renewed=True)  # fmt: skip


def _of_page(file: str, make: Callable[[Path], None] = scene_material.small_run, *options: str, **more: Any) -> Target:
    """A refusal names the folder or the file in it."""
    usual = {"names": make.__name__, "mutate": pages.mutate, "seal": record_sealed}
    return Target(make, file, pages.page(*options), **{**usual, **more})


TARGETS: dict[str, Target] = {
    "transforms": Target(material.ball, "transforms_train.json", _transforms),
    "view_set": Target(material.ball, "transforms_test.json", _view_set, names="ball"),
    "own_view_set": Target(material.own, "transforms_train.json", _view_set, names="own", place=place_listed),
    "own_exr": Target(material.own, "t*/r_0.exr", _view_set, "own", mutations.of_bytes, place=place_listed),
    "manifest": Target(material.own, "view_set.json", _needed_view_set, names="own", seal=manifest_sealed),
    "view_set_folder": Target(material.ball, "", _view_set, names="ball", mutate=folders.mutate, place=folders.place,
                              renewed=True),
    "own_folder": Target(material.own, "", _needed_view_set, names="own", mutate=folders.mutate, place=folders.place,
                         renewed=True),
    "png": Target(material.pictures, "*.png", _image, "tried", mutations.of_bytes, png_sealed, place_tried),
    "jpeg": Target(material.pictures, "*.jpg", _image, "tried", mutations.of_bytes, same, place_tried),
    "exr": Target(material.pictures, "*.exr", _image, "tried", mutations.of_bytes, same, place_tried),
    "mask": Target(material.pictures, "*.*", _mask, "tried", mutations.of_bytes, png_sealed, place_tried),
    "report_picture": Target(material.pictures, "*.png", _report_picture, "tried", mutations.of_bytes, png_sealed,
                             place_tried, accepts_all=True),
    "run": _of_records("run.json"),
    "cell": _of_records("cells/*.json"),
    "comparisons": _of_records("comparisons.json"),
    "targets": _of_records("targets.json"),
    "records_folder": _of_records("", mutate=folders.mutate, place=folders.place, renewed=True),
    "speed": Target(material.report, "speed.json", _beside("speed"), seal=record_sealed),
    "stability": Target(material.report, "stability.json", _beside("stability"), seal=record_sealed),
    "evidence": Target(material.report, "evidence.json", _beside("evidence"), seal=record_sealed),
    "serving": Target(material.report, "serving.json", _beside("serving"), seal=record_sealed),
    "plan": Target(material.started, "run/records/plan.json", _claimed, names="run", seal=record_sealed),
    "film": Target(material.started, "film/film.json", _filmed, names="film", seal=record_sealed, renewed=True),
    "repair_search": Target(material.started, "search.json", _search),
    "finished_run": Target(material.trained, "run/records/run.json", _finished, names="run", seal=record_sealed),
    "finished_cell": Target(material.trained, "run/records/cells/ball.nerf.0.json", _finished, names="ball.nerf.0",
                            seal=record_sealed),
    "checkpoint": Target(material.trained, "run/checkpoints/ball.nerf.0.safetensors", _finished,
                         mutate=mutations.of_safetensors),
    "limits": Target(material.gates, "limits.json", _limits),
    "class": Target(material.gates, "classes/avx2.json", _class),
    "reference": Target(material.gates, "images/*.exr", _reference, mutate=mutations.of_bytes),
    "view_cache": Target(material.view_cache, "cache/[ok]*/??/*", _cache, mutate=mutations.of_bytes, renewed=True,
                         accepts_all=True),
    "view_cache_folder": Target(material.view_cache, "", _cache, names="cache", mutate=folders.mutate,
                                place=folders.place, renewed=True, accepts_all=False),
    "camera_path": _of_numbers("path.json", _path, "frames", "radius", "target", "keep", "elevation"),
    "camera_path_through": _of_numbers("through.json", _through, "frames", "poses", "pose"),
    "attention": _of_numbers("attention.json", _attention, "region", "point", "fovea", "attention", "image", "picture"),
    "viewer_request": Target(material.numbers, "request.json", asked, names=" "),
    "scene_order": _of_numbers("order.json", _order, "resolution", "train", "val", "test", "scene", "view"),
    "harness_options": _of_options("harness"),
    "scenes_options": _of_options("scenes"),
    "reports_options": _of_options("reports"),
    "nerfstudio": Target(scene_material.captured, "transforms.json", scene_readers.nerfstudio, names="captured"),
    "judged_csv": Target(material.tables, "table.csv", _judged("table.csv"), mutate=mutations.of_bytes),
    "judged_json": Target(material.tables, "table.json", _judged("table.json")),
    "tiny_nerf": Target(scene_material.tiny, "tiny.npz", scene_readers.tiny_nerf, mutate=file_mutations.of_npz),
    "xml_scene": Target(scene_material.scene_files, "mine.xml", scene_readers.xml_file, "scene_files",
                        file_mutations.of_xml),
    "python_scene": Target(scene_material.scene_files, "mine.py", scene_readers.python_file, "scene_files",
                           file_mutations.of_python),
    "placement": Target(scene_material.boxes, "boxes.json", scene_readers.placed, mutate=mutations.of_json),
    "pictures_truth": Target(scene_material.kept_pictures, "truth.safetensors", scene_readers.truth,
                             mutate=file_mutations.of_listed, seal=listed_sealed),
    "pictures_renders": Target(scene_material.kept_pictures, "renders.safetensors", scene_readers.renders,
                               mutate=file_mutations.of_listed, seal=listed_sealed),
    "cell_in_training": Target(scene_material.half_way, "unfinished/ball.nerf.0.safetensors", scene_readers.half_way,
                               mutate=file_mutations.of_listed, seal=listed_sealed, renewed=True),
    "occupancy": Target(scene_material.inside, "occupancy.json", scene_readers.occupancy, seal=occupancy_sealed),
    "journal": Target(scene_material.unfinished, "donor/rendered.jsonl", scene_readers.journal,
                      mutate=file_mutations.of_lines, seal=journal_sealed, renewed=True, accepts_all=True),
    "journal_manifest": Target(scene_material.unfinished, "donor/view_set.json", scene_readers.journal,
                               seal=manifest_sealed, renewed=True, accepts_all=True),
    "entry_points": Target(scene_material.packages, "*/entry_points.txt", scene_readers.entry_points, names=" ",
                           mutate=file_mutations.of_points),
    "page_run": _of_page("records/run.json"),
    "page_cell": _of_page("records/cells/*.json"),
    "page_comparisons": _of_page("records/comparisons.json"),
    "page_targets": _of_page("records/targets.json"),
    "page_pictures": _of_page("records/pictures/*", mutate=file_mutations.of_listed, seal=listed_sealed),
    "page_serving": _of_page("serving.json", scene_material.small_run_served),
    "page_partial": _of_page("records/cells/*.json", scene_material.small_run, "--partial"),
    "page_speed": _of_page("speed.json", scene_material.alone_speed),
    "page_stability": _of_page("stability.json", scene_material.alone_stability),
    "page_evidence": _of_page("evidence.json", scene_material.alone_evidence),
}  # fmt: skip
"""By name. Folders are made under the name of the function that makes them."""


@cache
def refusals() -> tuple[type[Exception], ...]:
    """What a reader may raise."""
    from baselines.numerics.attention.priorities import BadAttention
    from harness.records.json_record import DamagedRecord
    from harness.viewer.asked import BadRequest
    from reports.data.load import NoRecords
    from scenes.files.errors import InputError

    return InputError, DamagedRecord, NoRecords, BadAttention, BadRequest, NotTried


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
