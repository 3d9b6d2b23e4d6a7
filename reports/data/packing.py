"""Pictures as the page's script reads them: quantised, delta-coded, deflated, in base64.

The bytes are planes, one after the other: channel by channel, for 16 bits all high bytes of a channel and then all its
low ones. In a plane every byte is its difference from the byte on its left, the first of a row from the first of the
row above, modulo 256.
"""

import base64
import hashlib
import json
import zlib
from dataclasses import dataclass
from itertools import product

import numpy as np
from markupsafe import Markup

DARKEST = 1e-4
"""The offset of linear light, which is coded as ln(value + DARKEST)."""
DEPTH_STEPS = 4095
"""The steps of depth of 65535: finer than float16 beyond a quarter of the range, and half the bytes."""
LIGHT_STEPS = 16383
"""The steps of light over at most ln(65504 / DARKEST) = 20.3: half a step is less than 0.07 % of a value."""


@dataclass(frozen=True)
class Packed:
    ref: dict[str, object]
    """The description: channels, bits, low, high, id, and log if the values are logarithms."""
    text: str

    @property
    def id(self) -> str:
        return str(self.ref["id"])


def display(values: np.ndarray) -> Packed:
    """Pack 0 … 1 in 8 bits, [h, w] or [h, w, 3]; values outside are clipped."""
    return _pack(np.round(np.clip(np.asarray(values, dtype=np.float64), 0.0, 1.0) * 255).astype(np.uint8), 0.0, 1.0)


def depth(values: np.ndarray, far: float) -> Packed:
    """Pack 0 … `far` in 16 bits, [h, w]; `far` is above 0, and values outside are clipped."""
    steps = np.round(np.clip(np.asarray(values, dtype=np.float64) / far, 0.0, 1.0) * DEPTH_STEPS)
    return _pack(*_spread(steps, DEPTH_STEPS, 0.0, far))


def light(values: np.ndarray) -> Packed:
    """Pack linear light of 0 or more in 16 bits, [h, w, 3], as logarithms between its minimum and maximum."""
    logarithms = np.log(np.maximum(np.asarray(values, dtype=np.float64), 0.0) + DARKEST)
    low, high = float(logarithms.min()), float(logarithms.max())
    steps = np.round((logarithms - low) / max(high - low, 1e-9) * LIGHT_STEPS)
    return _pack(*_spread(steps, LIGHT_STEPS, low, high), log=True)


def _spread(steps: np.ndarray, most: int, low: float, high: float) -> tuple[np.ndarray, float, float]:
    """Return steps as 16-bit numbers whose last bits are 0, and the values that 0 and 65535 then stand for."""
    width = 65536 // (most + 1)
    return (steps * width).astype(np.uint16), low, low + (high - low) * 65535 / (most * width)


def _pack(levels: np.ndarray, low: float, high: float, log: bool = False) -> Packed:
    levels = levels if levels.ndim == 3 else levels[..., None]
    data = zlib.compress(planes(levels), 9)
    bits = 8 * levels.dtype.itemsize
    name = hashlib.blake2b(data, digest_size=6).hexdigest()  # equal pictures share a name, and are in the page once
    ref = {"channels": levels.shape[2], "bits": bits, "low": low, "high": high, "id": f"px{name}"}
    return Packed({**ref, **({"log": True} if log else {})}, base64.b64encode(data).decode("ascii"))


def planes(levels: np.ndarray) -> bytes:
    """Return the delta-coded planes of uint8 or uint16 [h, w, channels]."""
    shifts = (8, 0) if levels.dtype == np.uint16 else (0,)
    coded = b""
    for channel, shift in product(range(levels.shape[2]), shifts):
        plane = ((levels[..., channel] >> shift) & 255).astype(np.uint8)
        differences = plane.copy()
        differences[:, 1:] -= plane[:, :-1]
        differences[1:, 0] -= plane[:-1, 0]
        coded += differences.tobytes()
    return coded


def as_json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def as_data(value: object) -> Markup:
    """Return JSON for a `<script type="application/json">`: no text in it can end the element or open another."""
    return Markup(as_json(value).replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
