"""Variations of NeRF: the combinations of Q-NeRF's three parts (Table 4), and controls.

The controls are of two kinds. Some separate bandwidth from the golden ratio. The others remove what NeRF is known to
need (Mildenhall et al. 2020, Table 2): a comparison that misses their loss cannot be trusted to see a gain.
"""

from dataclasses import replace
from itertools import compress, product

from baselines.composition import Parts
from baselines.methods.nerf import NERF
from baselines.methods.qnerf import QNERF, QNERF_THEOREM

PARTS_OF_QNERF = {
    "phi_encoding": ("encoding",),
    "amplifier": ("amplifier", "density_scale", "start"),
    "phi_skip": ("skip",),
}
"""Part → its fields in `Parts`: an amplifier comes with the constants that were chosen for it."""


def combination(*names: str, of: Parts = QNERF) -> Parts:
    """Return NeRF with the named parts taken from `of`; without a name it is NeRF, with all three it is `of`."""
    return replace(NERF, **{field: getattr(of, field) for name in names for field in PARTS_OF_QNERF[name]})


def partial_combinations(amplifier: str, of: Parts) -> dict[str, Parts]:
    """Map name → parts of every combination that is neither NeRF nor `of`, whose amplifier is called `amplifier`."""
    chosen = [list(compress(PARTS_OF_QNERF, on)) for on in product((False, True), repeat=3) if 0 < sum(on) < 3]
    return {
        "_".join(["nerf", *(amplifier if name == "amplifier" else name for name in names)]): combination(*names, of=of)
        for names in chosen
    }


PARTIAL = partial_combinations("amplifier", QNERF) | partial_combinations("equation4", QNERF_THEOREM)
"""The partial combinations: nerf_phi_encoding, nerf_amplifier (Listing 2), nerf_equation4 (Eq. 4), and so on."""

BANDWIDTH: dict[str, Parts] = {
    "nerf_phi_far": replace(NERF, encoding="phi_matched"),
    "nerf_base165": replace(NERF, encoding="base1.65"),
}
"""The controls of bandwidth: φ with NeRF's top frequency, and φ's top frequency without φ."""

RELEASED = replace(NERF, coordinates="scene")
"""NeRF with the encoding of its released code: scene units, without π and without the scene's box. On a box of half
extent h its top frequency is log2(π / h) octaves lower than that of NERF.
"""

NO_SHIFT = replace(NERF, start=None)
"""NeRF's density without the shift before softplus, which Listing 2 does not have."""

WEAKENED: dict[str, Parts] = {
    "nerf_no_encoding": replace(NERF, encoding="none"),
    "nerf_no_direction": replace(NERF, sees_direction=False),
}

IN_FLOAT32 = {
    f"{name}_float32": replace(parts, precision="float32") for name, parts in (("nerf", NERF), ("qnerf", QNERF))
}
"""The pair of the paper with matrix multiplications in float32, beside a run in less: it names no precision."""
