"""The cache of rendered view sets: each is named by a hash of everything that it depends on.

A view set is rendered into a temporary sibling and renamed into place, so that a folder of its name is complete.
"""

import errno
import platform
import shutil
import tempfile
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scenes.catalog.entries import scene_named
from scenes.catalog.mitsuba_xml import cautious
from scenes.catalog.scene_file import mistakes_in
from scenes.files.errors import InputError
from scenes.files.partial_folders import PARTIAL, abandoned, remove, remove_stale, working_folder
from scenes.modelling.needs import as_rows, left_out, needs
from scenes.modelling.normalise import fitted, normalised
from scenes.modelling.scene import Scene
from scenes.rendering.occupancy import with_occupancy
from scenes.rendering.order import NoiseTarget, Order, similarity_facts, versions
from scenes.rendering.variant import VARIANTS, Variant, choose_variant, known_variant
from scenes.view_sets.formats.nerfstudio import NAME as NERFSTUDIO
from scenes.view_sets.formats.nerfstudio import write_nerfstudio
from scenes.view_sets.formats.transforms import transforms_file, write_transforms
from scenes.view_sets.images import write_channels, write_png
from scenes.view_sets.manifest import check_all, note, salvaged, write_manifest
from scenes.view_sets.pixels import display_from_linear
from scenes.view_sets.source import Region
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS, SPLITS


@dataclass(frozen=True)
class Standing:
    """The progress of a view set: the finished views and what is left."""

    done: int
    """The number of finished views, including those found in the cache."""
    total: int
    kept: int
    """The number of views found in the cache: they take no time."""
    share: float
    """The share of the samples to take that is done: a test view has several times those of a training view."""
    view: str
    """The view that is rendered next, `<split>/r_<number>`; empty once all are done."""


def standings(counts: dict[str, int], spp: dict[str, int], kept: Collection[str]) -> Iterator[Standing]:
    """Yield the state before anything is rendered, and after each rendered view; those that `kept` names are not."""
    total = sum(counts.values())
    views = [(f"{split}/r_{number}", spp[split]) for split in counts for number in range(counts[split])]
    missing = [(name, samples) for name, samples in views if name not in kept]
    taken, all_samples = 0, sum(samples for _, samples in missing)
    for place, (name, samples) in enumerate([*missing, ("", 0)]):
        yield Standing(len(kept) + place, total, len(kept), taken / all_samples if all_samples else 1.0, name)
        taken += samples


LARGEST_RESOLUTION = 4096
LARGEST_SPP = 1 << 16
CEILINGS = (10.0, 100.0)
"""The PSNR in dB that the noise of a view may be asked to allow."""

Progress = Callable[[Standing], None]
"""A callback, called once all is loaded, and after each rendered view."""


