"""Whole files and folders to spoil, each made once: by the programs that write them, as small as they can be."""

import json
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
from PIL import Image

from harness.plan.group_task import GroupTask
from harness.plan.profiles import Machine, planned
from harness.plan.schedule import Budget
from harness.playback.disk import DiskPictures, frozen
from harness.records.cells import read_cells, read_run, write_cell
from harness.records.pictures import Render, Truth, half, write_renders, write_truth
from harness.records.targets import write_targets
from harness.run_folder.output_folder import claim
from harness.training.lockstep import train_group
from harness.verdicts.survival import targets
from harness.viewer.film.film_folder import claim as claim_film
from harness.viewer.film.takes import FilmSpec
from scenes.catalog.entries import scene_named
from scenes.modelling.needs import as_rows, left_out, needs
from scenes.rendering.occupancy import write_occupancy
from scenes.view_sets.formats.foreign import write_tiny_nerf
from scenes.view_sets.formats.transforms import write_transforms
from scenes.view_sets.images import write_channels, write_png
from scenes.view_sets.manifest import note, read_manifest, write_manifest
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import FOV_X_RADIANS, ball_view, pose, write_ball
from tests.harness.tiny import SCORE, TRAIN
from tests.harness.trained_runs import train_run
from tests.replacing import replace
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_studies import write_fake_studies
from tests.scenes.captures import capture

SIZE = 8
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
METHOD = """from dataclasses import replace
from baselines.catalog import CATALOG
METHOD = replace(CATALOG["nerf"], title="one of mine")
WRONG = replace(METHOD, title=" ")
"""


def ball(folder: Path) -> None:
    """A view set of somebody else's."""
    write_ball(folder, size=SIZE, train=3, test=2)


def own(folder: Path) -> None:
    """A view set of ours: EXR files and a manifest with every key that the renderer writes."""
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
    scene_needs = needs(scene_named("hotdog").build())
    facts = {
        "scene": "ball", "title": "A ball", "digest": "0" * 64, "near": 2.0, "far": 6.0,
        "bounds": [[-1.1] * 3, [1.1] * 3], "view_from": "hemisphere", "resolution": SIZE, "counts": counts,
        "empty_splits": ["val"], "spp": {"train": 16, "val": 16, "test": 64}, "max_depth": 8, "emitters_seen": False,
        "normalised": {"scale": 1.0, "shift": [0.0, 0.0, 0.0]}, "variant": "scalar_rgb", "variant_why": "the only one",
        "integrator": "path", "versions": {"mitsuba": "3", "drjit": "1", "python": "3"}, "seconds": 1.0,
        "needs": as_rows(scene_needs), "left_out": left_out(scene_needs), "views": views,
    }  # fmt: skip
    write_manifest(folder, facts, files)


def report(folder: Path) -> None:
    """Records of everything that a report shows."""
    small_run(folder, seeds=2)
    for shelf in ("speed", "stability", "evidence", "serving"):
        write_fake_studies(folder, shelf)


def trained(folder: Path) -> None:
    """A run with its checkpoints in `run`, its view set in `ball` beside it; its records hold no digests of weights,
    as old ones, or every spoilt file would be refused before it is read.
    """
    out = train_run(folder, ["nerf", "qnerf"], steps=2)
    for cell in read_cells(out):
        write_cell(out, replace(cell, files={}))


def pictures(folder: Path) -> None:
    """Images of every kind that is read, as other programs write them as well."""

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
        _foreign_exr(folder / f"{name}.exr", picture, name, tile=0)
    _foreign_exr(folder / "tiled.exr", picture, "zip", tile=4)


def _foreign_exr(file: Path, picture: np.ndarray, compression: str, tile: int) -> None:
    half = compression not in ("none", "zip")
    spec = oiio.ImageSpec(*picture.shape[1::-1], 4, oiio.HALF if half else oiio.FLOAT)
    spec.attribute("compression", compression)
    spec.tile_width = spec.tile_height = tile
    target = oiio.ImageOutput.create(str(file))
    assert target.open(str(file), spec)
    assert target.write_image(picture.astype(np.float32))
    assert target.close()


