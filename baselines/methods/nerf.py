"""Vanilla NeRF (Mildenhall et al. 2020) as a composition, and its bandwidth control. Read this file first."""

from dataclasses import replace

from baselines.composition import Parts
from baselines.methods.chosen import parts_of

NERF = replace(Parts(encoding="base2", amplifier="none", skip="half", quadrature="midpoint"), **parts_of("nerf"))

NERF_MATCHED = replace(NERF, encoding="base2_matched", **parts_of("nerf_matched"))
"""NeRF with 2^k only as far as φ^(L−1) reaches (L = 7 where φ has 10): the effect of a lower bandwidth. Without this
control a low-resolution run would credit the golden ratio with that effect.
"""
