"""Tensors and a listing of what they are, in one safetensors file, sealed by a digest of all of it.

The listing is one text in the header's metadata; equal content makes equal bytes. Nothing that is read is unpickled.
This module imports numpy and safetensors alone: reports are built without torch.
"""

import hashlib
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load, save

Tensors = dict[str, NDArray[Any]]


def sealed(key: str, listing: dict[str, Any], tensors: Tensors) -> bytes:
    """The file's bytes; `key` is the one of the metadata (several would be written in any order). Raises `ValueError`
    where `listing` holds NaN or Infinity."""
    text = json.dumps({**listing, "digest": digest_of(listing, tensors)}, allow_nan=False)
    # safetensors writes memory as it lies there, whatever the strides
    return save({name: np.asarray(one, order="C") for name, one in tensors.items()}, {key: text})


def unsealed(key: str, data: bytes) -> tuple[dict[str, Any], Tensors]:
    """What `sealed` was given; raises `ValueError` for anything else."""
    try:
        tensors = load(data)  # checks the header's bounds
        listing = json.loads(json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])["__metadata__"][key])
        claimed = listing.pop("digest")
    except (SafetensorError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(str(error) or type(error).__name__) from error
    if claimed != digest_of(listing, tensors):
        raise ValueError("its digest is wrong, so it was changed or damaged")
    return listing, tensors


def digest_of(listing: dict[str, Any], tensors: Tensors) -> str:
    """64 hexadecimal digits."""
    found = hashlib.blake2b(json.dumps(listing, sort_keys=True).encode(), digest_size=32)
    for name, tensor in sorted(tensors.items()):
        found.update(f"{name} {tensor.dtype} {tensor.shape}\n".encode())
        found.update(np.ascontiguousarray(tensor).view(np.uint8).data if tensor.size else b"")
    return found.hexdigest()
