"""Frames as bytes: the length of the header (uint32), the header (JSON), and arrays of n pixels, the header's `pixels`.

    number   uint32  [n]      of the pixel, row by row
    depth    float32 [n]      scene units along the ray, 0 without a hit
    colour   uint8   [n, 3]   display colour
    opacity  uint8   [n]

Everything is little-endian. A stream is a sequence of such messages.
"""

import json
import struct
from dataclasses import fields

import numpy as np

from harness.viewer.engine import FreshPixels
from harness.viewer.film.frames import as_levels

ARRAYS = ("pixels", "colour", "opacity", "depth")
HIT = 0.5
"""The opacity from which the depth of a pixel is shown."""


def message(kind: str, **header: object) -> bytes:
    return _packed({"kind": kind, **header, "pixels": 0}, b"")


def frame_message(frame: FreshPixels) -> bytes:
    """Return the message of a frame; a last frame whose parts were all sent before has no pixels."""
    header = {each.name: getattr(frame, each.name) for each in fields(frame) if each.name not in ARRAYS}
    if frame.state == "whole" and frame.cached is None:
        return message("frame", **header)
    return _with_pixels("frame", header, frame.pixels, frame.colour, frame.opacity, frame.depth)


def picture_message(
    kind: str, colour: np.ndarray, opacity: np.ndarray, depth: np.ndarray | None, **header: object
) -> bytes:
    """Return the message of a complete picture: colour [h, w, 3], opacity [h, w], and depth [h, w] if it is known."""
    size = opacity.size
    far = np.zeros(size, np.float32) if depth is None else depth.reshape(size)
    return _with_pixels(kind, header, np.arange(size), colour.reshape(size, 3), opacity.reshape(size), far)


def _with_pixels(
    kind: str, header: dict[str, object], pixels: np.ndarray, colour: np.ndarray, opacity: np.ndarray, depth: np.ndarray
) -> bytes:
    shown = np.where(opacity >= HIT, depth, 0.0)
    parts = (pixels.astype("<u4"), shown.astype("<f4"), as_levels(colour), as_levels(opacity))
    return _packed({"kind": kind, **header, "pixels": len(pixels)}, b"".join(part.tobytes() for part in parts))


def _packed(header: dict[str, object], payload: bytes) -> bytes:
    text = json.dumps(header, allow_nan=False, ensure_ascii=False).encode()
    return struct.pack("<I", len(text)) + text + payload
