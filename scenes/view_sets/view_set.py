"""A view set and how it is read: posed images, rendered here or by other programs.

    FOLDER/transforms_{train,val,test}.json   poses (OpenGL axes), horizontal field of view
    FOLDER/train/r_0.png                      display colour, straight alpha, 8 bit
    FOLDER/train/r_0.exr                      rendered here: R G B A linear premultiplied, Z depth, N.{X,Y,Z} normal,
                                              V.{R,G,B,A} variance of the estimate; all float
    FOLDER/view_set.json                      rendered here: the manifest (`scenes.view_sets.manifest`), written last

With a manifest, the files must be those that it lists, and colour comes from the EXR files. Other formats have other
readers (`scenes.view_sets.formats.foreign`).
"""

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from scenes.files.atomic import replacing
from scenes.files.digest import json_digest
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.formats.transforms import Frames, transforms_file
from scenes.view_sets.image_stack import ImageStack, require_room
from scenes.view_sets.images import read_channels
from scenes.view_sets.manifest import NAME, DamagedViewSet, checked, read_manifest
from scenes.view_sets.pixels import area_average, area_average_hits, decode_srgb, display_from_linear, over_white
from scenes.view_sets.source import CELLS, Region, Source, carved, completed, hull, region_in
from scenes.view_sets.viewpoints import SPLITS, evenly_spread, repeated

CHANNELS = (*"RGBA", "Z", "N.X", "N.Y", "N.Z")
"""The channels that are read from EXR files rendered here."""
SAME_LENS = 1e-4
"""The relative difference of the focal lengths of two splits below which they are one."""


@dataclass(frozen=True)
class Split:
    """The views of one split; n may be 0. Images are read from a file, one at a time or by pixels."""

    names: tuple[str, ...]
    """The paths inside the folder without suffix, such as `test/r_0`."""
    camera_to_world: np.ndarray
    """The poses, float64 [n, 4, 4], OpenGL axes."""
    rgba: ImageStack
    """The images, float32 [n, h, w, 4]: straight alpha, display colour, 0 … 1."""
    depth: ImageStack | None = None
    """The distance along the unit ray, float32 [n, h, w], the mean over the pixel's hits, 0 without a hit."""
    normal: ImageStack | None = None
    """The unit normal in the world frame, float32 [n, h, w, 3]; 0 without a hit."""
    noise_mse: np.ndarray | None = None
    """The expected mean square error of the image over white from rendering noise at this size, float64 [n]."""
    light: Callable[[str], np.ndarray | None] | None = None
    """Map name of a view → its linear light over white, not clipped, if the scene exceeds display colour."""


@dataclass(frozen=True)
class ViewSet:
    path: Path
    name: str
    title: str
    width: int
    height: int
    fov_x_radians: float
    near: float
    far: float
    bounds: np.ndarray
    """The box in which everything visible lies, float64 [2, 3]."""
    train: Split
    val: Split
    test: Split
    rendered: JsonObject = field(default_factory=dict)
    """The manifest; empty for a view set of another program."""
    repeated_views: tuple[str, ...] = ()
    """The views with the camera of an earlier view of any split, one line each."""
    notes: tuple[str, ...] = ()
    """The assumptions made about images of other programs, one sentence each."""
    content: str | None = None
    """The digest of the cameras and of the pixels at this width; None with a manifest."""

    @property
    def focal(self) -> float:
        return 0.5 * self.width / math.tan(0.5 * self.fov_x_radians)

    @cached_property
    def hull(self) -> np.ndarray:
        """The cells of `bounds` that may be occupied, bool [96, 96, 96] (`scenes.view_sets.source`)."""
        alphas = (image[..., 3] for image in self.train.rgba)
        return hull(self.bounds, alphas, self.train.camera_to_world, self.focal)

    @property
    def packed_hull(self) -> bytes:
        """Return `hull` in bits."""
        return np.packbits(self.hull).tobytes()

    def adopt_hull(self, packed: bytes) -> None:
        """Set `hull` to that of the same views in another process, which takes seconds to compute."""
        bits = np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=CELLS**3)
        self.__dict__["hull"] = bits.astype(bool).reshape(CELLS, CELLS, CELLS)


