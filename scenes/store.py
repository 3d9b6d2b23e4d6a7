"""The cache of rendered view sets: each is named by a hash of everything that it depends on.

A view set is rendered into a temporary sibling and renamed into place, so that what bears its name is whole.
"""

import errno
import importlib.metadata
import os
import platform
import re
import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.catalog import scene_named
from scenes.digest import digest_of
from scenes.errors import InputError
from scenes.images import write_channels, write_png
from scenes.manifest import SCHEMA, check_all, write_manifest
from scenes.needs import as_rows, left_out, needs
from scenes.normalise import Similarity, normalised
from scenes.pixels import display_from_linear
from scenes.scene import Description, Scene
from scenes.transforms import transforms_file, write_transforms
from scenes.variant import VARIANTS, Variant, choose_variant, known_variant
from scenes.viewpoints import FOV_X_RADIANS, SPLITS, all_poses, evenly_spread

LARGEST_RESOLUTION = 4096
LARGEST_SPP = 1 << 16
STALE_SECONDS = 48 * 3600
_PARTIAL = ".partial"

Progress = Callable[[int, int], None]
"""Called with the views done so far and all views."""


@dataclass(frozen=True)
class Order:
    """A view set to be rendered, checked."""

    scene: Scene
    description: Description
    """As it is rendered: normalised where it had to be."""
    similarity: Similarity | None
    """What normalised it."""
    resolution: int
    counts: dict[str, int]
    spp: dict[str, int]
    integrator: str | None = None
    """`path` or `volpath`, whatever the scene needs."""

    def poses(self, split: str) -> tuple[np.ndarray, np.ndarray]:
        """Indices [n] of the viewpoints in the whole split, and their cameras [n, 4, 4]."""
        everything = all_poses(split, self.scene.view_from)  # type: ignore[arg-type]
        chosen = evenly_spread(self.counts[split], everything, f"{split} views")
        return chosen, everything[chosen]

    def digest(self, variant: str) -> str:
        """Hexadecimal hash of everything that the images depend on."""
        from scenes.render import RENDERER_VERSION  # does not import Mitsuba by itself

        scene = self.scene
        return digest_of(
            {
                "format": SCHEMA,
                "renderer": RENDERER_VERSION,
                "versions": _versions(),
                "variant": variant,
                "description": self.description,
                "needs": {name: need.needed for name, need in needs(self.description).items()},
                **({"integrator": self.integrator} if self.integrator else {}),
                "scene": [scene.name, scene.title, scene.view_from, scene.max_depth, scene.near, scene.far],
                "emitters_seen": scene.emitters_seen,
                "box": scene.box,
                "normalised": _similarity(self.similarity),
                "resolution": self.resolution,
                "fov": FOV_X_RADIANS,
                "spp": self.spp,
                "viewpoints": {split: self.poses(split)[0] for split in SPLITS},
                "cameras": {split: self.poses(split)[1] for split in SPLITS},
            }
        )


def ensure_view_set(
    scene_name: str,
    *,
    resolution: int,
    counts: dict[str, int],
    spp: dict[str, int],
    cache_folder: Path | str,
    variant: str | None = None,
    progress: Progress | None = None,
    integrator: str | None = None,
) -> Path:
    """The folder of the rendered view set, from the cache where it is there and whole, else rendered now.

    `counts` and `spp` (samples a pixel, 2 or more) are given for train, val and test. With `variant` None a set that
    any variant rendered will do; if none is there, the fastest that works renders it. Several processes may ask for
    the same set at once. Raises `InputError` for a bad request or a folder that cannot be written.
    """
    order = replace(checked_order(scene_name, resolution, counts, spp), integrator=integrator)
    wanted = known_variant(variant)
    cache = Path(cache_folder)
    for name in VARIANTS if wanted is None else (wanted,):
        stored = _folder(cache, order, name)
        if is_complete(stored):
            return stored
    chosen = choose_variant(variant)
    target = _folder(cache, order, chosen.name)
    with _disk(cache):
        cache.mkdir(parents=True, exist_ok=True)
        remove_stale(cache)
        partial = Path(tempfile.mkdtemp(prefix=f".{target.name}.{_host()}.{os.getpid()}.", suffix=_PARTIAL, dir=cache))
        partial.chmod(0o755)  # mkdtemp lets nobody else read
        try:
            write_view_set(partial, order, chosen, progress)
            _move_into_place(partial, target)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return target


