"""Renders a view set into an empty folder: images, poses, and the manifest last."""

import platform
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenes.catalog.mitsuba_xml import cautious
from scenes.files.errors import InputError
from scenes.modelling.needs import Needs, as_rows, left_out, needs
from scenes.modelling.scene import Scene
from scenes.rendering.order import Order, similarity_facts, versions
from scenes.rendering.render import LoadedScene, RenderedView, render_views, seed_from
from scenes.rendering.samples import chosen_samples
from scenes.rendering.variant import Variant
from scenes.view_sets.formats.nerfstudio import NAME as NERFSTUDIO
from scenes.view_sets.formats.nerfstudio import write_nerfstudio
from scenes.view_sets.formats.transforms import transforms_file, write_transforms
from scenes.view_sets.images import write_channels, write_png
from scenes.view_sets.manifest import note, salvaged, write_manifest
from scenes.view_sets.pixels import display_from_linear
from scenes.view_sets.source import Region
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS, SPLITS

Facts = dict[str, object]
"""Values for the manifest; those of a view are `noise_mse`, and whether anything is `seen` and `lit` in it."""


@dataclass(frozen=True)
class Standing:
    done: int
    """The number of finished views, including those from the cache."""
    total: int
    kept: int
    """The number of views from the cache: they take no time."""
    share: float
    """The share of all samples that is done: a test view has several times those of a training view."""
    view: str
    """The view that is rendered next, `<split>/r_<number>`; empty once all are done."""


Progress = Callable[[Standing], None]
"""A callback after loading and after each rendered view."""


def standings(names_of: dict[str, list[str]], spp: dict[str, int], kept: Collection[str]) -> Iterator[Standing]:
    """Yield the state before anything is rendered, and after each rendered view; those in `kept` are not rendered."""
    total = sum(map(len, names_of.values()))
    missing = [(name, spp[split]) for split, names in names_of.items() for name in names if name not in kept]
    taken, all_samples = 0, sum(samples for _, samples in missing)
    for place, (name, samples) in enumerate([*missing, ("", 0)]):
        yield Standing(len(kept) + place, total, len(kept), taken / all_samples if all_samples else 1.0, name)
        taken += samples


def write_view_set(
    folder: Path, order: Order, variant: Variant, progress: Progress | None = None, donors: Sequence[Path] = ()
) -> None:
    """Render into an empty folder, or copy views that are intact in one of `donors`; the manifest comes last. Raises
    `InputError` for a user's scene that is too near to the cameras, or of which nothing is seen or lit.
    """
    scene, started = order.scene, time.perf_counter()
    loaded = _loaded(order, variant)
    placed = {split: order.poses(split) for split in SPLITS}
    poses_of: dict[str, np.ndarray] = {split: poses for split, (_, poses) in placed.items()}
    spp, chosen = chosen_samples(loaded, order.spp, poses_of)
    # of the chosen numbers of samples: with other numbers the images are others
    digest = replace(order, spp=spp).digest(variant.name)
    names_of: dict[str, list[str]] = {
        split: [f"{split}/r_{number}" for number in range(order.counts[split])] for split in SPLITS
    }
    kept = salvaged(folder, list(donors), digest, [name for names in names_of.values() for name in names])
    standing, report = standings(names_of, spp, kept), progress or (lambda standing: None)
    report(next(standing))
    facts_of = dict(kept)
    for split in SPLITS:
        names, began = names_of[split], time.perf_counter()
        for name, view in _missing(loaded, scene, split, names, placed[split], spp[split], kept):
            _write_view(folder / name, view)
            seen, lit = bool(view.rgba[..., 3].any()), bool(view.rgba[..., :3].any())
            facts_of[name] = {"noise_mse": view.noise_mse, "seen": seen, "lit": lit}
            note(folder, digest, name, {**facts_of[name], "seconds": time.perf_counter() - began})
            report(next(standing))
            began = time.perf_counter()
    viewpoints = [view for split in SPLITS for view in zip(names_of[split], placed[split][0].tolist(), strict=True)]
    _require_visible(scene, list(facts_of.values()))
    bounds = loaded.bounds()
    needed = _needs_of(loaded, order, bounds, np.concatenate(list(poses_of.values())))
    files = _write_poses(folder, order, names_of, poses_of, bounds)
    manifest: Facts = {
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
        "views": {name: {"noise_mse": facts_of[name]["noise_mse"], "viewpoint": place} for name, place in viewpoints},
    }
    write_manifest(folder, manifest, files)