def read_view_set(
    folder: Path | str,
    resolution: int | None = None,
    splits: Sequence[str] = SPLITS,
    counts: Mapping[str, int | None] | None = None,
    geometry: Sequence[str] = ("test",),
    scratch: Path | None = None,
    region: Region | None = None,
    decoded: Path | None = None,
) -> ViewSet:
    """Read a folder, or a file, at `resolution` pixels of width (default: as stored), averaging areas.

    Splits that are not in `splits` are left empty, and so is a missing `val`; `counts` maps a split to the number of
    its views to take, evenly spread. Depth and normals are read for the splits in `geometry`. `region` overrides the
    manifest or the format. Bounds that no file states, a convention of the format or derived from the cameras, are
    reduced to the `hull` of the training views. The decoded images, 16 bytes per pixel and as much again for geometry,
    go to nameless files in `scratch`, which should be on a disk (`scenes.view_sets.image_stack`). Images of other
    programs are kept in the folder `decoded` at this width, if it exists, and read from there until their file changes.
    Raises `InputError`, which names the remedy, for anything missing, malformed, damaged or unsupported, and if
    `scratch` has no room.
    """
    folder = Path(folder)
    manifest = read_manifest(folder) if folder.is_dir() else {}
    source = source_of(folder)
    most = counts or {}
    found = {name: _frames(folder, name, source, manifest, most.get(name)) for name in SPLITS if name in splits}
    chosen: dict[str, Frames] = {split: frames for split, frames in found.items() if frames}
    if not chosen:
        raise InputError(f"{folder}: none of the splits {' '.join(splits)} is there")
    _require_consistent(folder, chosen)
    if resolution is not None and resolution < 1:
        raise InputError(f"resolution {resolution}: choose 1 pixel or more")
    reader = _Reader(folder, resolution, manifest, source, scratch, decoded)
    read = {split: reader.split(frames, split in geometry) for split, frames in chosen.items()}
    if reader.size is None or reader.stored is None:
        raise InputError(f"{folder}: no view is left to read; ask for at least one")
    fov, given = next(iter(chosen.values())).fov_x_radians, region or Region()
    box, near, far = completed(given.over(region_of(source, manifest, folder)), source, fov, reader.stored, folder)
    empty = Split((), np.zeros((0, 4, 4)), ImageStack((*reader.size, 4)))
    views = ViewSet(
        path=folder,
        name=manifest["scene"] if manifest else source.name,
        title=manifest["title"] if manifest else "",
        width=reader.size[1],
        height=reader.size[0],
        fov_x_radians=fov,
        near=near,
        far=far,
        bounds=box,
        train=read.get("train", empty),
        val=read.get("val", empty),
        test=read.get("test", empty),
        rendered=manifest,
        repeated_views=_repeated_views(chosen),
        notes=source.notes,
        content=None if manifest else reader.digest(chosen),
    )
    assumed = given.bounds is None and not manifest and (source.bounds_assumed or source.region.bounds is None)
    return replace(views, bounds=carved(box, views.hull)) if assumed and "train" in read else views


def _frames(folder: Path, split: str, source: Source, manifest: JsonObject, count: int | None) -> Frames | None:
    """Return `count` evenly spread views of a split, or all views; None if the split does not exist."""
    file = transforms_file(folder, split)
    if split in manifest.get("empty_splits", []) and not file.exists():
        return None
    if manifest and (split != "val" or file.exists()):
        checked(folder, file, manifest)
    frames = source.frames(split)
    if frames is None or count is None:
        return frames
    if count < 0:
        raise InputError(f"{count} views of {split}: choose 0 or more")
    return frames.of(evenly_spread(count, frames.camera_to_world)) if count < len(frames.files) else frames


