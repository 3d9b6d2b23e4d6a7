"""Question 6: forward and backward pass of the quadrature, with its closed-form gradient and by autograd."""

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from baselines.numerics.quadrature import Rule as QuadratureRule
from baselines.numerics.quadrature import listing4, midpoint
from harness.speed.situation import Situation
from harness.speed.timing import interleaved, measured, quotients
from harness.speed_record import Measurement

Rule = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Densities, points and fenceposts → weights and what is left of the light."""

ITEM = 6
SIZE = (4096, 192)
"""Rays, and bins of each."""


def by_autograd(sigma: Tensor, t: Tensor, t_edges: Tensor) -> tuple[Tensor, Tensor]:
    """The rule of `midpoint`, differentiated operation by operation."""
    del t
    tau = sigma * torch.diff(t_edges, dim=-1)
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-tau), torch.exp(-through[:, -1])


def by_product(sigma: Tensor, t: Tensor, t_edges: Tensor) -> tuple[Tensor, Tensor]:
    """As it is usually written: opacities, and a running product of what they let through."""
    del t
    alpha = 1.0 - torch.exp(-sigma * torch.diff(t_edges, dim=-1))
    through = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1.0 - alpha + 1e-10], dim=-1), dim=-1)
    return alpha * through[:, :-1], through[:, -1]


def unchecked(rule: QuadratureRule) -> Rule:
    """As the renderer uses it, which makes its own fenceposts."""
    return lambda sigma, t, t_edges: rule.weights(sigma, rule.lengths(t, t_edges))


RULES: dict[str, tuple[str, Rule]] = {
    "midpoint": ("closed-form gradient", unchecked(midpoint)),
    "autograd": ("the same rule by autograd", by_autograd),
    "product": ("running product by autograd", by_product),
    "listing4": ("Listing 4 of the paper", unchecked(listing4)),
}


def measure(situation: Situation) -> Iterator[Measurement]:
    rays, bins = (64, 16) if situation.quick else SIZE
    generator = torch.Generator().manual_seed(0)
    t_edges = torch.linspace(2.0, 6.0, bins + 1).expand(rays, -1).contiguous()
    t = 0.5 * (t_edges[:, 1:] + t_edges[:, :-1])
    sigma = torch.rand(rays, bins, generator=generator) ** 8 * 50.0  # mostly empty, some solid
    gradients = torch.randn(rays, bins, generator=generator), torch.randn(rays, generator=generator)
    t_edges, t, sigma, *upstream = (one.to(situation.device) for one in (t_edges, t, sigma, *gradients))
    sigma.requires_grad_()

    def side(rule: Rule) -> Callable[[], object]:
        def forward_and_backward() -> Tensor:
            w, T_end = rule(sigma, t, t_edges)
            (gradient,) = torch.autograd.grad((w * upstream[0]).sum() + (T_end * upstream[1]).sum(), sigma)
            return gradient

        return forward_and_backward

    seconds = interleaved(
        {name: side(rule) for name, (_, rule) in RULES.items()},
        situation.repeats(9),
        situation.synchronise,
        0.01 if situation.quick else 0.1,
    )
    detail = f"{rays} rays × {bins} bins, float32, forward and backward, {situation.threads} threads"
    for name, (title, _) in RULES.items():
        if name != "midpoint":
            yield measured(
                f"quadrature.{name}.ratio",
                ITEM,
                f"Quadrature with closed-form gradient against {title}",
                quotients(seconds[name], seconds["midpoint"]),
                "×",
                detail=detail,
            )
    milliseconds = [1e3 * one for one in seconds["midpoint"]]
    yield measured(
        "quadrature.midpoint.milliseconds",
        ITEM,
        "Quadrature with closed-form gradient",
        milliseconds,
        "ms",
        detail=detail,
    )
