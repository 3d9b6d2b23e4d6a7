"""A view set and how it is read: posed images in the Blender format, ours or anyone's.

    FOLDER/transforms_{train,val,test}.json   poses (OpenGL axes), horizontal field of view
    FOLDER/train/r_0.png                      display colour, straight alpha, 8 bit
    FOLDER/train/r_0.exr                      ours: R G B A linear premultiplied, Z depth, N.{X,Y,Z} normal,
                                              V.{R,G,B,A} variance of the estimate; all float
    FOLDER/view_set.json                      ours: the manifest (`scenes.manifest`), written last

Where there is a manifest, the files must be the ones that it lists, and colour comes from the EXR files.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scenes.errors import InputError
from scenes.image_stack import ImageStack, require_room
from scenes.images import read_channels, read_image
from scenes.manifest import checked, read_manifest
from scenes.pixels import (
    area_average,
    area_average_hits,
    area_average_straight,
    display_from_linear,
)
from scenes.transforms import Frames, read_transforms, transforms_file
from scenes.viewpoints import SPLITS, evenly_spread, repeated

FOREIGN_BOUNDS = ((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5))
FOREIGN_NEAR, FOREIGN_FAR = 2.0, 6.0


@dataclass(frozen=True)
class Split:
    """The views of one split; n may be 0. Images are in a file and read one at a time or by pixels."""

    names: tuple[str, ...]
    """Path inside the folder without suffix, such as `test/r_0`."""
    camera_to_world: np.ndarray
    """float64 [n, 4, 4], OpenGL axes."""
    rgba: ImageStack
    """float32 [n, h, w, 4]: straight alpha, display colour, 0 … 1."""
    depth: ImageStack | None = None
    """float32 [n, h, w]: distance along the unit ray, mean over the pixel's hits, 0 where nothing was hit."""
    normal: ImageStack | None = None
    """float32 [n, h, w, 3]: world frame, unit, 0 where nothing was hit."""
    noise_mse: np.ndarray | None = None
    """float64 [n]: expected mean square error of the image over white that rendering noise causes, at this size."""


@dataclass(frozen=True)
class ViewSet:
    """Posed images of one scene at one size."""

    path: Path
    name: str
    title: str
    width: int
    height: int
    fov_x_radians: float
    near: float
    far: float
    bounds: np.ndarray
    """float64 [2, 3]: everything that is seen lies in this box."""
    train: Split
    val: Split
    test: Split
    rendered: dict[str, Any] = field(default_factory=dict)
    """What the manifest says about the rendering; empty for a folder that is not ours."""
    repeated_views: tuple[str, ...] = ()
    """Views whose camera another view has already, in whatever split, one line each: a reader of scores should know."""

    @property
    def focal(self) -> float:
        """Focal length in pixels."""
        return 0.5 * self.width / math.tan(0.5 * self.fov_x_radians)