def gates(folder: Path) -> None:
    """Limits, references and a reference image, as the repository holds them."""
    root = Path(__file__).parents[2] / "gates"
    (folder / "images").mkdir(parents=True)
    for name in ("limits.json", "references.json"):
        (folder / name).write_bytes((root / name).read_bytes())
    reference = next((root / "images").glob("*.exr"))
    (folder / "images" / reference.name).write_bytes(reference.read_bytes())


def started(folder: Path) -> None:
    """A run, a film and a search of which nothing is done yet."""
    claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=False)
    claimed_film(folder)


def claimed_film(folder: Path) -> None:
    claim_film(folder / "film", FilmSpec("orbit", 3, 8, None, 0), folder / "run", lambda line: None)


def view_cache(folder: Path) -> None:
    """A view cache with two pictures."""
    disk = DiskPictures(folder / "cache", 1 << 20)
    for number in range(2):
        assert disk.put(f"key {number}", frozen(np.full((4, 5, 5), 0.25 * number, dtype=np.float32)))


def numbers(folder: Path) -> None:
    """Arguments of functions that take numbers, as JSON."""
    folder.mkdir(parents=True)
    path = {"path": "orbit", "frames": 4, "radius": 4.0, "target": [0.0, 0.0, 0.0], "seed": 1, "keep": 0.75}
    (folder / "path.json").write_text(json.dumps({**path, "elevation": 0.5, "azimuth": 1.0}), encoding="utf-8")
    sight = {"map": "point", "height": 6, "width": 8, "region": 2, "row": 2.0, "column": 3.5, "radius": 1.5,
             "focal": 9.0, "values": [[0.1 * (i + j) for j in range(8)] for i in range(6)]}  # fmt: skip
    (folder / "attention.json").write_text(json.dumps(sight), encoding="utf-8")
    request = {"client": "c", "generation": 1, "scene": "ball", "methods": ["nerf"], "width": 16,
               "attention": {"kind": "foveal", "row": 0.5, "column": 0.5},
               "place": {"azimuth": 0.1, "elevation": 0.2, "distance": 4.0, "target": [0.0, 0.0, 0.0]}}  # fmt: skip
    (folder / "request.json").write_text(json.dumps(request), encoding="utf-8")
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
    lines = [",".join(map(str, line)) for line in (cells[0], *(cell.values() for cell in cells))]
    (folder / "table.csv").write_text("\n".join(lines), encoding="utf-8")


def captured(folder: Path) -> None:
    """Ten views and a `transforms.json`."""
    capture(folder, 10, np.array([pose(0.6 * i, 0.4) for i in range(10)]))


