"""Every combination of the three parts of Q-NeRF, each one vanilla NeRF with some parts replaced (Table 4)."""

from dataclasses import replace
from itertools import product

from baselines.composition import Parts
from baselines.nerf import NERF
from baselines.qnerf import QNERF

PARTS_OF_QNERF = {"phi_encoding": "encoding", "amplifier": "amplifier", "phi_skip": "skip"}


def combination(*names: str) -> Parts:
    """NeRF with the named parts taken from Q-NeRF; none of them is NeRF itself, all three are Q-NeRF."""
    return replace(NERF, **{PARTS_OF_QNERF[name]: getattr(QNERF, PARTS_OF_QNERF[name]) for name in names})


PARTIAL: dict[str, Parts] = {
    "nerf_" + "_".join(chosen): combination(*chosen)
    for switches in product((False, True), repeat=3)
    if 0 < len(chosen := [name for name, on in zip(PARTS_OF_QNERF, switches, strict=True) if on]) < 3
}
"""The six that are neither NeRF nor Q-NeRF: nerf_phi_encoding, nerf_amplifier, nerf_phi_encoding_amplifier, …"""