def ensure_view_set(
    scene_name: str | Scene,
    *,
    resolution: int,
    counts: dict[str, int],
    spp: Mapping[str, int | NoiseTarget],
    cache_folder: Path | str,
    variant: str | None = None,
    progress: Progress | None = None,
    integrator: str | None = None,
    say: Callable[[str], None] | None = None,
) -> Path:
    """Return the folder of the rendered view set, from the cache if it is there and complete, else rendered now.

    A scene of the catalogue goes by its name, a user's own (`scenes.catalog.scene_file`) is passed itself.
    `counts` and `spp` (samples per pixel, 2 or more, or the noise that they may leave) are given for train, val and
    test. With `variant` None a set that
    any variant rendered will do; if none is there, the fastest that works renders it. Several processes may ask for
    the same set at once. `say` receives what is wrong with a cached one. Raises `InputError` for a bad request or
    a folder that cannot be written.
    """
    own = None if isinstance(scene_name, str) else scene_name.file
    with mistakes_in(own):
        order = replace(checked_order(scene_name, resolution, counts, spp), integrator=integrator)
    wanted = known_variant(variant)
    cache = Path(cache_folder)
    for name in VARIANTS if wanted is None else (wanted,):
        with mistakes_in(own):  # a description that is no plain data has no digest
            stored = _folder(cache, order, name)
        if is_complete(stored):
            return with_occupancy(stored, order)
    chosen = choose_variant(variant)
    target = _folder(cache, order, chosen.name)
    if say and target.exists():
        say(f"{first_fault(target)}: rendered again, but for the views that are as they were written")
    with _disk(cache):
        cache.mkdir(parents=True, exist_ok=True)
        remove_stale(cache, but=target.name)
        with working_folder(cache, target.name) as partial:
            try:
                donors = [folder for folder in (target, *abandoned(cache, target.name)) if folder.is_dir()]
                with mistakes_in(own, but=OSError):  # which is the cache's
                    write_view_set(partial, order, chosen, progress, donors)
                # before it is in place: who is killed while writing leaves nothing in a complete set
                with_occupancy(partial, order)
                _move_into_place(partial, target)
            except (BrokenPipeError, KeyboardInterrupt):
                raise  # the caller is gone: the rendered views are kept for the next one
            except BaseException:
                remove(partial)
                raise
        for folder in (partial, *abandoned(cache, target.name)):
            remove(folder)
    return target


def check_resolution(resolution: int) -> None:
    """Raise `InputError` for an impossible width in pixels."""
    if not 1 <= resolution <= LARGEST_RESOLUTION:
        raise InputError(f"--resolution {resolution}: choose 1 to {LARGEST_RESOLUTION} pixels")


def is_stored(
    scene_name: str, resolution: int, counts: dict[str, int], spp: Mapping[str, int | NoiseTarget], cache_folder: Path,
    integrator: str | None = None,
) -> bool:  # fmt: skip
    """Return whether a folder of the view set's name exists; arguments and errors are those of `ensure_view_set`, which
    checks that it is complete.
    """
    order = replace(checked_order(scene_name, resolution, counts, spp), integrator=integrator)
    return any(_folder(cache_folder, order, name).is_dir() for name in VARIANTS)


def checked_order(
    scene_name: str | Scene, resolution: int, counts: dict[str, int], spp: Mapping[str, int | NoiseTarget]
) -> Order:
    """Return the order; raises `InputError` that names the value and the remedy."""
    scene = scene_named(scene_name) if isinstance(scene_name, str) else scene_name
    check_resolution(resolution)
    most = {split: asked.most if isinstance(asked, NoiseTarget) else asked for split, asked in spp.items()}
    for option, given, smallest, largest in (("--", counts, 0, None), ("--spp-", most, 2, LARGEST_SPP)):
        if set(given) != set(SPLITS):
            raise InputError(f"{option}train {option}val {option}test: {given}: give one number each")
        for split, value in given.items():
            if value < smallest or (largest is not None and value > largest):
                raise InputError(f"{option}{split} {value}: choose {smallest} to {largest or 'what there is'}")
    for split, asked in spp.items():
        if isinstance(asked, NoiseTarget) and not CEILINGS[0] <= asked.ceiling_db <= CEILINGS[1]:
            raise InputError(f"--ceiling-{split} {asked.ceiling_db:g}: choose {CEILINGS[0]:g} to {CEILINGS[1]:g} dB")
    order = Order(
        scene,
        *(fitted(scene) if scene.file is not None and scene.load is None else normalised(scene)),
        resolution,
        {split: counts[split] for split in SPLITS},
        {split: spp[split] for split in SPLITS},
    )
    if not sum(counts.values()):
        raise InputError(f"no view of {scene.name} was asked for; choose at least one")
    for split in SPLITS:
        order.poses(split)
    return order


def is_complete(folder: Path) -> bool:
    """Return whether every file of the view set is there and intact; False whatever else is wrong with it."""
    return folder.is_dir() and first_fault(folder) is None