def tiny(folder: Path) -> None:
    """A tiny-NeRF file of ten views with all arrays that ours have."""
    folder.mkdir(parents=True)
    poses = np.array([pose(0.6 * i, 0.4) for i in range(10)])
    region = Region((-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 2.0, 6.0)
    write_tiny_nerf(folder / "tiny.npz", [ball_view(matrix, 6) for matrix in poses], poses, 8.0, 8, region)


def scene_files(folder: Path) -> None:
    """A Mitsuba file with a part of its own and a picture, and a Python file."""
    folder.mkdir(parents=True)
    text = (EXAMPLES / "my_scene.xml").read_text(encoding="utf-8")
    more = (
        '<include filename="parts.xml"/><integrator type="path"><integer name="max_depth" value="6"/></integrator>'
        '<texture type="bitmap" id="t"><string name="filename" value="a.png"/></texture>'
        '<medium type="homogeneous" id="m"><rgb name="sigma_t" value="1 2 3"/><float name="scale" value="2"/></medium>'
    )
    (folder / "mine.xml").write_text(text.replace("</scene>", f"{more}</scene>"), encoding="utf-8")
    (folder / "parts.xml").write_text('<scene version="3.0.0"><shape type="cube"/></scene>', encoding="utf-8")
    (folder / "mine.py").write_bytes((EXAMPLES / "my_scene.py").read_bytes())
    write_png(folder / "a.png", np.full((2, 2, 3), 0.5))


def boxes(folder: Path) -> None:
    folder.mkdir(parents=True)
    shapes = {"boxes": [[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], [[0.0, 0.0, 0.0], [2.0, 1.0, 1.0]]]}
    (folder / "boxes.json").write_text(json.dumps({**shapes, "up": [0.0, 1.0, 0.0], "lights": 1}), encoding="ascii")


def kept_pictures(folder: Path) -> None:
    """Truth and renders of two views of 4 × 4 pixels."""
    colour, grey = half(np.full((4, 4, 3), 0.5)), half(np.full((4, 4), 0.5))
    write_truth(folder / "truth.safetensors", [Truth("r_0", colour, grey, colour, grey), Truth("r_1", colour, grey)])
    write_renders(
        folder / "renders.safetensors", [Render(f"r_{i}", step, colour, grey, grey) for step in (5, 9) for i in (0, 1)]
    )


def half_way(folder: Path) -> None:
    """A cell of four steps that was stopped after the first, and its view set."""
    ball(folder / "ball")
    train_on(folder)


def train_on(folder: Path) -> None:
    """One step of the cell, from where it was kept or from the start; it is then kept."""

    class Stopped(Exception): ...

    def on_progress(share: float) -> None:
        raise Stopped

    views = read_view_set(folder / "ball", scratch=folder)
    task = GroupTask("ball", 0, ("nerf",), TRAIN, SCORE, Budget(4, None), folder, keep_every=0.0)
    with suppress(Stopped):
        list(train_group(task, views, {}, on_progress))


def inside(folder: Path) -> None:
    """A view set of ours and where its matter is."""
    own(folder)
    cells = np.zeros(32**3, dtype=bool)
    cells[9_000:20_000] = True
    write_occupancy(folder, read_manifest(folder), cells)


def unfinished(folder: Path) -> None:
    """Views that were rendered, with their journal, and the manifest of a set that was whole once."""
    donor = folder / "donor"
    own(donor)
    for split in ("train", "test"):
        for number in range(2):
            facts = {"noise_mse": 1e-6, "seen": True, "lit": True, "seconds": 0.5}
            note(donor, "0" * 64, f"{split}/r_{number}", facts)


def packages(folder: Path) -> None:
    """A folder of packages, one of which offers methods."""
    facts = folder / "fuzzed_method-1.2.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: fuzzed-method\nVersion: 1.2\n", encoding="ascii")
    points = "[radiance_verdict.methods]\nmine = fuzzed_method:METHOD\n\n[console_scripts]\nx = y:z\n"
    (facts / "entry_points.txt").write_text(points, encoding="ascii")
    (folder / "fuzzed_method.py").write_text(METHOD, encoding="ascii")
    (folder / "fuzzed_broken.py").write_text("import nothing_that_is_there\n", encoding="ascii")
    (folder / "fuzzed_ending.py").write_text("raise SystemExit('not today')\n", encoding="ascii")


def small_run(folder: Path, seeds: int = 1) -> None:
    """Records of two scenes and three methods, with pictures."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_fake_run(folder, seeds=seeds, size=4, change=lambda run: replace(run, seeds=list(range(seeds))))
    write_targets(folder, targets(list(read_cells(folder)), list(read_run(folder).methods)))


def small_run_served(folder: Path) -> None:
    """With what was served, which stands in the same page."""
    small_run(folder)
    write_fake_studies(folder, "serving")


def alone_evidence(folder: Path) -> None:
    write_fake_studies(folder, "evidence")


def alone_speed(folder: Path) -> None:
    write_fake_studies(folder, "speed")


def alone_stability(folder: Path) -> None:
    write_fake_studies(folder, "stability")
