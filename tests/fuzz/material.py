"""Whole files and folders to spoil, each made once: by the programs that write them, as small as they can be."""

import json
import warnings
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from tests.fuzz.viewer_requests import REQUEST
from tests.harness.ball import FOV_X_RADIANS, ball_view, pose, write_ball
from tests.reports.fake_evidence import write_fake_evidence
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import write_fake_serving
from tests.reports.fake_speed import write_fake_speed
from tests.reports.fake_stability import write_fake_stability

SIZE = 8


def ball(folder: Path) -> None:
    """A view set of somebody else's."""
    write_ball(folder, size=SIZE, train=3, test=2)


def own(folder: Path) -> None:
    """A view set of ours: EXR files and a manifest with every key that the renderer writes."""
    from scenes.catalog.entries import scene_named
    from scenes.modelling.needs import as_rows, left_out, needs
    from scenes.view_sets.images import write_channels, write_png
    from scenes.view_sets.manifest import write_manifest
    from scenes.view_sets.transforms import write_transforms

    files, views = [], {}
    for split in ("train", "test"):
        (folder / split).mkdir(parents=True)
        poses = np.array([pose(1.0 + i, 0.4) for i in range(2)])
        for i, matrix in enumerate(poses):
            picture = ball_view(matrix, SIZE).astype(np.float32)
            channels = {
                name: picture[..., k] * (picture[..., 3] if name != "A" else 1) for k, name in enumerate("RGBA")
            }
            channels["Z"] = np.where(picture[..., 3] > 0, 3.0, 0.0)
            channels |= {f"N.{axis}": np.where(picture[..., 3] > 0, axis == "Z", 0.0) for axis in "XYZ"}
            channels |= {f"V.{name}": np.full((SIZE, SIZE), 1e-5) for name in "RGBA"}
            write_png(folder / split / f"r_{i}.png", picture)
            write_channels(folder / split / f"r_{i}.exr", channels)
            files += [folder / split / f"r_{i}.{suffix}" for suffix in ("png", "exr")]
            views[f"{split}/r_{i}"] = {"noise_mse": 1e-6, "viewpoint": i}
        listing = folder / f"transforms_{split}.json"
        write_transforms(listing, FOV_X_RADIANS, [f"./{split}/r_{i}" for i in range(2)], poses)
        files.append(listing)
    counts = {"train": 2, "val": 0, "test": 2}
    found = needs(scene_named("hotdog").build())
    facts = {
        "scene": "ball", "title": "A ball", "digest": "0" * 64, "near": 2.0, "far": 6.0,
        "bounds": [[-1.1] * 3, [1.1] * 3], "view_from": "hemisphere", "resolution": SIZE, "counts": counts,
        "empty_splits": ["val"], "spp": {"train": 16, "val": 16, "test": 64}, "max_depth": 8, "emitters_seen": False,
        "normalised": {"scale": 1.0, "shift": [0.0, 0.0, 0.0]}, "variant": "scalar_rgb", "variant_why": "the only one",
        "integrator": "path", "versions": {"mitsuba": "3", "drjit": "1", "python": "3"}, "seconds": 1.0,
        "needs": as_rows(found), "left_out": left_out(found), "views": views,
    }  # fmt: skip
    write_manifest(folder, facts, files)


