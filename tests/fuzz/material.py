"""Small valid files to corrupt, written by the code that writes them in production."""

import json
import shutil
import warnings
from contextlib import suppress
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import torch
from PIL import Image

from baselines.contract import Box
from baselines.splats.gaussians import Gaussians
from baselines.splats.ply import ply_bytes
from harness.command.plan_options import planned
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.playback.store import ViewStore
from harness.records.cells import read_cells, read_run, write_cell
from harness.records.targets import write_targets
from harness.run_folder.output_folder import claim
from harness.training.lockstep import train_group
from harness.verdicts.survival import targets
from harness.viewer.film.film_folder import claim as claim_film
from harness.viewer.film.takes import FilmSpec
from scenes.modelling.scene import Scene
from scenes.rendering.occupancy import with_occupancy
from scenes.rendering.order import Order
from scenes.rendering.store import checked_order
from scenes.rendering.variant import Variant
from scenes.rendering.writer import write_view_set
from scenes.view_sets.formats.foreign import write_tiny_nerf
from scenes.view_sets.images import write_channels, write_png
from scenes.view_sets.source import Region
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import ball_view, pose, write_ball
from tests.harness.tiny import SCORE, TRAIN
from tests.harness.trained_runs import train_run
from tests.replacing import replace
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_studies import write_fake_studies
from tests.scenes.captures import capture

SIZE = 8
ROOT = Path(__file__).parents[2]
POSES = np.array([pose(0.6 * i, 0.4) for i in range(10)])
METHOD = """from dataclasses import replace
from baselines.catalog import CATALOG
METHOD = replace(CATALOG["nerf"], title="my method")
WRONG = replace(METHOD, title=" ")
"""

ball = partial(write_ball, size=SIZE, train=3, test=2)
"""A view set of another program."""
captured = partial(capture, count=10, poses=POSES)
"""Ten views and a `transforms.json`."""


