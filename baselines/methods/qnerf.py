"""Q-NeRF as compositions: vanilla NeRF with exactly three parts replaced.

An amplifier comes with the unit of density and the start that were chosen for it: the paper names neither.
"""

from dataclasses import replace

from baselines.methods.chosen import parts_of
from baselines.methods.nerf import NERF

QNERF = replace(NERF, encoding="phi", amplifier="listing2", skip="phi", **parts_of("qnerf"))
"""Listings 1, 2 and 3 as printed, in the unit of density that serves them best; quadrature and sampling as usual."""

QNERF_PRINTED = replace(QNERF, density_scale=1.0, density_per="scene")
"""Q-NeRF with the density [0, 1] of Listing 2 per scene unit: the unit of length of the poses changes its result."""

QNERF_SHIFTED = replace(QNERF, **parts_of("qnerf_shifted"))
"""Listing 2 with a shift before its sigmoid, so that a fresh field is fog, as NeRF's is."""

QNERF_THEOREM = replace(QNERF, amplifier="equation4", **parts_of("qnerf_theorem"))
"""Theorem 1 (Eq. 4) on density itself instead of Listing 2."""

QNERF_LISTING4 = replace(QNERF, quadrature="listing4")
"""Q-NeRF with the paper's quadrature as well: 1e10 as last interval, no background, from near to far."""

NERF_LISTING4 = replace(NERF, quadrature="listing4")
"""NeRF with the authors' quadrature; with QNERF_LISTING4 it is the pair that the authors compare."""
