"""Table 1's weight counts, measured on the network that it describes."""

import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize
from baselines.field import NetworkField


def parameters_at_paper_size(method: str) -> dict[str, int]:
    """Weights by component of a method at 8 × 256, L = 10/4."""
    box = Box(-torch.ones(3), torch.ones(3))
    return NetworkField(CATALOG[method].parts, NetworkSize(), box, "float32", seed=0).parameter_counts()