@cache
def order() -> Order:
    """A ball in the light, in two training and two test views."""
    shapes = {"sky": {"type": "constant"}, "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}}}
    counts, spp = {"train": 2, "val": 0, "test": 2}, dict.fromkeys(("train", "val", "test"), 4)
    return checked_order(Scene("ball", "A ball", lambda: shapes), SIZE, counts, spp)


def own(folder: Path) -> None:
    """A rendered view set: images, their journal, a manifest with every key, and the occupancy."""
    folder.mkdir(parents=True)
    write_view_set(folder, order(), Variant("scalar_rgb", None, "the only one"))
    with_occupancy(folder, order())


def pictures(folder: Path) -> None:
    """Images of every kind that is read, also from other programs."""
    folder.mkdir(parents=True)
    picture = ball_view(POSES[1], SIZE)
    levels = np.round(picture * 255).astype(np.uint8)
    write_png(folder / "a.png", picture)
    write_channels(folder / "a.exr", {name: picture[..., k] for k, name in enumerate("RGBA")})
    channels_of = {"grey.png": 1, "grey_alpha.png": 2, "rgb.png": 3, "a.jpg": 3, "progressive.jpg": 3}
    for name, channels in channels_of.items():
        pixels = levels[..., 0] if channels == 1 else levels[..., :channels].copy()
        Image.fromarray(pixels).save(folder / name, **({"progressive": True} if "progressive" in name else {}))
    Image.fromarray(levels[..., 0]).convert("P").save(folder / "palette.png")
    Image.fromarray(levels[..., 0].astype(np.uint16) * 257).save(folder / "sixteen.png")
    for name, side in (("none", 0), ("rle", 0), ("piz", 0), ("pxr24", 0), ("b44", 0), ("dwaa", 0), ("zip", 4)):
        spec = oiio.ImageSpec(SIZE, SIZE, 4, oiio.FLOAT if name in ("none", "zip") else oiio.HALF)
        spec.attribute("compression", name)
        spec.tile_width = spec.tile_height = side
        target = oiio.ImageOutput.create(str(folder / f"{name}.exr"))
        assert target.open(str(folder / f"{name}.exr"), spec)
        assert target.write_image(picture.astype(np.float32))
        assert target.close()


def trained(folder: Path) -> None:
    """A finished run with its checkpoints in `run`, its view set in `ball`. The records of its cells hold no digests of
    files, which would refuse every corrupt file before it is read.
    """
    out = train_run(folder, ["nerf", "qnerf"], steps=2)
    for cell in read_cells(out):
        write_cell(out, replace(cell, files={}))


def small_run(folder: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_fake_run(folder, seeds=1, size=4, change=lambda run: replace(run, seeds=[0]))
    write_targets(folder, targets(list(read_cells(folder)), list(read_run(folder).methods)))
    write_fake_studies(folder, "serving")


def studies(folder: Path) -> None:
    for shelf in ("speed", "stability", "evidence"):
        write_fake_studies(folder / shelf, shelf)


def gates(folder: Path) -> None:
    """Limits, references and a reference image, as the repository holds them."""
    (folder / "images").mkdir(parents=True)
    image = next((ROOT / "gates/images").glob("*.exr"))
    for name in ("limits.json", "references.json", f"images/{image.name}"):
        shutil.copy(ROOT / "gates" / name, folder / name)


def started(folder: Path) -> None:
    claim(folder / "run", planned("smoke"), Machine("cpu", 1, 1), resume=False)
    claimed_film(folder)


def claimed_film(folder: Path) -> None:
    claim_film(folder / "film", FilmSpec("orbit", 3, 8, None, 0), folder / "run", lambda line: None)


def view_cache(folder: Path) -> None:
    store = ViewStore(0, folder, 1 << 20)
    for number in range(2):
        store.store(64 * f"{number}", np.full((4, 5, 5), 0.25 * number, dtype=np.float32))


def request(folder: Path) -> None:
    folder.mkdir(parents=True)
    body = {"client": "c", "generation": 1, "scene": "ball", "methods": ["nerf"], "width": 16,
            "attention": {"kind": "foveal", "row": 0.5, "column": 0.5},
            "place": {"azimuth": 0.1, "elevation": 0.2, "distance": 4.0, "target": [0.0, 0.0, 0.0]}}  # fmt: skip
    (folder / "request.json").write_text(json.dumps(body), encoding="utf-8")


def tables(folder: Path) -> None:
    """Results in five of the forms that `judge` reads."""
    folder.mkdir(parents=True)
    cells = [
        {"scene": scene, "method": method, "seed": seed, "psnr": 25.0 + 3 * i + 0.1 * seed, "seconds": 60.5}
        for i, (scene, method) in enumerate(product(("chair", "lego", "mic"), ("nerf", "mine")))
        for seed in range(2)
    ]
    views = [f"s{s},{m},r_{v},{20 + s + v}" for s in range(3) for m in "ab" for v in range(2)]
    rows = (r"& \multicolumn{2}{c}{lego} & mic", "M & PSNR & SSIM & PSNR", r"\midrule a & \textbf{30} & .9 & 31")
    body = " \\\\ ".join((*rows, "b & 29 & .8 & 28"))
    texts = {
        "table.json": json.dumps({"cells": cells}),
        "table.csv": "\n".join(",".join(map(str, row)) for row in (cells[0], *(cell.values() for cell in cells))),
        "table.md": "PSNR ↑\n\n|Method|lego|mic|Avg.|\n|---|---|---|---|\n|a|**30.1**|31 ± 0.2|30.5|\n|b|29|28|-|",
        "table.tex": rf"\begin{{tabular}}{{l|ccc}} {body} \\ \end{{tabular}}",
        "spreadsheet.csv": "sep=;\nPSNR;;;\n\n;lego;;mic\nx;PSNR;SSIM;PSNR\na;30,1;0,9;31\nb;29;0,8;28\nc;OOM;;9\n;;;",
        "melted.csv": "scene,method,metric,value\nlego,a,psnr,30\nlego,b,psnr,29\nmic,a,psnr,31\nmic,b,psnr,28",
        "frame.jsonl": "\n".join(f'{{"scene": "{s}", "method": "{m}", "psnr_seed0": 30}}' for s in "xy" for m in "ab"),
        "views.csv": "\n".join(["scene,method,view,psnr", *views]),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def splats(folder: Path) -> None:
    folder.mkdir(parents=True)
    box = Box(-torch.ones(3), torch.ones(3))
    values = 0.3 * torch.randn(5, 23, generator=torch.Generator().manual_seed(0)) - 0.5
    (folder / "splats.ply").write_bytes(ply_bytes(Gaussians(box, 1, values, 0.02, 0.5)))


def tiny(folder: Path) -> None:
    """A tiny-NeRF file of ten views with all arrays that this program writes."""
    folder.mkdir(parents=True)
    region = Region((-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 2.0, 6.0)
    write_tiny_nerf(folder / "tiny.npz", [ball_view(matrix, 6) for matrix in POSES], POSES, 8.0, 8, region)


def scene_files(folder: Path) -> None:
    folder.mkdir(parents=True)
    text = (ROOT / "docs/examples/my_scene.xml").read_text(encoding="utf-8")
    more = (
        '<include filename="parts.xml"/><integrator type="path"><integer name="max_depth" value="6"/></integrator>'
        '<texture type="bitmap" id="t"><string name="filename" value="a.png"/></texture>'
        '<medium type="homogeneous" id="m"><rgb name="sigma_t" value="1 2 3"/><float name="scale" value="2"/></medium>'
    )
    (folder / "mine.xml").write_text(text.replace("</scene>", f"{more}</scene>"), encoding="utf-8")
    (folder / "parts.xml").write_text('<scene version="3.0.0"><shape type="cube"/></scene>', encoding="utf-8")
    shutil.copy(ROOT / "docs/examples/my_scene.py", folder / "mine.py")
    write_png(folder / "a.png", np.full((2, 2, 3), 0.5))


def half_way(folder: Path) -> None:
    """A cell of four steps that was stopped after the first, and its view set."""
    ball(folder / "ball")
    train_on(folder)


def train_on(folder: Path) -> None:
    """One step of the cell, from its snapshot or from the start, and another snapshot."""

    class Stopped(Exception): ...

    def on_progress(share: float) -> None:
        raise Stopped

    views = read_view_set(folder / "ball", scratch=folder)
    task = GroupTask("ball", 0, ("nerf",), TRAIN, SCORE, Budget(4, None), folder, keep_every=0.0)
    with suppress(Stopped):
        list(train_group(task, views, {}, on_progress))


def package(folder: Path) -> None:
    facts = folder / "fuzzed_method-1.2.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: fuzzed-method\nVersion: 1.2\n", encoding="ascii")
    points = "[radiance_verdict.methods]\nmine = fuzzed_method:METHOD\n\n[console_scripts]\nx = y:z\n"
    (facts / "entry_points.txt").write_text(points, encoding="ascii")
    (folder / "fuzzed_method.py").write_text(METHOD, encoding="ascii")
    (folder / "fuzzed_broken.py").write_text("import nothing_that_is_there\n", encoding="ascii")
    (folder / "fuzzed_ending.py").write_text("raise SystemExit('not today')\n", encoding="ascii")