def first_fault(folder: Path) -> str | None:
    """Return what is wrong with a stored view set, for a message."""
    try:
        check_all(folder)
    except InputError as error:
        return str(error).split("; ")[0]
    except (OSError, KeyError, TypeError) as error:
        return f"{folder}: {type(error).__name__}: {error}"
    return None


def write_view_set(
    folder: Path, order: Order, variant: Variant, progress: Progress | None = None, donors: Sequence[Path] = ()
) -> None:
    """Render into an empty folder, but for views that are valid in one of `donors`; the manifest is written last."""
    from scenes.rendering.render import LoadedScene, render_views, seed_from
    from scenes.rendering.samples import chosen_samples

    scene, size, started = order.scene, order.resolution, time.perf_counter()
    loaded = LoadedScene(
        order.description, variant, scene.max_depth, size, size, integrator=order.integrator,
        emitters_seen=scene.emitters_seen, box=scene.box, load=scene.load,
    )  # fmt: skip
    if scene.file is not None and np.linalg.norm(np.abs(loaded.box()).max(axis=0)) > RADIUS - scene.near:
        low, high = loaded.box().tolist()
        raise InputError(
            f"{scene.file}: reaches from {low} to {high}, nearer to the cameras, {RADIUS:.4g} from the origin, "
            f"than near, {scene.near:g}; scale it to fit"
        )
    placed = {split: order.poses(split) for split in SPLITS}
    spp, chosen = chosen_samples(loaded, order.spp, {split: poses for split, (_, poses) in placed.items()})
    # of the numbers that were chosen: where another machine chooses others, its images are others
    digest = replace(order, spp=spp).digest(variant.name)
    names_of = {split: [f"{split}/r_{number}" for number in range(order.counts[split])] for split in SPLITS}
    kept = salvaged(folder, list(donors), digest, [name for names in names_of.values() for name in names])
    standing = standings(order.counts, spp, kept)
    if progress:
        progress(next(standing))
    facts_of = dict(kept)
    files: list[Path] = []
    views: dict[str, Any] = {}
    listed: dict[str, tuple[list[str], np.ndarray]] = {}
    for split, names in names_of.items():
        if not names:
            continue
        (folder / split).mkdir(exist_ok=True)
        viewpoints, poses = placed[split]
        places = [place for place, name in enumerate(names) if name not in kept]
        missing = [names[place] for place in places]
        seeds = [seed_from(scene.name, split, int(viewpoints[place])) for place in places]
        began = time.perf_counter()
        rendered = render_views(loaded, poses[places], spp[split], seeds, missing)
        for name, view in zip(missing, rendered, strict=True):
            write_png(folder / f"{name}.png", display_from_linear(view.rgba))
            channels = {channel: view.rgba[..., i] for i, channel in enumerate("RGBA")}
            channels["Z"] = view.depth
            channels |= {f"N.{axis}": view.normal[..., i] for i, axis in enumerate("XYZ")}
            channels |= {f"V.{channel}": view.variance[..., i] for i, channel in enumerate("RGBA")}
            write_channels(folder / f"{name}.exr", channels)
            met, shining = bool(view.rgba[..., 3].any()), bool(view.rgba[..., :3].any())
            facts_of[name] = {"noise_mse": view.noise_mse, "seen": met, "lit": shining}
            note(folder, digest, name, {**facts_of[name], "seconds": time.perf_counter() - began})
            if progress:
                progress(next(standing))
            began = time.perf_counter()
        for name, viewpoint in zip(names, viewpoints, strict=True):
            files += [folder / f"{name}.png", folder / f"{name}.exr"]
            views[name] = {"noise_mse": facts_of[name]["noise_mse"], "viewpoint": int(viewpoint)}
        listing = transforms_file(folder, split)
        write_transforms(listing, FOV_X_RADIANS, [f"./{name}" for name in names], poses)
        files.append(listing)
        listed[split] = [f"{name}.png" for name in names], poses
    seen, lit = (any(facts.get(key, True) for facts in facts_of.values()) for key in ("seen", "lit"))
    if scene.file is not None and not (seen and lit):
        what = "no light reaches what is seen, every view is black" if seen else "nothing is seen in any view"
        raise InputError(f"{scene.file}: {what}; mend the scene")
    bounds = loaded.bounds()
    region = Region(tuple(bounds.ravel().tolist()), scene.near, scene.far)
    focal = 0.5 * size / np.tan(0.5 * FOV_X_RADIANS)
    write_nerfstudio(folder / NERFSTUDIO, listed, (size, size), focal, region)
    files.append(folder / NERFSTUDIO)
    described = bounds if order.similarity is None else order.similarity.inverse.points(bounds)
    if loaded.placement is not None:
        described = loaded.box_in_file
    # the length of a pixel in the middle of the box, from the nearest camera
    eyes = np.concatenate([poses[:, :3, 3] for _, poses in placed.values()])
    pixel = float(np.linalg.norm(eyes - bounds.mean(axis=0), axis=1).min() / focal)
    needed = needs(order.description, bounds, pixel, described)
    if scene.load is not None:
        needed = cautious(needed)
    manifest = {
        "scene": scene.name,
        "title": scene.title,
        "digest": digest,
        "near": scene.near,
        "far": scene.far,
        "bounds": bounds.tolist(),
        "view_from": scene.view_from,
        "resolution": order.resolution,
        "counts": order.counts,
        "empty_splits": [split for split in SPLITS if not order.counts[split]],
        "spp": {split: loaded.actual_spp(spp[split]) for split in SPLITS},
        "noise_target": chosen,
        "max_depth": scene.max_depth,
        "emitters_seen": scene.emitters_seen,
        "normalised": similarity_facts(loaded.placement or order.similarity),
        "variant": variant.name,
        "variant_why": variant.why,
        "integrator": loaded.integrator_name,
        "versions": {**versions(), "python": platform.python_version()},
        "seconds": time.perf_counter() - started + sum(facts.get("seconds", 0.0) for facts in kept.values()),
        "needs": as_rows(needed),
        "left_out": left_out(needed),
        "views": views,
    }
    write_manifest(folder, manifest, files)


