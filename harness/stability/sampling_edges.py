"""Q10: importance sampling where its distribution is none, a spike, or asked at its very ends."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from baselines.numerics.sampling import inverse_cdf
from harness.stability.situation import Finding, Situation
from harness.stability_record import judged

BINS = 16
NEAR, FAR = 2.0, 6.0
U = torch.tensor([0.0, 0.0, 1e-45, 1e-30, 0.25, 0.5, 1.0 - 2.0**-24, 1.0, 1.0])
"""Also what no generator should give: 1 belongs to no bin."""


def _weights() -> dict[str, tuple[Tensor, int, int]]:
    """What → weights, and the first and the last bin in which a distance may lie."""
    cases = {"all zero": (torch.zeros(BINS), 0, BINS - 1)}
    for spike in (0, 7, BINS - 1):
        for weight in (1e-45, 1e-38, 1e-10, 1.0, 1e10, 1e30, 3e38):
            w = torch.zeros(BINS)
            w[spike] = weight
            cases[f"{weight:g} in bin {spike}"] = (w, spike, spike)
    for weight in (1e-45, 1e-10, 1.0, 1e30, 3e38):
        cases[f"{weight:g} everywhere"] = (torch.full((BINS,), weight), 0, BINS - 1)
    steep = 10.0 ** torch.linspace(-30, 30, BINS)
    cases["1e-30 to 1e30"] = (steep, 0, BINS - 1)
    inner = torch.zeros(BINS)
    inner[3:6] = torch.tensor([1e-10, 0.0, 1.0])
    cases["zero at both ends"] = (inner, 3, 5)
    return cases


def _tried(draw: str) -> tuple[float, list[str]]:
    """Largest distance by which `draw` leaves its bins or steps back, and what it did wrong."""
    t_edges = torch.linspace(NEAR, FAR, BINS + 1).unsqueeze(0)
    worst, wrong = 0.0, []
    for what, (w, first, last) in _weights().items():
        drawn = {"ours": inverse_cdf, "usual": usual_inverse}[draw](t_edges, w.unsqueeze(0), U.unsqueeze(0))[0]
        if draw == "usual":  # its floor of 1e-5 means to look everywhere
            first, last = 0, BINS - 1
        out = max(float(t_edges[0, first] - drawn.min()), float(drawn.max() - t_edges[0, last + 1]), 0.0)
        back = max(float(-torch.diff(drawn).min()), 0.0)
        gap = max(out, back) if bool(torch.isfinite(drawn).all()) else math.inf
        if gap > 0.0:
            wrong.append(f"{what}: {'not finite' if math.isinf(gap) else f'{gap:.2g}'}")
        worst = max(worst, gap)
    return worst, wrong


def usual_inverse(t_edges: Tensor, w: Tensor, u: Tensor) -> Tensor:
    """As the field has it: weights + 1e-5, and where a bin has no mass its length is taken for 1."""
    w = w + 1e-5
    cdf = torch.cumsum(w / w.sum(dim=-1, keepdim=True), dim=-1)
    cdf = torch.cat([torch.zeros_like(cdf[:, :1]), cdf], dim=-1)
    right = torch.searchsorted(cdf, u.contiguous(), right=True)
    below, above = (right - 1).clamp(min=0), right.clamp(max=cdf.shape[-1] - 1)
    left, mass = cdf.gather(-1, below), cdf.gather(-1, above) - cdf.gather(-1, below)
    share = (u - left) / torch.where(mass < 1e-5, torch.ones_like(mass), mass)
    return t_edges.gather(-1, below) + share * (t_edges.gather(-1, above) - t_edges.gather(-1, below))


def inverse_cdf_extremes(situation: Situation) -> Iterator[Finding]:
    """Q10."""
    del situation
    what = "largest distance outside of the bins with weight, or backwards"
    worst, wrong = _tried("ours")
    yield judged("Q10", "inverse_cdf", "ours", worst, 0.0, what=what, why="; ".join(wrong[:4]))
    accepted = []
    for bad, error in ((math.nan, FloatingPointError), (math.inf, FloatingPointError), (-1e-6, ValueError)):
        w = torch.ones(3, BINS)
        w[1, 4] = bad
        try:
            inverse_cdf(torch.linspace(NEAR, FAR, BINS + 1).expand(3, -1), w, U.expand(3, -1))
            accepted.append(f"{bad} accepted")
        except (FloatingPointError, ValueError) as raised:
            if not isinstance(raised, error) or "bin 4 on ray 1" not in str(raised):
                accepted.append(f"{bad}: {raised}")
    yield judged(
        "Q10", "inverse_cdf", "ours", float(len(accepted)), 0.0, what="bad weights accepted or misnamed",
        why="; ".join(accepted),
    )  # fmt: skip
    yield judged("Q10", "inverse_cdf", "ours", float(_bad_gradients()), 0.0, what="gradients that are not finite")
    worst, wrong = _tried("usual")
    yield judged(
        "Q10", "weights + 1e-5", "usual", worst, 0.0, what="largest distance outside of the ray, or backwards",
        why=f"{len(wrong)} of {len(_weights())} distributions: {'; '.join(wrong[:3])}" if wrong else "",
    )  # fmt: skip


def _bad_gradients() -> int:
    """Of the distances by the fenceposts, the one thing that they are differentiable by."""
    count = 0
    for w, _, _ in _weights().values():
        t_edges = torch.linspace(NEAR, FAR, BINS + 1).unsqueeze(0).requires_grad_()
        inverse_cdf(t_edges, w.unsqueeze(0).requires_grad_(), U.unsqueeze(0)).sum().backward()
        count += int((~torch.isfinite(t_edges.grad)).sum()) if t_edges.grad is not None else t_edges.numel()
    return count
