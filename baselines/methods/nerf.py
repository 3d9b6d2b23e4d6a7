"""Vanilla NeRF (Mildenhall et al. 2020) as a composition, and its bandwidth control. Read this file first."""

from dataclasses import replace

from baselines.composition import Parts

NERF = Parts(encoding="base2", amplifier="none", skip="half", quadrature="midpoint")

NERF_MATCHED = replace(NERF, encoding="base2_matched")
"""NeRF with 2^k only as far as φ^(L−1) reaches (L = 7 where φ has 10): the effect of a lower bandwidth alone. Without
this control a low-resolution run would credit the golden ratio with it.
"""