def check_listed(path: Path) -> None:
    """Check the lists of views and their cameras without reading images. Raises `InputError` as `read_view_set`."""
    source = source_of(path)
    _require_consistent(path, {split: frames for split in SPLITS if (frames := source.frames(split)) is not None})


def _require_consistent(folder: Path, chosen: dict[str, Frames]) -> None:
    """Raise `InputError` for a view that is both trained on and tested, and for splits of different cameras."""
    if {"train", "test"} <= set(chosen) and (both := {*chosen["train"].files} & {*chosen["test"].files}):
        raise InputError(f"{folder}: {min(both)} is a training and a test view; a score on it would mean nothing")
    angles = {split: frames.fov_x_radians for split, frames in chosen.items()}
    low, high = (math.tan(angle / 2.0) for angle in (min(angles.values()), max(angles.values())))
    if high - low > SAME_LENS * low:
        each = ", ".join(f"{split} {angle:.6g}" for split, angle in angles.items())
        raise InputError(
            f"{folder}: the horizontal angle differs between the splits ({each} rad), and one camera is supported; "
            "list all views in one transforms.json, whose frames may have lenses of their own"
        )


def _repeated_views(chosen: dict[str, Frames]) -> tuple[str, ...]:
    names = [f"{split}: {file.name}" for split, frames in chosen.items() for file in frames.files]
    pairs = repeated(np.concatenate([frames.camera_to_world for frames in chosen.values()]))
    return tuple(f"{names[later]} has the camera of {names[first]}" for first, later in pairs)


def region_of(source: Source, manifest: JsonObject, folder: Path) -> Region:
    if not manifest:
        return source.region
    box = np.ravel(np.array(manifest["bounds"], dtype=np.float64)).tolist()
    return region_in(folder, tuple(box), float(manifest["near"]), float(manifest["far"]))


def _name_of(file: Path, root: Path) -> str:
    """Return the name of a view: its path without suffix, from a folder that need not hold it, if it is a link."""
    inside = next((place for place in (root, root.parent) if file.is_relative_to(place)), file.parent.parent)
    return file.relative_to(inside).with_suffix("").as_posix()


