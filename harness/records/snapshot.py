"""Snapshots of cells in training, OUT/unfinished/<scene>.<method>.<seed>.safetensors."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from harness.records.cells import CellRecord
from harness.records.pictures import Tensors, sealed, unsealed
from scenes.files.atomic import write_atomically
from scenes.files.errors import DamagedRecord
from scenes.files.json_object import JsonObject

FOLDER = "unfinished"
"""The folder of snapshots in OUT, and the key of their listings."""
ENDED = ("done", "diverged")
"""The states without a snapshot; a cell with an error resumes from its snapshot."""
SCHEMA = 1
LARGEST_BYTES = 4 << 30


@dataclass(frozen=True)
class Unfinished:
    listing: JsonObject
    tensors: Tensors

    def under(self, prefix: str) -> Tensors:
        """Return the tensors whose names begin with `prefix` and a dot, by the rest of their names."""
        start = f"{prefix}."
        return {name.removeprefix(start): self.tensors[name] for name in self.tensors if name.startswith(start)}


def unfinished_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return out / FOLDER / f"{scene}.{method}.{seed}.safetensors"


def write_unfinished(path: Path, cell: Unfinished) -> None:
    """Write atomically; raises `OSError` that names the file."""
    write_atomically(path, sealed(FOLDER, {"schema": SCHEMA, **cell.listing}, cell.tensors))


def read_unfinished(path: Path) -> Unfinished:
    """Read a snapshot; raises `DamagedRecord` for any other file."""
    try:
        if not path.is_file():
            raise ValueError("is not a file")
        if (size := path.stat().st_size) > LARGEST_BYTES:
            raise ValueError(f"has {size} bytes, more than any cell")
        listing, tensors = unsealed(FOLDER, path.read_bytes())
        if listing.pop("schema") != SCHEMA:
            raise ValueError("is of another version")
        return Unfinished(listing, tensors)
    except (OSError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())[:200]
        raise DamagedRecord(f"{path}: {reason}; delete it and run again with --resume") from error


def drop_ended(out: Path, cell: CellRecord) -> None:
    if cell.status in ENDED:
        unfinished_path(out, cell.scene, cell.method, cell.seed).unlink(missing_ok=True)


def drop_folder(out: Path) -> None:
    with suppress(OSError):
        (out / FOLDER).rmdir()
