"""The table of methods. A new method is one file and one line here; every listed method is tested.

Methods of a user's package are `Method`s as well (`harness.plan.plugins` finds them).
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from torch import Tensor, nn

from baselines.amplifiers import Amplifier
from baselines.composition import Ladder, Parts
from baselines.contract import FieldSpec
from baselines.methods.ablations import BANDWIDTH, IN_FLOAT32, NO_SHIFT, PARTIAL, RELEASED, WEAKENED
from baselines.methods.explicit import GAUSSIANS, PLANES, TABLES, GivenSettings, VoxelSettings
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

NETWORK = "harness.training.trainer:Trainer"
PLANE_FIELD, HASH_FIELD = "baselines.grids.planes:planes", "baselines.grids.hash_grid:hash_grid"


@dataclass(frozen=True)
class Method:
    settings: Any
    """All that changes its results except what all methods share: `Parts`, another frozen dataclass, or None."""
    title: str
    trainer: str | Callable[[Any], Any] = NETWORK
    """`harness.training.learner.Job` → its `Learner`; as "module:name" it is imported when the method is trained."""
    make_field: str | Callable[[FieldSpec], nn.Module] | None = None
    """A factory of a field that is not composed of parts: a `torch.nn.Module` that implements
    `baselines.contract.TrainableField`. As "module:name" it is imported when a field is made. None for a composition,
    and for a method with its own trainer.
    """
    deviations: tuple[str, ...] = ()
    """Sentences that a report states of its training; `{name}` stands for a setting of the method."""
    ladders: Mapping[str, Ladder] = field(default_factory=dict)
    """Additional encodings that `settings` names, in the form of `LADDERS`; the next four fields likewise."""
    amplifiers: Mapping[str, Callable[[float | None], Amplifier]] = field(default_factory=dict)
    skips: Mapping[str, Callable[[int], int]] = field(default_factory=dict)
    activations: Mapping[str, Callable[[Tensor], Tensor]] = field(default_factory=dict)
    losses: Mapping[str, Callable[[Tensor, Tensor], Tensor]] = field(default_factory=dict)

    @property
    def parts(self) -> Parts | None:
        return self.settings if isinstance(self.settings, Parts) else None

    @property
    def is_field(self) -> bool:
        """Return whether it is a field of torch that the trainer of networks steps."""
        return self.trainer == NETWORK

    def deviations_with(self, own: Any) -> list[str]:
        values = {} if own is None else asdict(own)
        texts = [text.format_map(values) for text in self.deviations]
        if isinstance(own, Parts) and own.own_training:
            listed = ", ".join(f"{name} {value}" for name, value in own.own_training.items())
            texts.append(f"It trains with {listed}, the other methods with those of the run.")
        return texts


FEATURES = (
    "Its features are trained by Adam whichever optimiser the networks have, at {rate:g} times their learning rate. "
    "Sizes and rates were chosen in single runs on validation views of lego; the networks had a sweep.",
)
DRAWN = (
    "Its Gaussians are trained by Adam with separate rates, which fall to {last_rate:.0%}, whichever optimiser and "
    "rate the networks have. The rates, the number of Gaussians and the interval at which they move were chosen in "
    "about 30 single runs on validation views of lego and ficus; the networks had a sweep. Its first Gaussians lie on "
    "the surface of the silhouettes' hull, unless it is switched off.",
)
WHOLE_VIEWS = "It trains on one complete view per step, the other methods on rays of all views."
VOXELS = (
    "It has no network: a quarter, half, then all of {finest} voxels along the box, {bins} points on every ray that "
    "meets it, without any skipped, and one thread of the processor however many the other methods use. Its learning "
    "rate is {rate_factor:g} times that of the networks. This factor and the weight of the smoothing were chosen on "
    "validation views of chair and ship; the networks had no such choice.",
)


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
    **{
        name: Method(parts, f"{name.partition('_')[0]} in float32, where the run has less")
        for name, parts in IN_FLOAT32.items()
    },
    "nerf_no_encoding": Method(WEAKENED["nerf_no_encoding"], "NeRF without positional encoding: a known loss"),
    "nerf_no_direction": Method(WEAKENED["nerf_no_direction"], "NeRF without view direction: a known loss"),
    **{name: Method(parts, f"a candidate: {MEANING[parts.amplifier]}") for name, parts in CANDIDATES.items()},
    **{name: Method(own, title, make_field=PLANE_FIELD, deviations=FEATURES) for name, (own, title) in PLANES.items()},
    **{name: Method(own, title, make_field=HASH_FIELD, deviations=FEATURES) for name, (own, title) in TABLES.items()},
    "splats": Method(*GAUSSIANS["splats"], "harness.training.make_learner:splats", deviations=(*DRAWN, WHOLE_VIEWS)),
    "ellipsoids": Method(*GAUSSIANS["ellipsoids"], "harness.training.make_learner:ellipsoids", deviations=DRAWN),
    "voxels_drjit": Method(
        VoxelSettings(),
        "no network: voxels with density and spherical harmonics, differentiated by Dr.Jit",
        "harness.training.make_learner:voxels",
        deviations=VOXELS,
    ),
}
GIVEN = "given_splats"
UNTRAINED = {
    GIVEN: Method(
        GivenSettings(),
        "3-D Gaussians of a .ply file, trained elsewhere and drawn here",
        "harness.training.make_learner:given_splats",
    ),
}
"""What a run scores but does not train: no method to compare, so it has no place in `CATALOG`."""