@dataclass
class _Reader:
    """Reads the views of one folder one after another, and requires one size of all."""

    folder: Path
    resolution: int | None
    manifest: JsonObject
    source: Source
    scratch: Path | None
    decoded: Path | None
    stored: tuple[int, int] | None = None
    size: tuple[int, int] | None = None
    """The height and width after resizing."""
    content: hashlib.blake2b = field(default_factory=lambda: hashlib.blake2b(digest_size=32))
    """The digest of the pixels in the order of reading, without a manifest."""

    def split(self, frames: Frames, geometry: bool) -> Split:
        root = self.folder.resolve()
        names: list[str] = []
        stacks: list[ImageStack] = []
        noise: list[float] = []
        for file in frames.files:
            name = _name_of(file, root)
            # two links may lead to files of one name
            names.append(file.with_suffix("").as_posix().lstrip("/") if name in names else name)
            images = self._own(file, geometry) if self.manifest else [self._foreign(file)]
            if not stacks:
                require_room([image.shape for image in images], len(frames.files), self.scratch)
                stacks = [ImageStack(image.shape, self.scratch) for image in images]
            for stack, image in zip(stacks, images, strict=True):
                stack.append(image)
            if self.manifest:
                shrink = (self.size[1] / self.stored[1]) ** 2 if self.size and self.stored else 1.0
                if names[-1] not in self.manifest["views"]:
                    raise DamagedViewSet(f"{file}: not among the views of {NAME}; render the view set again")
                noise.append(self.manifest["views"][names[-1]]["noise_mse"] * shrink)
        stacks = stacks or [ImageStack((*(self.size or (1, 1)), 4))]
        depth, normal = stacks[1:] or (None, None)
        return Split(tuple(names), frames.camera_to_world, stacks[0], depth, normal, np.array(noise) if noise else None)

    def digest(self, chosen: dict[str, Frames]) -> str:
        """Return the digest of the pixels that were read, and of the cameras."""
        for name, frames in chosen.items():
            self.content.update(f"{name} {len(frames.files)}\n".encode())
            self.content.update(np.ascontiguousarray(frames.camera_to_world, dtype=np.float64).tobytes())
        return self.content.hexdigest()

    def _foreign(self, file: Path) -> np.ndarray:
        self._fits(file, self.source.size(file))
        pixels = self._pixels(file)
        self.content.update(np.ascontiguousarray(pixels, dtype=np.float32).data)
        return pixels

    def _pixels(self, file: Path) -> np.ndarray:
        if self.decoded is None or not (self.decoded.is_dir() and file.is_file()):
            return self.source.pixels(file, self.width)
        status = file.stat()
        of = str(file), status.st_size, status.st_mtime_ns, self.stored, self.width
        kept = self.decoded / f"{json_digest(of)}.npy"
        if kept.is_file():
            return np.asarray(np.load(kept, allow_pickle=False))
        pixels = self.source.pixels(file, self.width)
        with suppress(OSError), replacing(kept, ".npy") as temporary:  # without room it is read again
            np.save(temporary, pixels)
        return pixels

    def _own(self, file: Path, geometry: bool) -> list[np.ndarray]:
        exr = file.with_suffix(".exr")
        channels = read_channels(checked(self.folder, exr, self.manifest))
        if lacking := [name for name in CHANNELS if name not in channels]:
            raise DamagedViewSet(f"{exr}: has no channel {' '.join(lacking)}; render the view set again")
        linear = np.stack([channels[name] for name in "RGBA"], axis=-1)
        self._fits(exr, linear.shape[:2])
        resized = self.width != linear.shape[1]
        rgba = display_from_linear(area_average(linear, self.width) if resized else linear)
        if not geometry:
            return [rgba]
        depth = channels["Z"]
        normal = np.stack([channels[name] for name in ("N.X", "N.Y", "N.Z")], axis=-1)
        if resized:
            hits = np.where(depth > 0, np.maximum(linear[..., 3], 1e-3), 0.0)
            depth = area_average_hits(depth[..., None], hits, self.width)[..., 0]
            normal = area_average_hits(normal, hits, self.width)
            length = np.linalg.norm(normal, axis=-1, keepdims=True)
            normal = normal / np.where(length > 1e-6, length, 1.0)
        return [rgba, depth, normal]

    @property
    def width(self) -> int:
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
            self.size = (max(1, int(height / (width / self.width) + 1e-9)), self.width)
        if self.stored != (height, width):
            raise InputError(
                f"{file}: {width} × {height} pixels, but views before it have {self.stored[1]} × {self.stored[0]}; "
                "all images of a view set must have one size"
            )


def linear_over_white(views: ViewSet, name: str) -> np.ndarray | None:
    """Return linear light over white [height, width, 3] of the view `name` at the view set's size, not clipped; None
    for a view set of another program, which has only display colour. Errors as in `read_view_set`.

    Display colour is put over white, as everywhere (CONVENTIONS.md), and then decoded; light brighter than white is
    added. So an image equal to the display colour has errors only where the light exceeds display colour.
    """
    if "files" not in views.rendered:
        return None
    channels = read_channels(checked(views.path, views.path / f"{name}.exr", views.rendered))
    rgba = np.stack([channels[channel] for channel in "RGBA"], axis=-1)
    if rgba.shape[1] != views.width:
        rgba = area_average(rgba, views.width)
    # the light of each pixel beyond a white one of its coverage: alpha · max(colour − 1, 0)
    beyond = np.maximum(rgba[..., :3] - rgba[..., 3:].clip(0.0, 1.0), 0.0)
    return np.asarray(decode_srgb(over_white(display_from_linear(rgba))) + beyond)
