"""Table 1's weight counts, measured on the network that it describes."""

import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize
from baselines.field import NetworkField


def parameters_at_paper_size(method: str) -> dict[str, int]:
    """Weights by component of a method at 8 × 256, L = 10/4. Raises `ValueError` for one that is no network."""
    parts = CATALOG[method].parts
    if parts is None:
        raise ValueError(f"{method} is no network: Table 1 says nothing of it")
    box = Box(-torch.ones(3), torch.ones(3))
    return NetworkField(parts, NetworkSize(), box, "float32", seed=0).parameter_counts()
