"""How the program reads each file, called as it calls them."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np


class NotTried(ValueError):
    """The input is none that the reader could be given."""


# --- readers, called as the program calls them


def _view_set(folder: Path) -> None:
    from scenes.view_sets.view_set import read_view_set

    read_view_set(folder, geometry=("train", "test"), scratch=folder)


def _needed_view_set(folder: Path) -> None:
    from harness.plan.needed import for_scene, with_needs
    from harness.plan.profiles import PROFILES
    from scenes.rendering.store import is_complete
    from scenes.view_sets.view_set import read_view_set

    is_complete(folder)
    views = with_needs(read_view_set(folder, scratch=folder), ("view_direction",), ("empty_space",))
    for_scene(PROFILES["smoke"].train, views)


def _transforms(folder: Path) -> None:
    from scenes.view_sets.transforms import read_transforms

    read_transforms(folder, "train")


def _image(folder: Path) -> None:
    from scenes.view_sets.images import read_channels, read_image

    for file in _first(folder):
        assert read_image(file).ndim == 3
        read_channels(file)


def _mask(folder: Path) -> None:
    from harness.viewer.attended import read_mask, spread

    for file in _first(folder):
        found = read_mask(file)
        assert np.isfinite(spread(found, 5, 7)).all()


def _report_picture(folder: Path) -> None:
    from reports.drawing.images import read

    for file in _first(folder):
        found = read(folder, file.name)
        assert found is None or found.shape[-1] == 3


def _first(folder: Path) -> list[Path]:
    return [file for file in folder.iterdir() if file.stem == "tried"]


def _records(folder: Path) -> None:
    from harness.records.cells import read_cells, read_comparisons, read_run
    from reports.data.load import read_records

    read_records(folder)
    read_run(folder), list(read_cells(folder)), read_comparisons(folder)


def _beside(find: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        from reports.data.serving_load import find_serving
        from reports.data.studies_load import find_studies

        find_serving(folder) if find == "serving" else find_studies(folder, find)

    return read


def _claimed(folder: Path) -> None:
    from harness.plan.profiles import Machine, planned
    from harness.run_folder.output_folder import claim

    claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=True)


def _filmed(folder: Path) -> None:
    from harness.viewer.film.film_folder import claim
    from harness.viewer.film.takes import FilmSpec

    claim(folder / "film", FilmSpec("orbit", 3, 8, None, 0), folder / "run", lambda line: None)


def _search(folder: Path) -> None:
    from harness.studies.choices.repair_search import read_search

    read_search(folder / "search.json")


def _finished(folder: Path) -> None:
    """What the viewer, a film and the measurement of serving look at first."""
    import torch

    from harness.playback.run_loader import FinishedRun

    run = FinishedRun.of(folder / "run")
    scene = run.scenes(None)[0]
    method = run.methods(None)[0]
    cell = run.trained(scene, method, 0, torch.device("cpu"))
    cell.camera(np.eye(4))
    run.view_radius(scene, folder)
    run.views(scene, folder, train=1, scratch=folder)
    assert cell.chunk > 0


def _limits(folder: Path) -> None:
    from harness.gate.gates import gates
    from harness.gate.limits import changes, read_limits

    found = read_limits(folder / "limits.json")
    for gate in gates():
        found.limit_of(gate)
    changes(found, found)


def _class(folder: Path) -> None:
    from harness.gate.gates import gates
    from harness.gate.references import references_for

    found = references_for(folder / "classes", "avx2")
    for gate in gates():
        found.missing(gate)


def _reference(folder: Path) -> None:
    from harness.gate.images import biases, read_reference

    scene = next((folder / "images").glob("*.exr")).stem
    reference = read_reference(folder / "images", scene)
    biases(np.zeros((2, *reference.mean.shape)), reference)


def _cache(folder: Path) -> None:
    """Whatever lies in the folder, a picture is the one that was stored, or a miss."""
    from harness.playback.disk import DiskPictures
    from harness.playback.float_exr import frozen

    if (folder / "cache").is_symlink():
        raise NotTried("a user may have the whole cache elsewhere")
    disk = DiskPictures(folder / "cache", 1 << 20)
    for number in range(2):
        found = disk.get(f"key {number}")
        assert found is None or ((found == np.float32(0.25 * number)).all() and found.shape == (4, 5, 5))
    assert disk.put("key 3", frozen(np.ones((2, 2, 5), dtype=np.float32)))


# --- numbers as functions are given them


def _told(folder: Path, name: str) -> dict[str, Any]:
    with _as_parsed():
        data = json.loads((folder / name).read_bytes())
        if not isinstance(data, dict):
            raise NotTried("no arguments")
        return data


@contextmanager
def _as_parsed() -> Iterator[None]:
    """What an option's parser has made sure of: the keys are there, numbers are numbers of their kind."""
    try:
        yield
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError) as error:
        raise NotTried(str(error)) from error


