"""A cell in the middle of its training, as a file: OUT/unfinished/<scene>.<method>.<seed>.safetensors."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.records.cells import CellRecord
from harness.records.json_record import DamagedRecord
from harness.records.pictures import Tensors, sealed, unsealed
from scenes.files.atomic import write_atomically

FOLDER = "unfinished"
"""Under OUT."""
ENDED = ("done", "diverged")
"""Of such a cell nothing is kept here; one with an error is tried again from where it was."""
SCHEMA = 1
LISTING = "unfinished"
LARGEST_BYTES = 4 << 30
"""A larger file is not read."""


@dataclass(frozen=True)
class Unfinished:
    """Where a cell stood."""

    listing: dict[str, Any]
    tensors: Tensors

    def under(self, prefix: str) -> Tensors:
        """The tensors whose names begin with `prefix` and a dot, without these."""
        return {
            name.removeprefix(f"{prefix}."): one for name, one in self.tensors.items() if name.startswith(f"{prefix}.")
        }


def unfinished_path(out: Path, scene: str, method: str, seed: int) -> Path:
    return out / FOLDER / f"{scene}.{method}.{seed}.safetensors"


def write_unfinished(path: Path, cell: Unfinished) -> None:
    """Whole or not at all. Raises `OSError`, naming the file."""
    write_atomically(path, sealed(LISTING, {"schema": SCHEMA, **cell.listing}, cell.tensors))


def read_unfinished(path: Path) -> Unfinished:
    """Raises `DamagedRecord` for anything that `write_unfinished` does not write."""
    try:
        if not path.is_file():
            raise ValueError("is no file")
        if (size := path.stat().st_size) > LARGEST_BYTES:
            raise ValueError(f"has {size} bytes, more than any cell")
        listing, tensors = unsealed(LISTING, path.read_bytes())
        if listing.pop("schema") != SCHEMA:
            raise ValueError("is of another version")
        return Unfinished(listing, tensors)
    except (OSError, ValueError, KeyError) as error:
        said = " ".join(str(error).split())[:200]
        raise DamagedRecord(f"{path}: {said}; delete it and run again with --resume") from error


def drop_ended(out: Path, cell: CellRecord) -> None:
    """What is kept of a cell whose record is written."""
    if cell.status in ENDED:
        unfinished_path(out, cell.scene, cell.method, cell.seed).unlink(missing_ok=True)


def drop_folder(out: Path) -> None:
    """Once nothing is kept any more."""
    with suppress(OSError):
        (out / FOLDER).rmdir()