def report(folder: Path) -> None:
    """Records of everything that a report shows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_fake_run(folder, seeds=2, size=SIZE)
        write_fake_speed(folder)
        write_fake_stability(folder)
        write_fake_evidence(folder)
        write_fake_serving(folder)
    from harness.records.cells import read_cells, read_run
    from harness.records.targets import write_targets
    from harness.verdicts.survival import targets

    write_targets(folder, targets(list(read_cells(folder)), list(read_run(folder).methods)))


def trained(folder: Path) -> None:
    """A run with its checkpoints in `run`, its view set in `ball` beside it; its records hold no digests of weights,
    as old ones, or every spoilt file would be refused before it is read.
    """
    from harness.records.cells import read_cells, write_cell
    from tests.harness.trained_runs import train_run

    out = train_run(folder, ["nerf", "qnerf"], steps=2)
    for cell in read_cells(out):
        write_cell(out, replace(cell, files={}))


def pictures(folder: Path) -> None:
    """Images of every kind that is read, as other programs write them as well."""
    import OpenImageIO as oiio
    from PIL import Image

    from scenes.view_sets.images import write_channels, write_png

    folder.mkdir(parents=True)
    picture = ball_view(pose(1.0, 0.4), SIZE)
    levels = np.round(picture * 255).astype(np.uint8)
    write_png(folder / "a.png", picture)
    write_png(folder / "rgb.png", picture[..., :3])
    Image.fromarray(levels[..., 0]).save(folder / "grey.png")
    Image.fromarray(levels[..., :2].copy(), "LA").save(folder / "grey_alpha.png")
    Image.fromarray(levels[..., 0]).convert("P").save(folder / "palette.png")
    Image.fromarray(levels[..., 0].astype(np.uint16) * 257).save(folder / "sixteen.png")
    Image.fromarray(levels[..., :3].copy()).save(folder / "a.jpg")
    Image.fromarray(levels[..., :3].copy()).save(folder / "progressive.jpg", progressive=True)
    write_channels(folder / "a.exr", {name: picture[..., k] for k, name in enumerate("RGBA")})
    for name in ("none", "rle", "piz", "pxr24", "b44", "dwaa"):
        _foreign_exr(oiio, folder / f"{name}.exr", picture, name, tile=0)
    _foreign_exr(oiio, folder / "tiled.exr", picture, "zip", tile=4)


def _foreign_exr(oiio: object, file: Path, picture: np.ndarray, compression: str, tile: int) -> None:
    half = compression not in ("none", "zip")
    spec = oiio.ImageSpec(*picture.shape[1::-1], 4, oiio.HALF if half else oiio.FLOAT)  # type: ignore[attr-defined]
    spec.attribute("compression", compression)
    spec.tile_width = spec.tile_height = tile
    target = oiio.ImageOutput.create(str(file))  # type: ignore[attr-defined]
    assert target.open(str(file), spec)
    assert target.write_image(picture.astype(np.float32))
    assert target.close()


def gates(folder: Path) -> None:
    """Limits, references and a reference image, as the repository holds them."""
    root = Path(__file__).parents[2] / "gates"
    (folder / "images").mkdir(parents=True)
    (folder / "limits.json").write_bytes((root / "limits.json").read_bytes())
    reference = next((root / "images").glob("*.exr"))
    (folder / "images" / reference.name).write_bytes(reference.read_bytes())
    (folder / "classes").mkdir()
    (folder / "classes" / "avx2.json").write_bytes((root / "classes" / "avx2.json").read_bytes())


def started(folder: Path) -> None:
    """A run, a film and a search of which nothing is done yet."""
    from harness.plan.profiles import Machine, planned
    from harness.run_folder.output_folder import claim
    from harness.viewer.film.film_folder import claim as claim_film
    from harness.viewer.film.takes import FilmSpec

    claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=False)
    claim_film(folder / "film", FilmSpec("orbit", 3, 8, None, 0), folder / "run", lambda line: None)
    from harness.studies.choices.repair_search import PUBLISHED

    (folder / "search.json").write_bytes(PUBLISHED.read_bytes())


def view_cache(folder: Path) -> None:
    """A view cache with two pictures."""
    from harness.playback.disk import DiskPictures
    from harness.playback.float_exr import frozen

    disk = DiskPictures(folder / "cache", 1 << 20)
    for number in range(2):
        assert disk.put(f"key {number}", frozen(np.full((4, 5, 5), 0.25 * number, dtype=np.float32)))


def numbers(folder: Path) -> None:
    """Arguments of functions that take numbers, as JSON."""
    folder.mkdir(parents=True)
    path = {"path": "orbit", "frames": 4, "radius": 4.0, "target": [0.0, 0.0, 0.0], "seed": 1, "keep": 0.75}
    (folder / "path.json").write_text(json.dumps({**path, "elevation": 0.5, "azimuth": 1.0}), encoding="utf-8")
    poses = [pose(0.3 * i, 0.5).tolist() for i in range(3)]
    (folder / "through.json").write_text(json.dumps({"frames": 5, "poses": poses}), encoding="utf-8")
    sight = {"map": "point", "height": 6, "width": 8, "region": 2, "row": 2.0, "column": 3.5, "radius": 1.5,
             "focal": 9.0, "values": [[0.1 * (i + j) for j in range(8)] for i in range(6)]}  # fmt: skip
    (folder / "attention.json").write_text(json.dumps(sight), encoding="utf-8")
    (folder / "request.json").write_text(json.dumps(REQUEST), encoding="utf-8")
    order = {"scene": "lego", "resolution": 8, "counts": {"train": 2, "val": 0, "test": 1},
             "spp": {"train": 2, "val": 2, "test": 4}}  # fmt: skip
    (folder / "order.json").write_text(json.dumps(order), encoding="utf-8")


def tables(folder: Path) -> None:
    """Somebody's results in two of the forms that `judge` reads."""
    folder.mkdir(parents=True)
    cells = [
        {"scene": scene, "method": method, "seed": seed, "psnr": 25.0 + 3 * i + j + 0.1 * seed, "seconds": 60.5}
        for i, scene in enumerate(("chair", "lego", "mic"))
        for j, method in enumerate(("nerf", "mine"))
        for seed in range(2)
    ]
    (folder / "table.json").write_text(json.dumps({"cells": cells}), encoding="utf-8")
    lines = [",".join(map(str, line)) for line in (cells[0], *(one.values() for one in cells))]
    (folder / "table.csv").write_text("\n".join(lines), encoding="utf-8")
