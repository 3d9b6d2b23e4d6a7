"""Whole files that describe scenes, pictures and packages, and small runs whose pages are built."""

import json
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np

from tests.fuzz import material
from tests.harness.ball import ball_view, pose
from tests.replacing import replace
from tests.reports.fake_evidence import write_fake_evidence
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import write_fake_serving
from tests.reports.fake_speed import write_fake_speed
from tests.reports.fake_stability import write_fake_stability
from tests.scenes.captures import capture

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
METHOD = """from dataclasses import replace
from baselines.catalog import CATALOG
METHOD = replace(CATALOG["nerf"], title="one of mine")
WRONG = replace(METHOD, title=" ")
"""


def captured(folder: Path) -> None:
    """Ten views and a `transforms.json`."""
    capture(folder, 10, np.array([pose(0.6 * i, 0.4) for i in range(10)]))


def tiny(folder: Path) -> None:
    """A tiny-NeRF file of ten views with all arrays that ours have."""
    from scenes.view_sets.foreign import write_tiny_nerf
    from scenes.view_sets.source import Region

    folder.mkdir(parents=True)
    poses = np.array([pose(0.6 * i, 0.4) for i in range(10)])
    region = Region((-1.5, -1.5, -1.5, 1.5, 1.5, 1.5), 2.0, 6.0)
    write_tiny_nerf(folder / "tiny.npz", [ball_view(one, 6) for one in poses], poses, 8.0, 8, region)


def scene_files(folder: Path) -> None:
    """A Mitsuba file with a part of its own and a picture, and a Python file."""
    from scenes.view_sets.images import write_png

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
    told = {"boxes": [[[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], [[0.0, 0.0, 0.0], [2.0, 1.0, 1.0]]]}
    (folder / "boxes.json").write_text(json.dumps({**told, "up": [0.0, 1.0, 0.0], "lights": 1}), encoding="ascii")


def kept_pictures(folder: Path) -> None:
    """Truth and renders of two views of 4 × 4 pixels."""
    from harness.records.pictures import Render, Truth, half, write_renders, write_truth

    colour, grey = half(np.full((4, 4, 3), 0.5)), half(np.full((4, 4), 0.5))
    write_truth(folder / "truth.safetensors", [Truth("r_0", colour, grey, colour, grey), Truth("r_1", colour, grey)])
    write_renders(
        folder / "renders.safetensors", [Render(f"r_{i}", step, colour, grey, grey) for step in (5, 9) for i in (0, 1)]
    )


def half_way(folder: Path) -> None:
    """A cell of four steps that was stopped after the first, and its view set."""
    material.ball(folder / "ball")
    train_on(folder)


def train_on(folder: Path) -> None:
    """One step of the cell, from where it was kept or from the start; it is then kept."""

    from harness.plan.group_task import GroupTask
    from harness.plan.schedule import Budget
    from harness.training.lockstep import train_group
    from scenes.view_sets.view_set import read_view_set
    from tests.harness.tiny import SCORE, TRAIN

    class Stopped(Exception): ...

    def on_progress(share: float) -> None:
        raise Stopped

    views = read_view_set(folder / "ball", scratch=folder)
    task = GroupTask("ball", 0, ("nerf",), TRAIN, SCORE, Budget(4, None), folder, keep_every=0.0)
    with suppress(Stopped):
        list(train_group(task, views, {}, on_progress))


def inside(folder: Path) -> None:
    """A view set of ours and where its matter is."""
    from scenes.rendering.occupancy import NAME, _bound_to, _write
    from scenes.view_sets.manifest import read_manifest

    material.own(folder)
    cells = np.zeros(32**3, dtype=bool)
    cells[9_000:20_000] = True
    _write(folder / NAME, _bound_to(read_manifest(folder)), np.packbits(cells).tobytes())


def unfinished(folder: Path) -> None:
    """Views that were rendered, with their journal, and the manifest of a set that was whole once."""
    from scenes.view_sets.manifest import note

    donor = folder / "donor"
    material.own(donor)
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


def small_run(folder: Path) -> None:
    """Records of two scenes and three methods, with pictures."""
    from harness.records.cells import read_cells, read_run
    from harness.records.targets import write_targets
    from harness.verdicts.survival import targets

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_fake_run(folder, seeds=1, size=4, change=lambda run: replace(run, seeds=[0]))
    write_targets(folder, targets(list(read_cells(folder)), list(read_run(folder).methods)))


def small_run_served(folder: Path) -> None:
    """With what was served, which stands in the same page."""
    small_run(folder)
    write_fake_serving(folder)


def alone_speed(folder: Path) -> None:
    write_fake_speed(folder)


def alone_stability(folder: Path) -> None:
    write_fake_stability(folder)


def alone_evidence(folder: Path) -> None:
    folder.mkdir(parents=True)
    write_fake_evidence(folder)
