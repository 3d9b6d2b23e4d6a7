"""Images of one size in a temporary file: memory is used only for the images that are read from it.

The file has no name, so it vanishes with its process, however that ends. It is read and written, not mapped into
memory: if the disk of a mapping is full or fails, the process is killed instead of getting an error, and mapped pages
count as the process's memory. The system caches frequent reads in spare memory.
"""

import errno
import math
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import IO, SupportsIndex

import numpy as np

from scenes.files.errors import InputError


class ImageStack:
    """A stack float32 [images, height, width, …], appended one image at a time, read by image or by pixel."""

    def __init__(self, image_shape: tuple[int, ...], folder: Path | None = None) -> None:
        """Make an empty stack; its file is in `folder`, best on a disk, or in the system's temporary folder."""
        self.image_shape = image_shape
        self._folder = folder
        self._file: IO[bytes] | None = None
        self._count = 0

    @staticmethod
    def of(images: Iterable[np.ndarray], folder: Path | None = None) -> "ImageStack":
        """Return a stack of at least one image; errors as in `append`."""
        left = iter(images)
        first = next(left)
        stack = ImageStack(first.shape, folder)
        for image in chain((first,), left):
            stack.append(image)
        return stack

    @property
    def shape(self) -> tuple[int, ...]:
        return (self._count, *self.image_shape)

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: SupportsIndex) -> np.ndarray:
        number = range(self._count)[index]
        size = 4 * math.prod(self.image_shape)
        return self._read(size, [number * size]).reshape(self.image_shape)

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[index] for index in range(self._count))

    def pixels(self, index: np.ndarray) -> np.ndarray:
        """Return values [pixels, …] of the pixels [pixels], numbered through all images row by row."""
        size = 4 * math.prod(self.image_shape[2:])
        return self._read(size, (index * size).tolist()).reshape(len(index), *self.image_shape[2:])

    def append(self, image: np.ndarray) -> None:
        """Append an image; raises `InputError`, naming the folder, if nothing can be written or its disk is full."""
        if image.shape != self.image_shape:
            raise ValueError(f"an image of {image.shape} among those of {self.image_shape}")
        data = np.ascontiguousarray(image, dtype=np.float32).data.cast("B")
        try:
            if self._file is None:
                self._file = tempfile.TemporaryFile(dir=self._folder, buffering=0)  # noqa: SIM115
                weakref.finalize(self, self._file.close)
            while data:
                # a disk that fills up takes a part first, and fails at the next call
                data = data[self._file.write(data) :]
        except OSError as error:
            raise _refused(self._folder, error.strerror or str(error)) from error
        self._count += 1

    def _read(self, size: int, offsets: list[int]) -> np.ndarray:
        """Return the values of pieces of `size` bytes; raises `OSError` if the disk fails or returns less."""
        assert self._file is not None
        parts = [os.pread(self._file.fileno(), size, offset) for offset in offsets]
        if short := [len(part) for part in parts if len(part) < size]:
            raise OSError(errno.EIO, f"{short[0]} of {size} bytes were read", str(self._folder))
        return np.frombuffer(bytearray().join(parts), dtype=np.float32)


def require_room(image_shapes: Sequence[tuple[int, ...]], images: int, folder: Path | None) -> None:
    """Raise `InputError` if the disk has no room for a stack of `images` images of each shape."""
    needed = images * sum(4 * math.prod(shape) for shape in image_shapes)
    try:
        free = shutil.disk_usage(folder or tempfile.gettempdir()).free
    except OSError as error:
        raise _refused(folder, error.strerror or str(error)) from error
    if needed > free:
        raise _refused(folder, f"they take {needed >> 20} MiB, {free >> 20} MiB are free")


def _refused(folder: Path | None, reason: str) -> InputError:
    return InputError(
        f"{folder or 'temporary folder'}: the decoded images cannot be put there ({reason}); make room, "
        "name an --out on another disk, or choose a smaller --resolution"
    )
