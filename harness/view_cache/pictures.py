"""What the view cache holds: finite float32 arrays [height, width, channels] that nobody can change any more."""

import hashlib

import numpy as np

LARGEST_PIXELS = 64 * 1024 * 1024
"""8192 × 8192, as everywhere (`scenes.images`)."""
MOST_CHANNELS = 64


def frozen(value: np.ndarray) -> np.ndarray:
    """A copy of a picture, over memory that cannot be made writable again.

    Raises `TypeError` for what is no float32 array and `ValueError` for another shape than [height, width, channels],
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
    """Whether a picture may have this shape."""
    return len(shape) == 3 and min(shape) > 0 and shape[0] * shape[1] <= LARGEST_PIXELS and shape[2] <= MOST_CHANNELS


def over_bytes(data: bytes, shape: tuple[int, ...]) -> np.ndarray:
    """The bytes as a picture: unlike an array's own memory, they stay read-only whatever flag is set."""
    return np.frombuffer(data, dtype=np.float32).reshape(shape)


def digest_of(picture: np.ndarray) -> str:
    """64 hexadecimal digits of shape and bits of a contiguous picture. −0.0 and 0.0 differ."""
    found = hashlib.sha256(f"float32 {picture.shape}\n".encode())
    found.update(picture.data)
    return found.hexdigest()
