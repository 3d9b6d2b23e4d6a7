"""The one table of methods. A new method is one file and one line here; being listed is being tested."""

from dataclasses import dataclass
from typing import Literal

from baselines.ablations import PARTIAL
from baselines.composition import Parts
from baselines.nerf import NERF, NERF_MATCHED
from baselines.qnerf import QNERF, QNERF_LISTING4, QNERF_THEOREM


@dataclass(frozen=True)
class Method:
    """What is trained."""

    parts: Parts | None
    """Of a network; None for a method that is made of something else."""
    title: str
    """What it is, in one line of the report."""
    kind: Literal["network", "voxels_drjit"] = "network"
    """What it is made of, and so who trains it (`harness.learner`)."""


CATALOG: dict[str, Method] = {
    "nerf": Method(NERF, "vanilla NeRF: 2^k encoding, softplus density, skip at half depth"),
    "nerf_matched": Method(NERF_MATCHED, "NeRF whose 2^k encoding reaches no further than φ does: bandwidth control"),
    "qnerf": Method(QNERF, "Q-NeRF as listed: φ encoding, amplifier of Listing 2, φ skip"),
    "qnerf_theorem": Method(QNERF_THEOREM, "Q-NeRF with the amplifier of Eq. 4 on density itself"),
    "qnerf_listing4": Method(QNERF_LISTING4, "Q-NeRF as listed, also with the quadrature of Listing 4"),
    **{
        name: Method(parts, "NeRF with " + name[5:].replace("phi_", "φ ").replace("_", ", ").replace("φ, ", "φ "))
        for name, parts in PARTIAL.items()
    },
    "voxels_drjit": Method(
        None, "no network: voxels with density and spherical harmonics, differentiated by Dr.Jit", "voxels_drjit"
    ),
}
