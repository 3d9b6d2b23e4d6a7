"""Q-NeRF as compositions: vanilla NeRF with exactly three parts replaced."""

from dataclasses import replace

from baselines.nerf import NERF

QNERF = replace(NERF, encoding="phi", amplifier="listing2", skip="phi")
"""Listings 1, 2 and 3 as printed. Quadrature and sampling are those of every method; see QNERF_LISTING4."""

QNERF_THEOREM = replace(QNERF, amplifier="equation4")
"""Theorem 1 (Eq. 4) on density itself instead of Listing 2."""

QNERF_LISTING4 = replace(QNERF, quadrature="listing4")
"""Q-NeRF with the paper's own quadrature as well: 1e10 as last interval, no background, from near to far."""
