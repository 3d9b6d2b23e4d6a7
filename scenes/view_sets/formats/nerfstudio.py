"""`transforms.json` of nerfstudio and instant-ngp: one file for all splits, intrinsics in pixels.

Splits follow nerfstudio's `nerfstudio_dataparser.py` (version 1.1.5, with its default options): `train_filenames`,
`val_filenames` and `test_filenames`, else evenly spread nine tenths of the views, sorted by path, for training. Poses
are used unchanged, neither rotated nor scaled; `applied_transform`, `aabb_scale`, `scale`, `offset` and depth maps have
no effect.
"""

import json
from pathlib import Path

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.formats.lens import looked_into
from scenes.view_sets.formats.transforms import Document, ViewRegion, image_file, read_listing
from scenes.view_sets.source import Region, Source, nine_to_one, region_in
from scenes.view_sets.viewpoints import SPLITS

NAME = "transforms.json"
REGION = "view_region"
"""An additional key, which other programs ignore: `bounds` (six numbers), `near`, `far`."""


def write_nerfstudio(
    file: Path, views: dict[str, tuple[list[str], np.ndarray]], size: tuple[int, int], focal: float, region: Region
) -> None:
    """Write `transforms.json`.

    `views` maps split → paths of images relative to the file's folder, with suffix, and poses [n, 4, 4]; `size` is
    width and height, `focal` in pixels. Without a `val`, the test views are listed for it: nerfstudio needs all three.
    """
    width, height = size
    listed = {split: paths for split, (paths, _) in views.items() if paths}
    farthest = max(map(abs, region.bounds)) if region.bounds else 1.0
    frames = [
        {"file_path": path, "transform_matrix": pose.tolist()}
        for paths, poses in views.values()
        for path, pose in zip(paths, poses, strict=True)
    ]
    content = {
        "camera_model": "OPENCV",
        **{"w": width, "h": height, "fl_x": focal, "fl_y": focal, "cx": width / 2, "cy": height / 2},
        **dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0),
        # the object is upright already, about the origin
        "orientation_override": "none",
        # instant-ngp maps x to 0.33 x + 0.5: the power of two whose box holds all geometry
        "aabb_scale": next((scale for scale in (1, 2, 4, 8, 16, 32, 64) if 0.33 * farthest <= scale / 2), 128),
        **{f"{split}_filenames": listed.get(split, listed.get("test", listed.get("train", []))) for split in SPLITS},
        REGION: {"bounds": region.bounds, "near": region.near, "far": region.far},
        "frames": frames,
    }
    file.write_text(json.dumps(content, indent=1, allow_nan=False), encoding="utf-8")


def read_nerfstudio(folder: Path) -> Source:
    """Read the folder's `transforms.json`. Raises `InputError`, naming file, value and remedy, for invalid data."""
    file = folder / NAME
    listing = read_listing(file)
    frames = listing.frames
    splits, notes = _splits(listing.document, file, frames.files)
    channels, of_pictures = looked_into(frames.files)
    given = listing.document.view_region or ViewRegion()
    box = None if given.bounds is None else tuple(given.bounds)
    region = region_in(f"{file}: {REGION}", box, given.near, given.far)
    if region.bounds is None:
        notes.append("Bounds, near and far are derived from the cameras; --bounds, --near and --far override them.")
    return Source(
        name=folder.resolve().name,
        frames=lambda split: frames.of(splits[split]) if splits.get(split) else None,
        pixels=lambda image, width: listing.read(image, channels, width),
        size=listing.size,
        region=region,
        notes=(*notes, *listing.notes, *of_pictures),
    )


def _splits(document: Document, file: Path, files: list[Path]) -> tuple[dict[str, list[int]], list[str]]:
    numbers = {image: number for number, image in enumerate(files)}
    named: dict[str, list[int]] = {}
    for split in SPLITS:
        key = f"{split}_filenames"
        if (paths := getattr(document, key)) is None:
            continue
        images = [image_file(file.parent, path, f"{file}: {key}") for path in paths]
        if unknown := [image for image in images if image not in numbers]:
            raise InputError(f"{file}: {key} names {unknown[0]}, which no frame has; list the frame or drop the name")
        named[split] = sorted({numbers[image] for image in images})
    if not named:
        order = sorted(range(len(files)), key=lambda number: files[number])
        train, test = nine_to_one(len(files), file, "list train_filenames and test_filenames, or give ten or more")
        note = f"{NAME} names no splits: {len(train)} of {len(files)} views, evenly spread, train, the others test"
        return {"train": [order[i] for i in train], "test": [order[i] for i in test]}, [f"{note} (nerfstudio's rule)."]
    notes = []
    if named.get("val") and named.get("val") == named.get("test"):
        del named["val"]
    if not named.get("test") and named.get("val"):
        named["test"] = named.pop("val")
        notes.append(f"{NAME} names no test views: its val views are the test views.")
    for split in ("train", "test"):
        if not named.get(split):
            raise InputError(f"{file}: {split}_filenames is missing or empty while others are given; list its views")
    return named, notes