def _path(folder: Path) -> None:
    from harness.command.look_commands import MOST_FRAMES
    from harness.playback.camera_paths import PATHS

    told = _told(folder, "path.json")
    with _as_parsed():
        frames, radius = int(told["frames"]), float(told["radius"])
        target = tuple(float(x) for x in told["target"])
        names = {"orbit": ("elevation", "azimuth"), "spiral": (), "walk": ("keep",)}[told["path"]]
        more = {name: float(told[name]) for name in names}
        if frames > MOST_FRAMES:
            raise NotTried("checked before")
    poses = PATHS[told["path"]](frames, radius=radius, target=target, **more)
    assert poses.shape == (frames, 4, 4)
    assert np.isfinite(poses).all()


def _through(folder: Path) -> None:
    from harness.command.look_commands import MOST_FRAMES
    from harness.playback.camera_paths import through

    told = _told(folder, "through.json")
    with _as_parsed():
        poses, frames = np.array(told["poses"], dtype=np.float64), int(told["frames"])
        if frames > MOST_FRAMES:
            raise NotTried("checked before")
    assert np.isfinite(through(poses, frames)).all()


def _attention(folder: Path) -> None:
    from baselines.numerics.attention.maps import MAPS, MapInputs
    from baselines.numerics.attention.priorities import allocated_bins, priorities, region_order
    from baselines.numerics.attention.regions import Regions

    told = _told(folder, "attention.json")
    with _as_parsed():
        sizes = [int(told[name]) for name in ("height", "width", "region")]
        row, column, radius, focal = (float(told[name]) for name in ("row", "column", "radius", "focal"))
        values = np.array(told["values"], dtype=np.float64)
        if max(sizes) > 1024 or min(sizes) < 1 or told["map"] not in MAPS:
            raise NotTried("checked before")
    regions = Regions(*sizes)
    sight = MapInputs(regions, row, column, radius, focal, lambda: values, lambda: values, lambda: values)
    found = MAPS[told["map"]](sight)
    assert found.shape == (regions.count,)
    assert np.isfinite(priorities(found)).all()
    assert sorted(region_order(found)) == list(range(regions.count))
    assert (allocated_bins(found, regions.rays, 8.0) >= 1).all()


def _order(folder: Path) -> None:
    from scenes.rendering.store import checked_order

    told = _told(folder, "order.json")
    with _as_parsed():
        numbers = [told["resolution"], *told["counts"].values(), *told["spp"].values()]
        if not isinstance(told["scene"], str) or any(type(one) is not int for one in numbers):
            raise NotTried("checked before")
    checked_order(told["scene"], told["resolution"], told["counts"], told["spp"])


def _judged(name: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        from harness.records.judgements import read_judgement, write_judgement
        from harness.verdicts.judgement import judge
        from harness.verdicts.result_table import read_table

        record = judge(read_table([folder / name]), None, None, {})
        write_judgement(folder / "judgement.json", record)
        assert read_judgement(folder / "judgement.json") == record

    return read