def read_view_set(
    folder: Path | str,
    resolution: int | None = None,
    splits: Sequence[str] = SPLITS,
    train_count: int | None = None,
    val_count: int | None = None,
    test_count: int | None = None,
    bounds: np.ndarray | None = None,
    geometry: Sequence[str] = ("test",),
    scratch: Path | None = None,
) -> ViewSet:
    """Reads a folder at `resolution` pixels of width (default: as stored), averaging areas.

    `splits` that are not named are left empty, and so is a `val` that does not exist; counts take evenly spread
    subsets and never exceed what there is. Depth and normals are read for the splits in `geometry`. `bounds`
    [2, 3] overrules the manifest, or ±1.5 where there is none. The decoded images, 16 bytes a pixel and as much again
    for its geometry, go to files without a name in `scratch`, which should be on a disk (`scenes.image_stack`).
    Raises `InputError`, which says what to do, for anything missing, malformed, damaged or not supported, and where
    `scratch` has no room.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; a view set is a folder with transforms_train.json")
    manifest = read_manifest(folder)
    counts = {"train": train_count, "val": val_count, "test": test_count}
    found: dict[str, Frames] = {}
    for split in SPLITS:
        frames = _frames(folder, split, counts[split], manifest) if split in splits else None
        if frames is not None:
            found[split] = frames
    if not found:
        raise InputError(f"{folder}: none of the splits {' '.join(splits)} is there")
    _check_apart(found, folder)
    angles = {split: entry.fov_x_radians for split, entry in found.items()}
    fov = next(iter(angles.values()))
    if any(abs(angle - fov) > 1e-6 for angle in angles.values()):
        raise InputError(f"{folder}: camera_angle_x differs between the splits ({angles}); one camera is supported")
    reader = _Reader(folder, resolution, manifest, scratch)
    read = {split: reader.split(found[split], split in geometry) if split in found else None for split in SPLITS}
    low, high = np.array(manifest["bounds"] if manifest else FOREIGN_BOUNDS, dtype=np.float64)
    box = np.array([low, high]) if bounds is None else _checked_bounds(bounds)
    near, far = (float(manifest["near"]), float(manifest["far"])) if manifest else (FOREIGN_NEAR, FOREIGN_FAR)
    if not 0 < near < far < math.inf:
        raise InputError(f"{folder}: near {near} and far {far}; distances must be positive, near the smaller one")
    if reader.size is None:
        raise InputError(f"{folder}: no view is left to read; ask for at least one")
    return ViewSet(
        path=folder,
        name=manifest["scene"] if manifest else folder.resolve().name,
        title=manifest["title"] if manifest else "",
        width=reader.size[1],
        height=reader.size[0],
        fov_x_radians=fov,
        near=near,
        far=far,
        bounds=box,
        train=read["train"] or _empty(reader.size),
        val=read["val"] or _empty(reader.size),
        test=read["test"] or _empty(reader.size),
        rendered=manifest,
        repeated_views=_repeated(found),
    )


def _frames(folder: Path, split: str, count: int | None, manifest: dict[str, Any]) -> Frames | None:
    file = transforms_file(folder, split)
    if not file.exists() and (split == "val" or f"{split}" in manifest.get("empty_splits", [])):
        return None
    if manifest:
        checked(folder, file, manifest)
    frames = read_transforms(folder, split)
    if count is None or count >= len(frames.files):
        return frames
    if count < 0:
        raise InputError(f"{count} views of {split}: choose 0 or more")
    chosen = evenly_spread(count, frames.camera_to_world)
    return Frames(frames.fov_x_radians, [frames.files[i] for i in chosen], frames.camera_to_world[chosen])


def _check_apart(frames: dict[str, Frames], folder: Path) -> None:
    """Raises `InputError` where an image is both trained on and tested on."""
    if "train" in frames and "test" in frames:
        both = sorted(set(frames["train"].files) & set(frames["test"].files))
        if both:
            raise InputError(f"{folder}: {both[0]} is a training and a test view; a score on it would mean nothing")


def _repeated(frames: dict[str, Frames]) -> tuple[str, ...]:
    """One line for each view that has the camera of an earlier one, of its split or of the splits before it."""
    if not frames:
        return ()
    names = [f"{split}: {file.name}" for split, entry in frames.items() for file in entry.files]
    pairs = repeated(np.concatenate([entry.camera_to_world for entry in frames.values()]))
    return tuple(f"{names[later]} has the camera of {names[first]}" for first, later in pairs)


def _checked_bounds(bounds: np.ndarray) -> np.ndarray:
    box = np.asarray(bounds, dtype=np.float64)
    if box.shape != (2, 3) or not np.isfinite(box).all() or (box[0] >= box[1]).any():
        raise InputError(f"bounds {box.tolist()}: give two finite corners, the lower one first")
    return box


def _empty(size: tuple[int, int]) -> Split:
    return Split((), np.zeros((0, 4, 4)), ImageStack((*size, 4)))


class _Reader:
    """Reads views of one folder one after another and holds them to one size."""

    def __init__(self, folder: Path, resolution: int | None, manifest: dict[str, Any], scratch: Path | None) -> None:
        if resolution is not None and resolution < 1:
            raise InputError(f"resolution {resolution}: choose 1 pixel or more")
        self.folder, self.resolution, self.manifest, self.scratch = folder, resolution, manifest, scratch
        self.stored: tuple[int, int] | None = None
        self.size: tuple[int, int] | None = None
        """Height and width after resizing."""

    def split(self, frames: Frames, geometry: bool) -> Split:
        names: list[str] = []
        stacks: list[ImageStack] = []
        noise: list[float] = []
        for file in frames.files:
            name = file.relative_to(self.folder.resolve()).with_suffix("").as_posix()
            names.append(name)
            images = self._own(file, geometry) if self.manifest else [self._foreign(file)]
            if not stacks:
                require_room([image.shape for image in images], len(frames.files), self.scratch)
                stacks = [ImageStack(image.shape, self.scratch) for image in images]
            for stack, image in zip(stacks, images, strict=True):
                stack.append(image)
            if self.manifest:
                shrink = (self.size[1] / self.stored[1]) ** 2 if self.size and self.stored else 1.0
                noise.append(self.manifest["views"][name]["noise_mse"] * shrink)
        if not stacks:
            stacks = [ImageStack((*(self.size or (1, 1)), 4))]
        depth, normal = stacks[1:] or (None, None)
        return Split(tuple(names), frames.camera_to_world, stacks[0], depth, normal, np.array(noise) if noise else None)

    def _foreign(self, file: Path) -> np.ndarray:
        pixels = read_image(file)
        if pixels.shape[2] == 2:
            pixels = pixels[..., [0, 0, 0, 1]]
        if pixels.shape[2] != 4:
            raise InputError(
                f"{file}: {pixels.shape[2]} channels, no alpha; views must be RGBA, "
                "because what is not covered is not to be learnt: save them as PNG with an alpha channel"
            )
        self._fits(file, pixels.shape[:2])
        width = self._width()
        return pixels if width == pixels.shape[1] else area_average_straight(pixels, width)

    def _own(self, file: Path, geometry: bool) -> list[np.ndarray]:
        """Colour, then depth and normals where `geometry` is wanted."""
        exr = file.with_suffix(".exr")
        channels = read_channels(checked(self.folder, exr, self.manifest))
        linear = np.stack([channels[name] for name in "RGBA"], axis=-1)
        self._fits(exr, linear.shape[:2])
        resized = self._width() != linear.shape[1]
        rgba = display_from_linear(area_average(linear, self._width()) if resized else linear)
        if not geometry:
            return [rgba]
        depth = channels["Z"]
        normal = np.stack([channels[name] for name in ("N.X", "N.Y", "N.Z")], axis=-1)
        if resized:
            hits = np.where(depth > 0, np.maximum(linear[..., 3], 1e-3), 0.0)
            depth = area_average_hits(depth[..., None], hits, self._width())[..., 0]
            normal = area_average_hits(normal, hits, self._width())
            length = np.linalg.norm(normal, axis=-1, keepdims=True)
            normal = normal / np.where(length > 1e-6, length, 1.0)
        return [rgba, depth, normal]

    def _width(self) -> int:
        assert self.stored is not None
        return self.resolution or self.stored[1]

    def _fits(self, file: Path, size: tuple[int, ...]) -> None:
        height, width = size
        if self.stored is None:
            if self.resolution is not None and self.resolution > width:
                raise InputError(
                    f"{file}: {width} pixels wide, {self.resolution} were asked for; "
                    f"enlarging adds nothing: choose --resolution {width} or less"
                )
            self.stored = (height, width)
            scale = width / self._width()
            self.size = (max(1, int(height / scale + 1e-9)), self._width())
        if self.stored != (height, width):
            raise InputError(
                f"{file}: {width} × {height} pixels, but views before it have {self.stored[1]} × {self.stored[0]}; "
                "all images of a view set must have one size"
            )
