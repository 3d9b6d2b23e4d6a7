"""Pictures of the view cache, each one EXR file: finite float32, bit for bit, through OpenImageIO.

`scenes.view_sets.images` reads any image and compresses its output; here a picture has to be read within a fraction
of a millisecond. Inflating takes as long as everything else together.
"""

import errno
import hashlib
import os
import stat
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import numpy as np

LARGEST_PIXELS = 64 * 1024 * 1024
"""The largest picture, 8192 × 8192, as everywhere (`scenes.view_sets.images`)."""
MOST_CHANNELS = 64


def frozen(value: np.ndarray) -> np.ndarray:
    """Return a copy of a picture, over memory that cannot be made writable again.

    Raises `TypeError` unless it is a float32 array and `ValueError` for another shape than [height, width, channels],
    for an empty or absurdly large one, and for NaN or infinities: a picture that is not finite is no picture.
    """
    if not isinstance(value, np.ndarray) or value.dtype != np.float32:
        found = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
        raise TypeError(f"a picture is a float32 array, not {found}")
    if not possible(value.shape):
        raise ValueError(f"a picture is [height, width, channels], not an array of shape {value.shape}")
    if not np.isfinite(value).all():
        raise ValueError(f"{int((~np.isfinite(value)).sum())} of {value.size} values of a picture are not finite")
    return over_bytes(value.tobytes(), value.shape)


def possible(shape: tuple[int, ...]) -> bool:
    """Return whether a picture may have this shape."""
    return len(shape) == 3 and min(shape) > 0 and shape[0] * shape[1] <= LARGEST_PIXELS and shape[2] <= MOST_CHANNELS


def over_bytes(data: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """Return the bytes as a picture: unlike an array's own memory, they stay read-only whatever flag is set."""
    return np.frombuffer(data, dtype=np.float32).reshape(shape)


def digest_of(picture: np.ndarray) -> str:
    """Return 64 hexadecimal digits of shape and bits of a contiguous picture. −0.0 and 0.0 differ."""
    found = hashlib.sha256(f"float32 {picture.shape}\n".encode())
    found.update(picture.data)
    return found.hexdigest()


TILE = 512


class Damaged(ValueError):
    """The file is not, or no longer, one that `write_exr` left."""


def channel_names(channels: int) -> tuple[str, ...]:
    """Return names in an order that an EXR file keeps; five are colour, opacity and depth, as image
    viewers know them.
    """
    known = {1: "Y", 3: "RGB", 4: "RGBA", 5: "RGBAZ"}
    return tuple(known.get(channels) or (f"c{index:02d}" for index in range(channels)))


def write_exr(file: Path, picture: np.ndarray) -> None:
    """Write atomically; raises `OSError` if that fails. The file is read back, as OpenImageIO does not notice every
    full disk.
    """
    oiio = _openimageio()
    height, width, channels = picture.shape
    spec = oiio.ImageSpec(width, height, channels, oiio.FLOAT)
    spec.channelnames = channel_names(channels)
    spec.attribute("compression", "none")
    # in one piece where it is not huge: taking it apart line by line is most of reading it
    spec.tile_width, spec.tile_height = min(width, TILE), min(height, TILE)
    target = oiio.ImageOutput.create(str(file))
    if target is None:
        raise OSError(errno.EINVAL, _reason(oiio.geterror()), str(file))
    written = target.open(str(file), spec) and target.write_image(picture)
    if not (target.close() and written):
        raise OSError(errno.EIO, _reason(target.geterror()), str(file))
    try:
        whole = read_exr(file).tobytes() == picture.tobytes()
    except Damaged as error:
        raise OSError(errno.EIO, f"what was written cannot be read back ({error})", str(file)) from error
    if not whole:
        raise OSError(errno.EIO, "what was written is not what is read back", str(file))


def read_exr(file: Path) -> np.ndarray:
    """Read a file of `write_exr`, read-only. The caller has to check that its pixels are the right ones.

    Raises `Damaged`, and `OSError` if the system cannot read the file.
    """
    found = file.lstat()
    if not stat.S_ISREG(found.st_mode):  # a pipe would keep us waiting for ever
        raise Damaged("not a file")
    try:
        return _decoded(file, found.st_size)
    except UnicodeDecodeError as error:  # OpenImageIO includes a damaged name in its messages
        raise Damaged(f"no text in its header ({error.reason})") from error


def _decoded(file: Path, size: int) -> np.ndarray:
    oiio = _openimageio()
    source = oiio.ImageInput.open(str(file))
    if source is None:
        said = _reason(oiio.geterror())
        os.close(os.open(file, os.O_RDONLY))  # raises if the system refuses, and not if the content is damaged
        raise Damaged(said)
    try:
        spec = source.spec()
        shape = (spec.height, spec.width, spec.nchannels)
        # uncompressed pixels are stored as they are: a larger claim is refused before memory is allocated
        if spec.depth > 1 or not possible(shape) or 4 * spec.width * spec.height * spec.nchannels > size:
            raise Damaged(f"{shape} in {size} bytes")
        if (spec.tile_width, spec.tile_height) != (min(spec.width, TILE), min(spec.height, TILE)):
            raise Damaged(f"tiles of {spec.tile_width} × {spec.tile_height}")
        if source.format_name() != "openexr" or tuple(spec.channelnames) != channel_names(spec.nchannels):
            raise Damaged("not an EXR file as it is written here")
        pixels = source.read_image(oiio.FLOAT)
        failure = source.geterror()
        if pixels is None or failure or pixels.size != spec.width * spec.height * spec.nchannels:
            raise Damaged(_reason(failure))
        return over_bytes(pixels.tobytes(), shape)
    finally:
        source.close()
        with suppress(UnicodeDecodeError):
            source.geterror()  # unread messages are printed when it is deleted


def _reason(said: str) -> str:
    return " ".join(said.split())[:200] or "no reason given"


def _openimageio() -> ModuleType:
    """Import OpenImageIO where it is used: a cache in memory alone must not pay for it."""
    import OpenImageIO

    return OpenImageIO
