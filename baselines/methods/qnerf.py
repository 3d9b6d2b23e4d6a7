"""Q-NeRF as compositions: vanilla NeRF with exactly three parts replaced."""

from dataclasses import replace

from baselines.methods.nerf import NERF

QNERF = replace(NERF, encoding="phi", amplifier="listing2", skip="phi")
"""Listings 1, 2 and 3 as printed, with the unit of density that every method has: the paper names none. Quadrature and
sampling are those of every method too; see QNERF_LISTING4.
"""

QNERF_PRINTED = replace(QNERF, density_scale=1.0, density_per="scene")
"""Q-NeRF whose density is the [0, 1] of Listing 2 itself, at most 1 per scene unit: what it can show depends on the
unit of length in which the poses are written.
"""

QNERF_THEOREM = replace(QNERF, amplifier="equation4")
"""Theorem 1 (Eq. 4) on density itself instead of Listing 2."""

QNERF_LISTING4 = replace(QNERF, quadrature="listing4")
"""Q-NeRF with the paper's own quadrature as well: 1e10 as last interval, no background, from near to far."""

NERF_LISTING4 = replace(NERF, quadrature="listing4")
"""NeRF with the authors' quadrature: with QNERF_LISTING4, the authors' own pair."""
