"""Cost and look of scenes: a comparison of integrators, repeated renders of one view, a contact sheet."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scenes.catalog.entries import CLASSICS, scene_named
from scenes.files.errors import InputError
from scenes.rendering.render import LoadedScene, render_views, seed_from
from scenes.rendering.store import LARGEST_SPP, check_resolution
from scenes.rendering.variant import choose_variant
from scenes.view_sets.pixels import display_from_linear, over_white
from scenes.view_sets.viewpoints import TILT, all_poses, camera_to_world, poses_on_sphere

INTEGRATORS = ("path", "volpath")
BLOCK = 8
"""The pixels along each side of a compared block: the noise of a single pixel exceeds any relevant difference."""


@dataclass(frozen=True)
class Comparison:
    scene: str
    seconds: dict[str, float]
    """The seconds of rendering all views, by integrator, without compilation."""
    samples: int
    """The number of camera paths of all views together, per integrator."""
    squared: list[float]
    """The squared difference of each view's mean display colours in blocks, less noise: unbiased, so it can be < 0."""


def compared(scene_name: str, resolution: int, views: int, spp: int, variant: str | None = None) -> Comparison:
    """Compare integrators, which take turns in going first. Raises `InputError` for what cannot be rendered."""
    scene = scene_named(scene_name)
    check_resolution(resolution)
    if views < 1:
        raise InputError(f"--views {views}: choose 1 or more")
    if spp < 2:
        raise InputError(f"--spp {spp}: two halves are needed to subtract the noise; choose 2 or more")
    poses = camera_to_world("test", scene.view_from, views)
    chosen = choose_variant(variant)
    loaded = {name: LoadedScene.of(scene, chosen, resolution, integrator=name) for name in INTEGRATORS}
    for renderer in loaded.values():
        renderer.colour(poses[0], spp, seed_from("warm-up"))
    seconds = dict.fromkeys(INTEGRATORS, 0.0)
    squared = []
    for number, pose in enumerate(poses):
        halves = {}
        for name in INTEGRATORS if number % 2 else reversed(INTEGRATORS):
            began = time.perf_counter()
            images = [loaded[name].colour(pose, spp // 2, seed_from(scene_name, number, name, half)) for half in "ab"]
            seconds[name] += time.perf_counter() - began
            halves[name] = [in_blocks(over_white(display_from_linear(image))) for image in images]
        (a, b), (c, d) = halves["path"], halves["volpath"]
        # two independent estimates of one difference: the mean of their product is its square, without noise
        squared.append(float(np.mean((a - c) * (b - d))))
    return Comparison(scene_name, seconds, views * resolution**2 * (spp // 2 * 2), squared)


def in_blocks(image: np.ndarray) -> np.ndarray:
    """Return the means [rows, columns, 3] of an image [h, w, 3] over complete blocks of `BLOCK` pixels."""
    side = min(BLOCK, *image.shape[:2])
    rows, columns = (size // side for size in image.shape[:2])
    covered = image[: rows * side, : columns * side].astype(np.float64)
    means: np.ndarray = covered.reshape(rows, side, columns, side, 3).mean(axis=(1, 3))
    return means


def repeated(
    scene_name: str, view: int, resolution: int, spp: int, stream: str, count: int, variant: str | None = None
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


def write_sheet(
    out: Path, names: list[str] | None = None, resolution: int = 400, spp: int = 256, variant: str | None = None
) -> None:
    """Render each scene once from the front right and above, and write them with their names as one PNG. Raises
    `InputError` for an unknown scene or a file that cannot be written.
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
