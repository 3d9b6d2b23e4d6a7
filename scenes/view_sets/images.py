"""Image files ↔ arrays through OpenImageIO. Row 0 is on top; nothing is converted but integers to 0 … 1."""

import errno
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scenes.files.errors import InputError

LARGEST_VALUES = 208 * 1024 * 1024
"""The maximum of pixels times channels of an image: 4096 × 4096 in 13 channels, the largest render, 832 MiB."""
MOST_CHANNELS = 64
STRAIGHT = "oiio:UnassociatedAlpha"
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".exr")


def pictures(folder: Path) -> list[Path]:
    """Return the pictures of a folder by their suffixes, without hidden files, resolved, in the order of the names in
    the folder: a link may lead to a file of another name.
    """
    files = (file for file in folder.iterdir() if file.suffix.lower() in SUFFIXES and not file.name.startswith("."))
    return [file.resolve() for file in sorted(files) if file.is_file()]


def read_image(file: Path) -> np.ndarray:
    """Read a file's first image as float32 [h, w, channels], integers divided by their largest. Raises `InputError`,
    naming the file, if it is missing, empty, truncated, not an image or too large.
    """
    return _read(file)[0]


def read_channels(file: Path) -> dict[str, np.ndarray]:
    """Read the channels of a (multi-channel EXR) file by name, float32 [h, w] each; errors as in `read_image`."""
    pixels, names, _ = _read(file)
    return {name: pixels[..., index] for index, name in enumerate(names)}


class Header(NamedTuple):
    width: int
    height: int
    channels: int
    orientation: int
    """How a viewer turns the stored pixels, by EXIF: 1 not at all, 5 to 8 by a quarter."""


def header(file: Path) -> Header:
    """Read the size of an image without its pixels; errors as in `read_image`."""
    with _opened(file, complete=False) as source:
        return _header(source.spec())


def _header(spec: Any) -> Header:
    return Header(spec.width, spec.height, spec.nchannels, spec.get_int_attribute("Orientation", 1))


def display_image(file: Path, as_stored: bool = False) -> np.ndarray:
    """Read an image of display colour, 8 or 16 bits per channel; errors as in `read_image`, and for floating-point
    pixels, which usually are linear light, and, unless `as_stored`, for an image that a viewer would turn.
    """
    import OpenImageIO as oiio

    pixels, _, spec = _read(file)
    if spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
        raise InputError(f"{file}: has floating-point pixels, up to {pixels.max():.4g}; save display colour as PNG")
    if not as_stored and (turned := _header(spec).orientation) != 1:
        raise InputError(f"{file}: a viewer turns it (EXIF orientation {turned}), cameras may not; save it upright")
    return pixels


def display_levels(file: Path, channels: int) -> np.ndarray:
    """Read display colour as it is stored, uint8 or uint16 [h, w, 3 or 4]; grey becomes RGB. Raises `InputError` as
    `display_image`, and if only one of this image and the first of its set, which has `channels`, has alpha.
    """
    import OpenImageIO as oiio

    with _opened(file) as source:
        kind = source.spec().format.basetype
        if kind in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
            raise InputError(f"{file}: has floating-point pixels; save display colour as PNG")
        levels = _pixels(source, file, oiio.UINT8 if kind == oiio.UINT8 else oiio.UINT16)
    if levels.shape[2] < 3:  # grey, perhaps with alpha
        levels = np.concatenate([levels[..., :1]] * 2 + [levels], axis=-1)
    own, expected = levels.shape[2], channels + 2 * (channels < 3)
    if {own, expected} == {3, 4}:
        alpha = "no alpha, but the first view has it" if own == 3 else "alpha, but the first view has none"
        raise InputError(f"{file}: has {alpha}; save all views of a set with alpha, or all without")
    if own not in (3, 4):
        raise InputError(f"{file}: {own} channels; views must be RGB or RGBA: save them so")
    return levels


def _read(file: Path) -> tuple[np.ndarray, tuple[str, ...], Any]:
    import OpenImageIO as oiio

    with _opened(file) as source:
        spec = source.spec()
        return _pixels(source, file, oiio.FLOAT), tuple(spec.channelnames), spec


def _pixels(source: Any, file: Path, kind: Any) -> np.ndarray:
    """Return all pixels as `kind`, with straight alpha."""
    import OpenImageIO as oiio

    spec = source.spec()
    # in 16 bits, Blender writes TIFF with colour times alpha
    is_times_alpha = spec.alpha_channel >= 0 and source.format_name() == "tiff" and not spec.get_int_attribute(STRAIGHT)
    pixels = source.read_image(oiio.FLOAT if is_times_alpha else kind)
    failure = source.geterror()
    if pixels is None or failure:
        raise InputError(f"{file}: this image is truncated or damaged ({_reason(failure)}); get it again")
    shaped: np.ndarray = np.asarray(pixels).reshape(spec.height, spec.width, spec.nchannels)
    return _straight(shaped, spec.alpha_channel, kind) if is_times_alpha else shaped


def _straight(pixels: np.ndarray, alpha: int, kind: Any) -> np.ndarray:
    import OpenImageIO as oiio

    opacity = pixels[..., alpha : alpha + 1]
    colour: np.ndarray = np.divide(pixels, opacity, out=np.zeros_like(pixels), where=opacity > 0.0)
    colour[..., alpha] = pixels[..., alpha]
    if kind == oiio.FLOAT:
        return colour
    most, levels = (255.0, np.uint8) if kind == oiio.UINT8 else (65535.0, np.uint16)
    return np.asarray(np.round(np.clip(colour, 0.0, 1.0) * most), dtype=levels)


