"""One picture ↔ one EXR file of 32-bit floats, uncompressed, bit for bit, through OpenImageIO.

`scenes.images` reads any image and compresses what it writes; here a picture has to be back within a fraction of a
millisecond. Inflating takes as long as everything else together.
"""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path
from types import ModuleType

import numpy as np

from harness.view_cache.pictures import over_bytes, possible

TILE = 512


class Damaged(ValueError):
    """Not a file that `write_exr` left, or no longer."""


def channel_names(channels: int) -> tuple[str, ...]:
    """In an order that an EXR file keeps; five are colour, opacity and depth, as image viewers know them."""
    known = {1: "Y", 3: "RGB", 4: "RGBA", 5: "RGBAZ"}
    return tuple(known.get(channels) or (f"c{index:02d}" for index in range(channels)))


def write_exr(file: Path, picture: np.ndarray) -> None:
    """Raises `OSError` where it cannot be written whole; what was written is read back, as OpenImageIO does not notice
    every disk that is full.
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
    """What `write_exr` wrote, read-only. Whether its pixels are the right ones is for the caller to check.

    Raises `Damaged`, and `OSError` where the system does not give the file.
    """
    found = file.lstat()
    if not stat.S_ISREG(found.st_mode):  # a pipe would keep us waiting for ever
        raise Damaged("not a file")
    try:
        return _decoded(file, found.st_size)
    except UnicodeDecodeError as error:  # OpenImageIO passes a damaged name on in what it says
        raise Damaged(f"no text in its header ({error.reason})") from error


def _decoded(file: Path, size: int) -> np.ndarray:
    oiio = _openimageio()
    source = oiio.ImageInput.open(str(file))
    if source is None:
        said = _reason(oiio.geterror())
        os.close(os.open(file, os.O_RDONLY))  # raises where it is the system that refuses, and not the content
        raise Damaged(said)
    try:
        spec = source.spec()
        shape = (spec.height, spec.width, spec.nchannels)
        # uncompressed pixels lie in the file as they are: what claims to have more is refused before memory is taken
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
            source.geterror()  # what nobody asked for is printed when it is deleted


def _reason(said: str) -> str:
    return " ".join(said.split())[:200] or "no reason given"


def _openimageio() -> ModuleType:
    """Imported where it is used: a cache in memory alone must not pay for it."""
    import OpenImageIO

    return OpenImageIO
