"""Pictures to keep."""

import numpy as np


def drawn(seed: int, height: int = 5, width: int = 7, channels: int = 5) -> np.ndarray:
    """Random bits but finite: signs, zeros of both signs, denormals and the largest numbers among them."""
    generator = np.random.default_rng(seed)
    bits = generator.integers(0, 2**32, (height, width, channels), dtype=np.uint32)
    value = bits.view(np.float32)
    value = np.where(np.isfinite(value), value, np.float32(0.5)).astype(np.float32)
    odd = np.array([-0.0, 0.0, 1e-45, -1e-40, np.finfo(np.float32).max, np.finfo(np.float32).tiny], dtype=np.float32)
    flat = value.reshape(-1)
    flat[: min(len(odd), flat.size)] = odd[: flat.size]
    return value


def same_bits(a: np.ndarray | None, b: np.ndarray) -> bool:
    return a is not None and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