@contextmanager
def _opened(file: Path, complete: bool = True) -> Iterator[Any]:
    """Open a file as an `ImageInput` and check its size, and whether a PNG is complete. Raises `InputError`."""
    import OpenImageIO as oiio  # not at the top: slow, and reading a manifest does not need it

    if not file.is_file():
        raise InputError(f"{file}: this image is missing")
    if file.stat().st_size == 0:
        raise InputError(f"{file}: this image file is empty; get it again")
    if complete:
        _check_png(file)
    config = oiio.ImageSpec()
    config.attribute(STRAIGHT, 1)  # leave straight alpha as it is stored
    source = None
    try:
        source = oiio.ImageInput.open(str(file), config)
        if source is None:
            raise InputError(f"{file}: not an image that can be read ({_reason(oiio.geterror())})")
        spec = source.spec()
        if spec.width < 1 or spec.height < 1 or spec.depth > 1 or spec.nchannels < 1:
            raise InputError(f"{file}: {spec.width} × {spec.height} × {spec.depth} pixels is not a flat image")
        if spec.width * spec.height * spec.nchannels > LARGEST_VALUES or spec.nchannels > MOST_CHANNELS:
            raise InputError(
                f"{file}: {spec.width} × {spec.height} pixels in {spec.nchannels} channels is larger than the "
                f"{LARGEST_VALUES} values in {MOST_CHANNELS} channels that are read; make it smaller"
            )
        yield source
    except UnicodeDecodeError as error:  # OpenImageIO includes a damaged name in its messages
        raise InputError(f"{file}: this image is damaged (a name in it is not text); get it again") from error
    finally:
        if source is not None:
            source.close()


def _check_png(file: Path) -> None:
    """Raise `InputError` unless the chunks of a PNG, by its contents, are complete; libpng would also print to the
    terminal.
    """
    with file.open("rb") as handle:
        if handle.read(8) != (signature := b"\x89PNG\r\n\x1a\n"):
            return
        data = signature + handle.read()
    start = 8
    while start + 12 <= len(data):
        length = int.from_bytes(data[start : start + 4], "big")
        body, checksum = data[start + 4 : start + 8 + length], data[start + 8 + length : start + 12 + length]
        if len(checksum) < 4 or zlib.crc32(body) != int.from_bytes(checksum, "big"):
            break
        if body[:4] == b"IEND":
            return
        start += 12 + length
    raise InputError(f"{file}: this image is truncated or damaged (at byte {start} of {len(data)}); get it again")


def write_png(file: Path, display: np.ndarray) -> None:
    """Write straight display colour [h, w, 3 or 4], 0 … 1, as an 8-bit PNG, read back as a check. Raises `OSError`."""
    import OpenImageIO as oiio

    levels = np.round(np.clip(display, 0.0, 1.0) * 255.0).astype(np.uint8)
    spec = oiio.ImageSpec(levels.shape[1], levels.shape[0], levels.shape[2], oiio.UINT8)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", "sRGB")
    _write(file, spec, levels)


def write_channels(file: Path, channels: dict[str, np.ndarray]) -> None:
    """Write named float32 channels [h, w] as a float EXR file, and read it back as a check. Raises `OSError`."""
    import OpenImageIO as oiio

    pixels = np.stack(list(channels.values()), axis=-1).astype(np.float32)
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], oiio.FLOAT)
    spec.channelnames = tuple(channels)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "1970:01:01 00:00:00")  # instead of the time of writing: equal pixels make equal files
    _write(file, spec, pixels)


def _write(file: Path, spec: Any, pixels: np.ndarray) -> None:
    """Write and read back: OpenImageIO does not notice a full disk for every format."""
    import OpenImageIO as oiio

    target = oiio.ImageOutput.create(str(file))
    if target is None:
        raise OSError(errno.EINVAL, _reason(oiio.geterror()), str(file))
    written = target.open(str(file), spec) and target.write_image(np.ascontiguousarray(pixels))
    # a full disk shows when the file is closed, if not before
    if not (target.close() and written):
        raise OSError(_cause(file), _reason(target.geterror()), str(file))
    if not file.is_file():
        raise OSError(errno.EIO, "nothing was written", str(file))
    try:
        back = _read(file)[0]
    except InputError as error:
        raise OSError(_cause(file), f"the written file cannot be read back: {error}", str(file)) from error
    if pixels.dtype == np.uint8:
        back = np.round(back * np.float32(255.0))
    if not np.array_equal(back, pixels, equal_nan=True):
        raise OSError(_cause(file), "the written file differs when it is read back", str(file))


def _cause(file: Path) -> int:
    """Return the system's error number, which OpenImageIO does not pass on, by writing to the file."""
    try:
        with file.open("ab") as handle:
            handle.write(b"\0" * 65536)
            handle.flush()
            os.fsync(handle.fileno())
    except OSError as error:
        return error.errno or errno.EIO
    return errno.EIO


def _reason(message: str) -> str:
    printable = "".join(letter if letter.isprintable() else " " for letter in message)  # messages include file contents
    return " ".join(printable.split())[:200] or "no reason given"
