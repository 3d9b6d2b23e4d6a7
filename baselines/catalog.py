"""The one table of methods. A new method is one file and one line here; every listed method is tested.

Methods of a user's own package are `Method`s as well (`harness.plan.plugins` finds them).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from baselines.amplifiers import Amplifier
from baselines.composition import Ladder, Parts
from baselines.contract import FieldSpec
from baselines.grids import growth
from baselines.methods.ablations import BANDWIDTH, NO_SHIFT, PARTIAL, RELEASED, WEAKENED
from baselines.methods.nerf import NERF, NERF_MATCHED
from baselines.methods.qnerf import (
    NERF_LISTING4,
    QNERF,
    QNERF_LISTING4,
    QNERF_PRINTED,
    QNERF_SHIFTED,
    QNERF_THEOREM,
)
from baselines.methods.repaired import CANDIDATES, MEANING, REPAIRED


@dataclass(frozen=True)
class Method:
    """A method that can be trained."""

    parts: Parts | None
    """The parts of a network; None for a method of another kind."""
    title: str
    """A one-line description for the report."""
    kind: Literal["network", "splats", "ellipsoids", "voxels_drjit"] = "network"
    """The kind of model, which determines its trainer (`harness.training.learner`)."""
    ladders: Mapping[str, Ladder] = field(default_factory=dict)
    """Additional encodings that `parts` names; `amplifiers` and `skips` likewise. They have the form of the tables
    `LADDERS`, `AMPLIFIERS` and `SKIPS`, to which they are added.
    """
    amplifiers: Mapping[str, Callable[[float | None], Amplifier]] = field(default_factory=dict)
    skips: Mapping[str, Callable[[int], int]] = field(default_factory=dict)
    make_field: Callable[[FieldSpec], Any] | None = None
    """A factory of a field that is not composed of our parts (`parts` is then None): a `torch.nn.Module` that
    implements `baselines.contract.TrainableField`.
    """


def _planes(name: str) -> Callable[[FieldSpec], Any]:
    """Return the factory; the compiler that a field of it needs is imported for it alone, here and below."""

    def made(spec: FieldSpec) -> Any:
        from baselines.grids.planes import planes

        return planes(spec, growth.PLANES[name][1])

    return made


def _hash_grid(name: str) -> Callable[[FieldSpec], Any]:
    def made(spec: FieldSpec) -> Any:
        from baselines.grids.hash_grid import hash_grid

        tables = growth.TABLES[name]
        return hash_grid(spec, tables.cells, tables.entries)

    return made


def parts_named(combination: str) -> str:
    """Return the parts that a name lists: nerf_phi_encoding_amplifier → φ encoding, amplifier."""
    words = combination.removeprefix("nerf_").replace("phi_", "φ ").replace("equation4", "amplifier of Eq. 4")
    return words.replace("_", ", ")


CATALOG: dict[str, Method] = {
    "nerf": Method(NERF, "vanilla NeRF: 2^k encoding, softplus density, skip at half depth"),
    "nerf_matched": Method(NERF_MATCHED, "NeRF whose 2^k encoding reaches no further than φ does: bandwidth control"),
    "qnerf": Method(QNERF, "Q-NeRF as listed: φ encoding, amplifier of Listing 2, φ skip"),
    "qnerf_printed": Method(QNERF_PRINTED, "Q-NeRF as listed, with density at most 1 per scene unit"),
    "qnerf_shifted": Method(QNERF_SHIFTED, "Q-NeRF as listed, but with a shift before the sigmoid of Listing 2"),
    "qnerf_theorem": Method(QNERF_THEOREM, "Q-NeRF with the amplifier of Eq. 4 on density itself"),
    "qnerf_listing4": Method(QNERF_LISTING4, "Q-NeRF as listed, also with the quadrature of Listing 4"),
    "nerf_listing4": Method(NERF_LISTING4, "NeRF with the quadrature of Listing 4: the authors' own baseline"),
    "qnerf_repaired": Method(REPAIRED, f"Q-NeRF repaired: {MEANING[REPAIRED.amplifier]}"),
    **{name: Method(parts, "NeRF with " + parts_named(name)) for name, parts in PARTIAL.items()},
    "nerf_phi_far": Method(BANDWIDTH["nerf_phi_far"], "NeRF with φ^k as far as 2^k reaches: bandwidth control"),
    "nerf_base165": Method(BANDWIDTH["nerf_base165"], "NeRF with 1.65^k, which reaches about as far as φ^k: control"),
    "nerf_released": Method(RELEASED, "NeRF with the encoding of its released code: scene units, no π"),
    "nerf_no_shift": Method(NO_SHIFT, "NeRF whose density lacks the shift before softplus, as Listing 2 does"),
    "nerf_no_encoding": Method(WEAKENED["nerf_no_encoding"], "NeRF without positional encoding: a known loss"),
    "nerf_no_direction": Method(WEAKENED["nerf_no_direction"], "NeRF without view direction: a known loss"),
    **{name: Method(parts, f"a candidate: {MEANING[parts.amplifier]}") for name, parts in CANDIDATES.items()},
    **{name: Method(None, title, make_field=_planes(name)) for name, (title, _) in growth.PLANES.items()},
    **{name: Method(None, tables.title, make_field=_hash_grid(name)) for name, tables in growth.TABLES.items()},
    "splats": Method(None, "3-D Gaussians with spherical harmonics, drawn front to back", "splats"),
    "ellipsoids": Method(None, "the same Gaussians, traced and differentiated by Mitsuba", "ellipsoids"),
    "voxels_drjit": Method(
        None, "no network: voxels with density and spherical harmonics, differentiated by Dr.Jit", "voxels_drjit"
    ),
}