def checked_order(scene_name: str, resolution: int, counts: dict[str, int], spp: dict[str, int]) -> Order:
    """Raises `InputError` that names the value and the remedy."""
    scene = scene_named(scene_name)
    if not 1 <= resolution <= LARGEST_RESOLUTION:
        raise InputError(f"resolution {resolution}: choose 1 to {LARGEST_RESOLUTION} pixels")
    for name, given, smallest, largest in (("counts", counts, 0, None), ("spp", spp, 2, LARGEST_SPP)):
        if set(given) != set(SPLITS):
            raise InputError(f"{name} {given}: give one number each for {' '.join(SPLITS)}")
        for split, value in given.items():
            if value < smallest or (largest is not None and value > largest):
                raise InputError(f"{name} of {split} {value}: choose {smallest} to {largest or 'what there is'}")
    order = Order(
        scene,
        *normalised(scene),
        resolution,
        {split: counts[split] for split in SPLITS},
        {split: spp[split] for split in SPLITS},
    )
    if not sum(counts.values()):
        raise InputError(f"no view of {scene_name} was asked for; choose at least one")
    for split in SPLITS:
        order.poses(split)
    return order


def is_complete(folder: Path) -> bool:
    """Whether every file of the view set is there and whole; False for anything else, whatever is wrong with it."""
    if not folder.is_dir():
        return False
    try:
        check_all(folder)
    except (InputError, OSError, KeyError, TypeError):
        return False
    return True


def write_view_set(folder: Path, order: Order, variant: Variant, progress: Progress | None = None) -> None:
    """Renders into an existing, empty folder; the manifest is written last."""
    from scenes.render import LoadedScene, render_views, seed_from

    scene, started = order.scene, time.perf_counter()
    size = order.resolution
    loaded = LoadedScene(
        order.description, variant, scene.max_depth, size, size, integrator=order.integrator,
        emitters_seen=scene.emitters_seen, box=scene.box,
    )  # fmt: skip
    files: list[Path] = []
    views: dict[str, Any] = {}
    total = sum(order.counts.values())
    for split in SPLITS:
        if not order.counts[split]:
            continue
        (folder / split).mkdir()
        viewpoints, poses = order.poses(split)
        names = [f"{split}/r_{number}" for number in range(len(poses))]
        seeds = [seed_from(scene.name, split, int(viewpoint)) for viewpoint in viewpoints]
        rendered = render_views(loaded, poses, order.spp[split], seeds, names)
        for name, viewpoint, view in zip(names, viewpoints, rendered, strict=True):
            png, exr = folder / f"{name}.png", folder / f"{name}.exr"
            write_png(png, display_from_linear(view.rgba))
            channels = {channel: view.rgba[..., i] for i, channel in enumerate("RGBA")}
            channels["Z"] = view.depth
            channels |= {f"N.{axis}": view.normal[..., i] for i, axis in enumerate("XYZ")}
            channels |= {f"V.{channel}": view.variance[..., i] for i, channel in enumerate("RGBA")}
            write_channels(exr, channels)
            files += [png, exr]
            views[name] = {"noise_mse": view.noise_mse, "viewpoint": int(viewpoint)}
            if progress:
                progress(len(views), total)
        listing = transforms_file(folder, split)
        write_transforms(listing, FOV_X_RADIANS, [f"./{name}" for name in names], poses)
        files.append(listing)
    bounds = loaded.bounds()
    described = bounds if order.similarity is None else order.similarity.inverse.points(bounds)
    found = needs(order.description, bounds, _pixel_length(order, bounds), described)
    facts = {
        "scene": scene.name,
        "title": scene.title,
        "digest": order.digest(variant.name),
        "near": scene.near,
        "far": scene.far,
        "bounds": bounds.tolist(),
        "view_from": scene.view_from,
        "resolution": order.resolution,
        "counts": order.counts,
        "empty_splits": [split for split in SPLITS if not order.counts[split]],
        "spp": {split: loaded.actual_spp(order.spp[split]) for split in SPLITS},
        "max_depth": scene.max_depth,
        "emitters_seen": scene.emitters_seen,
        "normalised": _similarity(order.similarity),
        "variant": variant.name,
        "variant_why": variant.why,
        "integrator": loaded.integrator_name,
        "versions": {**_versions(), "python": platform.python_version()},
        "seconds": time.perf_counter() - started,
        "needs": as_rows(found),
        "left_out": left_out(found),
        "views": views,
    }
    write_manifest(folder, facts, files)