def _loaded(order: Order, variant: Variant) -> LoadedScene:
    """Load the scene. Raises `InputError` for a user's scene that reaches nearer to the cameras than `near`."""
    scene, size = order.scene, order.resolution
    loaded = LoadedScene(scene, order.description, variant, size, size, order.integrator)
    if scene.file is not None and np.linalg.norm(np.abs(loaded.box()).max(axis=0)) > RADIUS - scene.near:
        low, high = loaded.box().tolist()
        raise InputError(
            f"{scene.file}: reaches from {low} to {high}, nearer to the cameras, {RADIUS:.4g} from the origin, "
            f"than near, {scene.near:g}; scale it to fit"
        )
    return loaded


def _missing(
    loaded: LoadedScene, scene: Scene, split: str, names: list[str], placed: tuple[np.ndarray, np.ndarray], spp: int,
    kept: Collection[str],
) -> Iterator[tuple[str, RenderedView]]:  # fmt: skip
    viewpoints, poses = placed
    places = [place for place, name in enumerate(names) if name not in kept]
    missing = [names[place] for place in places]
    seeds = [seed_from(scene.name, split, int(viewpoints[place])) for place in places]
    yield from zip(missing, render_views(loaded, poses[places], spp, seeds, missing), strict=True)


def _write_view(path: Path, view: RenderedView) -> None:
    """Write a view as `path`.png, display colour, and `path`.exr, all channels in linear light."""
    path.parent.mkdir(exist_ok=True)
    write_png(path.with_suffix(".png"), display_from_linear(view.rgba))
    channels = {channel: view.rgba[..., i] for i, channel in enumerate("RGBA")}
    channels["Z"] = view.depth
    channels |= {f"N.{axis}": view.normal[..., i] for i, axis in enumerate("XYZ")}
    channels |= {f"V.{channel}": view.variance[..., i] for i, channel in enumerate("RGBA")}
    write_channels(path.with_suffix(".exr"), channels)


def _require_visible(scene: Scene, facts: list[Facts]) -> None:
    """Raise `InputError` for a user's scene that no view shows; views of older versions count as showing it."""
    seen, lit = (any(of_view.get(key, True) for of_view in facts) for key in ("seen", "lit"))
    if scene.file is not None and not (seen and lit):
        what = (
            "no light reaches what is seen, every view is black (a room is, from most sides: render more)"
            if seen
            else "nothing is seen in any view"
        )
        raise InputError(f"{scene.file}: {what}; fix the scene")


def _write_poses(
    folder: Path, order: Order, names_of: dict[str, list[str]], poses_of: dict[str, np.ndarray], bounds: np.ndarray
) -> list[Path]:
    """Write `transforms_<split>.json` and nerfstudio's `transforms.json`; return all files in the manifest's order."""
    scene, size = order.scene, order.resolution
    files: list[Path] = []
    listed: dict[str, tuple[list[str], np.ndarray]] = {}
    for split, names in names_of.items():
        if names:
            listing = transforms_file(folder, split)
            write_transforms(listing, FOV_X_RADIANS, [f"./{name}" for name in names], poses_of[split])
            files += [folder / f"{name}{suffix}" for name in names for suffix in (".png", ".exr")]
            files.append(listing)
            listed[split] = [f"{name}.png" for name in names], poses_of[split]
    region = Region(tuple(bounds.ravel().tolist()), scene.near, scene.far)
    write_nerfstudio(folder / NERFSTUDIO, listed, (size, size), order.focal, region)
    return [*files, folder / NERFSTUDIO]


def _needs_of(loaded: LoadedScene, order: Order, bounds: np.ndarray, poses: np.ndarray) -> Needs:
    described = bounds if order.similarity is None else order.similarity.inverse.points(bounds)
    if loaded.placement is not None:
        described = loaded.box_in_file
    # the length of a pixel in the middle of the box, from the nearest camera
    pixel = float(np.linalg.norm(poses[:, :3, 3] - bounds.mean(axis=0), axis=1).min() / order.focal)
    needed = needs(order.description, bounds, pixel, described)
    return needed if order.scene.load is None else cautious(needed)
