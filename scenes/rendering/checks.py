"""The look of scenes: repeated renders of one view, a contact sheet."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from scenes.catalog.entries import scene_named
from scenes.files.errors import InputError
from scenes.rendering.render import LoadedScene, render_views, seed_from
from scenes.rendering.store import LARGEST_SPP, check_resolution
from scenes.rendering.variant import choose_variant
from scenes.view_sets.pixels import display_from_linear, over_white
from scenes.view_sets.viewpoints import TILT, all_poses, poses_on_sphere


def repeated(
    scene_name: str, view: int, resolution: int, spp: int, stream: str, count: int, variant: str | None
) -> Iterator[np.ndarray]:
    """Yield `count` estimates float64 [h, w, 4], linear and premultiplied, of a test view; other streams are
    independent. Raises `InputError` for an unknown scene or variant, a missing view and invalid sizes.
    """
    scene = scene_named(scene_name)
    poses = all_poses("test", scene.view_from)
    if not 0 <= view < len(poses):
        raise InputError(f"--view {view}: choose 0 to {len(poses) - 1}")
    for name, value, largest in (("resolution", resolution, 512), ("spp", spp, LARGEST_SPP), ("count", count, 10_000)):
        if not 1 <= value <= largest:
            raise InputError(f"--{name} {value}: must lie between 1 and {largest}")
    loaded = LoadedScene.of(scene, choose_variant(variant), resolution)
    for number in range(count):
        yield loaded.colour(poses[view], spp, seed_from(scene_name, stream, number))


COLUMNS = 4
AZIMUTH, ELEVATION = np.radians(40.0), TILT + np.radians(18.0)


def write_sheet(out: Path, names: Iterable[str], resolution: int, spp: int, variant: str | None) -> None:
    """Render each scene from the front right and above into one PNG; raises `InputError`, also for a bad `out`."""
    from matplotlib.figure import Figure

    if not out.parent.is_dir():
        raise InputError(f"{out}: give a .png file in a folder that exists")
    check_resolution(resolution)
    if not 2 <= spp <= LARGEST_SPP:
        raise InputError(f"--spp {spp}: choose 2 to {LARGEST_SPP}")
    scenes = [scene_named(name) for name in names]
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
