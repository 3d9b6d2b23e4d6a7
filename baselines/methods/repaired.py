"""Candidates for a Q-NeRF that keeps the paper's idea and works: φ frequencies, φ skip, an amplifier with a learnable
contrast. In each, density is a function of the point, independent of the rest of the chunk.

`python -m harness study constants` compares them on validation views, each with its best unit of density and start;
it chose `REPAIRED`.
"""

from dataclasses import replace

from baselines.composition import Parts
from baselines.methods.chosen import parts_of
from baselines.methods.qnerf import QNERF

MEANING = {
    "running_mean": "Eq. 4 on NeRF's density, about a running mean over training samples",
    "running_mean_listing2": "Listing 2 about a running mean over training samples",
}
"""The amplifiers, in the order that decides a tie: Eq. 4 as printed first."""

CANDIDATES: dict[str, Parts] = {
    f"qnerf_{name}": replace(QNERF, amplifier=name, **parts_of(f"qnerf_{name}")) for name in MEANING
}

REPAIRED = CANDIDATES["qnerf_running_mean"]
"""The candidate with the best mean on validation views, also compared with that of a shifted Listing 2."""