def remove_stale(cache: Path) -> None:
    """Removes temporary folders that killed processes left: of this machine and dead, or two days old."""
    for partial in cache.glob(f".*{_PARTIAL}"):
        match = re.match(rf".*\.{re.escape(_host())}\.(\d+)\.[^.]*{re.escape(_PARTIAL)}$", partial.name)
        try:
            old = time.time() - partial.stat().st_mtime > STALE_SECONDS
        except OSError:
            continue
        if old or (match and not _alive(int(match.group(1)))):
            shutil.rmtree(partial, ignore_errors=True)


def _move_into_place(partial: Path, target: Path) -> None:
    """Renames; what is in the way is kept if it is whole (another process was faster) and replaced if not."""
    for _ in range(5):
        try:
            partial.rename(target)
            return
        except OSError as error:
            if error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.EACCES) or not target.exists():
                raise
        if is_complete(target):
            return
        broken = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.{_host()}.{os.getpid()}.", suffix=_PARTIAL, dir=target.parent)
        )
        try:
            target.rename(broken / "broken")
        except FileNotFoundError:
            pass  # another process moved it away first
        finally:
            shutil.rmtree(broken, ignore_errors=True)
    raise InputError(f"{target}: cannot be replaced, something keeps writing to it; remove it by hand")


@contextmanager
def _disk(cache: Path) -> Iterator[None]:
    """Turns the system's refusal to write into an `InputError` that says what to do."""
    try:
        yield
    except OSError as error:
        where = error.filename or cache
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise InputError(
                f"{where}: the disk is full; free some space or choose another --view-sets folder"
            ) from error
        if error.errno in (errno.EROFS, errno.EACCES, errno.EPERM):
            raise InputError(f"{where}: not writable; choose another --view-sets folder") from error
        if error.errno in (errno.ENOTDIR, errno.EEXIST):
            raise InputError(f"{where}: a file is in the way of a folder; choose another --view-sets folder") from error
        raise InputError(f"{where}: cannot be written ({error.strerror}); choose another --view-sets folder") from error


def _pixel_length(order: Order, bounds: np.ndarray) -> float:
    """Of a pixel in the middle of the box, scene units, from the nearest camera."""
    eyes = np.concatenate([order.poses(split)[1][:, :3, 3] for split in SPLITS])
    focal = 0.5 * order.resolution / np.tan(0.5 * FOV_X_RADIANS)
    return float(np.linalg.norm(eyes - bounds.mean(axis=0), axis=1).min() / focal)


def _folder(cache: Path, order: Order, variant: str) -> Path:
    return cache / f"{order.scene.name}-{order.resolution}px-{order.digest(variant)[:12]}"


def _similarity(change: Similarity | None) -> dict[str, Any] | None:
    """What the manifest says about it: x in the view set = scale · x in the description + shift."""
    return None if change is None else {"scale": change.scale, "shift": list(change.shift)}


def _versions() -> dict[str, str]:
    """Read from package metadata, which does not import them."""
    return {name: importlib.metadata.version(name) for name in ("mitsuba", "drjit")}


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9-]", "-", socket.gethostname())


def _alive(process: int) -> bool:
    if os.name == "nt":
        return True  # there, signal 0 would end the process
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