def _move_into_place(partial: Path, target: Path) -> None:
    """Rename into place; an existing folder is kept if it is complete (another process was faster), else replaced."""
    for _ in range(5):
        try:
            partial.rename(target)
            return
        except OSError as error:
            if error.errno not in (errno.EEXIST, errno.ENOTEMPTY, errno.EACCES) or not target.exists():
                raise
        if is_complete(target):
            return
        broken = Path(tempfile.mkdtemp(prefix=f".{target.name}.", suffix=PARTIAL, dir=target.parent))
        try:
            target.rename(broken / "broken")
        except FileNotFoundError:
            pass  # another process moved it away first
        finally:
            shutil.rmtree(broken, ignore_errors=True)
    raise InputError(f"{target}: cannot be replaced, something keeps writing to it; remove it by hand")


REFUSALS = {
    errno.ENOSPC: "the disk is full", errno.EDQUOT: "the disk is full", errno.EFBIG: "the disk is full",
    errno.EROFS: "not writable", errno.EACCES: "not writable", errno.EPERM: "not writable",
    errno.ENOTDIR: "a file is in the way of a folder", errno.EEXIST: "a file is in the way of a folder",
}  # fmt: skip


@contextmanager
def _disk(cache: Path) -> Iterator[None]:
    """Turn the system's refusal to write into an `InputError` that names the remedy."""
    try:
        yield
    except OSError as error:
        reason = REFUSALS.get(error.errno or 0, f"cannot be written ({error.strerror})")
        raise InputError(f"{error.filename or cache}: {reason}; choose another --view-sets folder") from error


def _folder(cache: Path, order: Order, variant: str) -> Path:
    return cache / f"{order.scene.name}-{order.resolution}px-{order.digest(variant)[:12]}"
