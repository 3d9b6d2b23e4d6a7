"""A labelled contact sheet of scenes, for the README and for looking at them."""

from pathlib import Path

import numpy as np

from scenes.catalog import CLASSICS, scene_named
from scenes.errors import InputError
from scenes.pixels import display_from_linear, over_white
from scenes.render import LoadedScene, render_views, seed_from
from scenes.store import LARGEST_SPP, check_resolution
from scenes.variant import choose_variant
from scenes.viewpoints import TILT, poses_on_sphere

COLUMNS = 4
AZIMUTH, ELEVATION = np.radians(40.0), TILT + np.radians(18.0)


def write_sheet(
    out: Path, names: list[str] | None = None, resolution: int = 400, spp: int = 256, variant: str | None = None
) -> None:
    """Renders each scene once from the front right and above, and writes them with their names as one PNG.

    Raises `InputError` for an unknown scene or a file that cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.use("Agg")
    if out.suffix.lower() != ".png" or not out.parent.is_dir():
        raise InputError(f"{out}: give a .png file in a folder that exists")
    check_resolution(resolution)
    if not 2 <= spp <= LARGEST_SPP:
        raise InputError(f"--spp {spp}: choose 2 to {LARGEST_SPP}")
    scenes = [scene_named(name) for name in names or CLASSICS]
    chosen = choose_variant(variant)
    pose = poses_on_sphere(np.array([AZIMUTH]), np.array([ELEVATION]))
    columns = min(COLUMNS, len(scenes))
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(columns * resolution / 100, rows * (resolution + 30) / 100), dpi=100, facecolor="white")
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"wspace": 0, "hspace": 0.075})
    figure.subplots_adjust(left=0, right=1, bottom=0, top=1 - 30 / (rows * (resolution + 30)))
    for axis in axes.flat:
        axis.axis("off")
    for axis, scene in zip(axes.flat, scenes, strict=False):
        loaded = LoadedScene.of(scene, chosen, resolution)
        view = next(render_views(loaded, pose, spp, [seed_from(scene.name, "sheet")], [scene.name]))
        axis.imshow(over_white(display_from_linear(view.rgba)), interpolation="nearest")
        axis.set_title(scene.name, fontsize=14, pad=6)
    try:
        figure.savefig(out)
    except OSError as error:
        raise InputError(f"{out}: cannot be written ({error.strerror}); choose another file") from error
