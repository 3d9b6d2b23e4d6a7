"""Candidates for a Q-NeRF that keeps the paper's idea and works: φ frequencies, φ skip, Eq. 4 on density with a
learnable contrast. Each can be opaque, and in each density is a function of the point, whatever shares the chunk.

They were fixed before any of them was trained. `python -m harness study repair` compares them on validation views, by
the rule in `harness.studies.choices.repair_search`; `REPAIRED` is the one that it chose.
"""

from dataclasses import replace

from baselines.composition import Parts
from baselines.methods.qnerf import QNERF

MEANING = {
    "running_mean": "Eq. 4 on NeRF's density, about a running mean over training samples",
    "running_mean_preactivation": "Eq. 4 before the softplus, about a running mean over training samples",
    "running_mean_positive": "Eq. 4 on NeRF's density about a running mean, α kept above 0",
    "box_mean": "Eq. 4 on NeRF's density, about the mean over fixed points of the box",
    "running_mean_boost": "Eq. 4 on NeRF's density about a running mean, with β of Listing 2 on dense matter",
    "running_mean_opacity": "Eq. 4 on the opacity of a short length about a running mean, density from that",
    "running_mean_listing2": "Listing 2 as printed, about a running mean",
    "running_mean_listing2_shifted": "Listing 2 about a running mean, beginning as thin fog like NeRF",
}
"""The amplifiers, from the simplest, Eq. 4 as printed, to the one that departs from it most."""

CANDIDATES: dict[str, Parts] = {f"qnerf_{name}": replace(QNERF, amplifier=name) for name in MEANING}
"""The candidates in the order in which a tie is decided: the simpler one first."""

REPAIRED = CANDIDATES["qnerf_running_mean"]
"""The candidate that `docs/repair_search.json` chose."""

EXCLUDED = {
    "mean of a ray": "density would depend on the ray that asks for it: no field, no surface, no consistent views",
    "mean of a call": "a pixel would depend on the chunk it is rendered in; that reading is qnerf_theorem",
}
"""The designs that are no candidates, and why."""
