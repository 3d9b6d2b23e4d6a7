"""One generator for each purpose, seeded by that purpose."""

import hashlib

import torch


def generator_for(*purpose: int | str) -> torch.Generator:
    """Return a CPU generator seeded only by its purpose, e.g. `(seed, step, "jitter")`, of which no method is part."""
    digest = hashlib.blake2b("/".join(map(str, purpose)).encode(), digest_size=8).digest()
    return torch.Generator().manual_seed(int.from_bytes(digest, "little") >> 1)
