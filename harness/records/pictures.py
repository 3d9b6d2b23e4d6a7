"""The test views that a run saves: the renders of each cell during training, and their truth."""

import errno
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType, field
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

from harness.records.json_record import Record, as_promised, plain
from scenes.files.atomic import write_atomically
from scenes.files.errors import DamagedRecord
from scenes.files.json_object import JsonObject

Tensors = dict[str, np.ndarray]


def sealed(key: str, listing: dict[str, object], tensors: Tensors) -> bytes:
    """Return the bytes of a file whose only metadata is `key`; raises `ValueError` for NaN or Infinity in `listing`."""
    text = json.dumps({**listing, "digest": digest_of(listing, tensors)}, allow_nan=False)
    # safetensors ignores strides
    return save({name: np.asarray(tensor, order="C") for name, tensor in tensors.items()}, {key: text})


def unsealed(key: str, data: bytes) -> tuple[JsonObject, Tensors]:
    """Return the listing and tensors of `sealed`; raises `ValueError` for anything else."""
    try:
        tensors = load(data)  # checks the header's bounds
        header = msgspec.json.decode(data[8 : 8 + int.from_bytes(data[:8], "little")])
        listing = msgspec.json.decode(header["__metadata__"][key])
        claimed = listing.pop("digest")
    except (SafetensorError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(str(error) or type(error).__name__) from error
    if claimed != digest_of(listing, tensors):
        raise ValueError("its digest is wrong, so it was changed or damaged")
    return listing, tensors


def digest_of(listing: dict[str, object], tensors: Tensors) -> str:
    state = hashlib.blake2b(json.dumps(listing, sort_keys=True).encode(), digest_size=32)
    for name, tensor in sorted(tensors.items()):
        state.update(f"{name} {tensor.dtype} {tensor.shape}\n".encode())
        state.update(np.ascontiguousarray(tensor).view(np.uint8).data if tensor.size else b"")
    return state.hexdigest()


EVERY_CHECKPOINT_SEED = 0
"""The first seed of a plan, whose renders are saved at every checkpoint; other seeds save only the last."""
SCHEMA = 1
LARGEST_BYTES = 512 * 1024 * 1024
"""The maximum size of a file that is written or read."""
HEADER_BYTES = 1024 * 1024
LARGEST_HALF = 65504.0
"""The largest float16, to which brighter values are clipped."""
LISTING = "pictures"
"""The key of the listing in the header's metadata."""
REMEDY = "run again with --resume"

Half = NDArray[np.float16]
TURN = "turn"


@dataclass(frozen=True)
class Truth:
    """A saved view of the ground truth."""

    view: str
    display: Half
    """[h, w, 3]: display colour over white, 0 … 1."""
    opacity: Half
    """[h, w]."""
    linear: Half | None = None
    """[h, w, 3]: linear light over white, clipped only at 65504; None if the view set holds display colour."""
    depth: Half | None = None
    """[h, w]: distance along the unit ray in scene units, 0 where nothing is hit; None if the view set has no depth."""


@dataclass(frozen=True)
class Render:
    """A view that a cell rendered at a checkpoint."""

    view: str
    step: int
    colour: Half
    """[h, w, 3]: display colour over white, not clipped."""
    opacity: Half
    """[h, w]."""
    depth: Half
    """[h, w]: scene units."""


@dataclass(frozen=True)
class Turn:
    """Small pictures of many test views, in their order around the scene."""

    views: list[str]
    frames: NDArray[np.uint8]
    """[views, h, w, 3]: display colour over white, 0 … 255."""


TRUTH = {"display": 3, "opacity": None, "linear": 3, "depth": None}
RENDER = {"colour": 3, "opacity": None, "depth": None}
"""Map tensor → its channels; None stands for [h, w]."""
PARTS = {"truth": (TRUTH, {"display", "opacity"}), "renders": (RENDER, set(RENDER))}
"""Map kind of file → the tensors that a picture may have, and those that it must have."""


class ListedPicture(Record, frozen=True, kw_only=True):
    """A view and the names of its tensors; the truth has no step."""

    view: str
    step: int | UnsetType = UNSET
    parts: list[str]


class PicturesListing(Record, frozen=True):
    schema: int
    kind: str
    pictures: list[ListedPicture]
    turn: list[str] = field(default_factory=list)
    """The views of the turn; empty without one."""


def half(values: np.ndarray) -> Half:
    """Return values as float16, clipped to its range. Raises `ValueError` if one is NaN."""
    if np.isnan(values).any():
        raise ValueError("a picture holds NaN")
    clipped: np.ndarray = np.clip(values, -LARGEST_HALF, LARGEST_HALF)
    return clipped.astype(np.float16)


def cell_pictures(scene: str, method: str, seed: int) -> str:
    """Return the path relative to `OUT/records`."""
    return f"pictures/{scene}.{method}.{seed}.safetensors"


def truth_pictures(scene: str) -> str:
    return f"pictures/{scene}.safetensors"


def write_truth(path: Path, views: list[Truth], turn: Turn | None = None) -> None:
    """Write the truth, unless the file already holds it; raises `OSError` that names the file."""
    parts = [[name for name in TRUTH if getattr(truth, name) is not None] for truth in views]
    rows = [ListedPicture(view=truth.view, parts=names) for truth, names in zip(views, parts, strict=True)]
    _write(path, "truth", rows, views, turn)


def write_renders(path: Path, renders: list[Render], turn: Turn | None = None) -> None:
    rows = [ListedPicture(view=render.view, step=render.step, parts=list(RENDER)) for render in renders]
    _write(path, "renders", rows, renders, turn)


def read_truth(path: Path) -> list[Truth]:
    """Read the truth; raises `DamagedRecord` with reason and remedy for any other file."""
    return [Truth(row.view, **parts) for row, parts in _read(path, "truth")[0]]


def read_renders(path: Path) -> list[Render]:
    """Read renders in the order of their checkpoints, with the errors of `read_truth`."""
    rows, _ = _read(path, "renders")
    return [Render(row.view, row.step, **parts) for row, parts in rows if row.step is not UNSET]


def read_turn(path: Path, kind: Literal["truth", "renders"]) -> Turn | None:
    """Read the turn of a file, if it has one, with the errors of `read_truth`."""
    return _read(path, kind)[1]


def last_of(renders: list[Render]) -> list[Render]:
    step = max((render.step for render in renders), default=0)
    return [render for render in renders if render.step == step]


def _write(
    path: Path, kind: str, rows: list[ListedPicture], pictures: Sequence[Truth | Render], turn: Turn | None
) -> None:
    tensors: Tensors = {
        f"{place:04}.{name}": np.ascontiguousarray(getattr(picture, name), dtype=np.float16)
        for place, (row, picture) in enumerate(zip(rows, pictures, strict=True))
        for name in row.parts
    }
    if turn is not None:
        tensors[TURN] = turn.frames
    if sum(tensor.nbytes for tensor in tensors.values()) > LARGEST_BYTES - HEADER_BYTES:
        raise OSError(errno.EFBIG, f"pictures of more than {LARGEST_BYTES} bytes; store fewer views", str(path))
    data = sealed(LISTING, plain(PicturesListing(SCHEMA, kind, rows, turn.views if turn else [])), tensors)
    try:
        if path.is_file() and path.stat().st_size == len(data) and path.read_bytes() == data:
            return
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    write_atomically(path, data)


def _read(
    path: Path, kind: Literal["truth", "renders"]
) -> tuple[list[tuple[ListedPicture, dict[str, Half]]], Turn | None]:
    try:
        if not path.is_file():
            raise ValueError("missing")
        if path.stat().st_size > LARGEST_BYTES:
            raise ValueError(f"larger than {LARGEST_BYTES} bytes")
        listing, tensors = unsealed(LISTING, path.read_bytes())
        read = as_promised(listing, PicturesListing)
        if (read.schema, read.kind) != (SCHEMA, kind):
            raise ValueError(f"{read.kind} of schema {read.schema}, not {kind} of schema {SCHEMA}")
        rows = [(row, _parts(place, row, tensors, kind)) for place, row in enumerate(read.pictures)]
        turn = Turn(read.turn, _frames(tensors[TURN], len(read.turn))) if read.turn else None
        if len(tensors) != sum(len(parts) for _, parts in rows) + (turn is not None):
            raise ValueError("tensors that its listing does not know")
        return rows, turn
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        remedy = f"delete it and {REMEDY}" if os.path.lexists(path) else REMEDY
        raise DamagedRecord(f"{path}: not the pictures of a run ({reason}); {remedy}") from error


def _frames(tensor: np.ndarray, views: int) -> NDArray[np.uint8]:
    if tensor.dtype != np.uint8 or tensor.ndim != 4 or tensor.shape[::3] != (views, 3) or min(tensor.shape) < 1:
        raise ValueError(f"turn of {views} views is {tensor.dtype} {tensor.shape}")
    return tensor


def _parts(place: int, row: ListedPicture, tensors: Tensors, kind: str) -> dict[str, Half]:
    channels, needed = PARTS[kind]
    if (row.step is UNSET) is (kind == "renders"):
        raise ValueError("a checkpoint without a step, or a truth with one")
    if not needed <= set(row.parts) <= set(channels):
        raise ValueError(f"parts {row.parts}")
    parts = {name: tensors[f"{place:04}.{name}"] for name in row.parts}
    size = parts["opacity"].shape
    for name, tensor in parts.items():
        expected = size if channels[name] is None else (*size, channels[name])
        if tensor.dtype != np.float16 or len(size) != 2 or min(size) < 1 or tensor.shape != expected:
            raise ValueError(f"{name} of view {row.view} is {tensor.dtype} {tensor.shape}, not float16 {expected}")
        if not np.isfinite(tensor).all():
            raise ValueError(f"{name} of view {row.view} is not finite")
    return parts
