"""One frame as files, and a folder of frames with a list of the complete ones.

FOLDER/0000.png      display colour over white, 8 bit, as in the report
FOLDER/0000.exr      float R G B A, linear and premultiplied, and Z
FOLDER/frames.json   frame → key of the view and digests of both files, written last
"""

import hashlib
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np

from harness.records.json_record import load_json, write_json
from harness.training.scoring.evaluate import View
from scenes.files.atomic import replacing
from scenes.view_sets.images import read_image, write_channels, write_png
from scenes.view_sets.pixels import decode_srgb

LISTING = "frames.json"


def exr_channels(view: View) -> dict[str, np.ndarray]:
    """Return float32 [h, w] by name: R G B linear, premultiplied by A, the opacity; Z, the distance along the unit ray.

    Methods are trained in display colour over white, so the white is subtracted there, `colour − (1 − A)`; the rest is
    divided by A, decoded to linear light and multiplied by A again. Where A is 0 colour is 0. Z is the method's mean
    distance, which is `far` for a ray without a hit.
    """
    opacity = np.clip(view.opacity.astype(np.float64), 0.0, 1.0)
    alpha = opacity[..., None]
    covered = np.clip(view.colour.astype(np.float64) - (1.0 - alpha), 0.0, alpha)
    straight = covered / np.where(alpha > 0.0, alpha, 1.0)
    linear = decode_srgb(straight) * alpha
    channels = {name: linear[..., index] for index, name in enumerate("RGB")}
    return {name: values.astype(np.float32) for name, values in {**channels, "A": opacity, "Z": view.depth}.items()}


class FrameFolder:
    def __init__(self, path: Path) -> None:
        self.path = path
        self._listed: dict[str, dict[str, str]] = {}
        # frames that are not listed are rendered again, which only costs time
        with suppress(OSError, ValueError, msgspec.ValidationError):
            self._listed = msgspec.convert(load_json(path / LISTING), dict[str, dict[str, str]])

    def is_whole(self, number: int, key: str) -> bool:
        """Return whether a frame shows the view with `key`, and both files hold the bytes that were written."""
        listed = self._listed.get(f"{number:04}", {})
        return listed.get("key") == key and all(
            listed.get(file.suffix) == _digest(file) for file in self._files(number)
        )

    def write(self, number: int, key: str, view: View) -> None:
        """Write atomically; raises `OSError` if it cannot be written."""
        self.path.mkdir(parents=True, exist_ok=True)
        png, exr = self._files(number)
        with replacing(png, png.suffix) as file:
            write_png(file, np.clip(view.colour, 0.0, 1.0))
        with replacing(exr, exr.suffix) as file:
            write_channels(file, exr_channels(view))
        self._listed[f"{number:04}"] = {"key": key, **{file.suffix: _digest(file) or "" for file in (png, exr)}}
        write_json(self.path / LISTING, self._listed)

    def picture(self, number: int) -> np.ndarray:
        """Return the PNG as levels, uint8 [h, w, 3]."""
        return as_levels(read_image(self._files(number)[0]))

    def _files(self, number: int) -> tuple[Path, Path]:
        return self.path / f"{number:04}.png", self.path / f"{number:04}.exr"


def as_levels(display: np.ndarray) -> np.ndarray:
    """Map display colour 0 … 1 to uint8, rounded as `write_png` does."""
    levels: np.ndarray = np.round(np.clip(display, 0.0, 1.0) * 255.0).astype(np.uint8)
    return levels


def write_levels(file: Path, levels: np.ndarray) -> None:
    """Write uint8 [h, w, 3] as a PNG, atomically; raises `OSError`."""
    with replacing(file, file.suffix) as temporary:
        write_png(temporary, levels / 255.0)


def _digest(file: Path) -> str | None:
    try:
        return hashlib.blake2b(file.read_bytes(), digest_size=16).hexdigest()
    except OSError:
        return None
