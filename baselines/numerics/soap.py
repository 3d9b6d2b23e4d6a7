"""SOAP: Adam in the eigenbasis of Shampoo's factors (Vyas et al. 2024, arXiv 2409.11321), for small matrices.

A matrix W [m, n] with gradient G has the factors L = mean of G Gᵀ and R = mean of Gᵀ G. Adam runs on Uᵀ G V, where U
and V are the eigenvectors of L and R, updated by one step of orthogonal iteration every few steps. Matrices of one
shape are stacked, as for such small matrices the calls are the cost. Adam trains all weights that are not matrices.
"""

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

EPSILON = 1e-8
LEAST = 1e-3
"""The amount that is added to every eigenvalue, relative to their mean. Gradients of a few steps do not span the space;
in the rest of it the bases would consist of rounding errors, which differ between processors. With this amount they
stay there as they were, or remain the axes.
"""

Stack = Float[Tensor, "weights rows columns"]
Factor = Float[Tensor, "weights side side"]


@dataclass
class _Side:
    """The factor of one side of stacked matrices, and its eigenvectors as columns in falling order of eigenvalue."""

    factor: Factor
    basis: Factor

    @staticmethod
    def of(count: int, side: int, like: Tensor) -> "_Side":
        identity = torch.eye(side, dtype=like.dtype, device=like.device).repeat(count, 1, 1)
        return _Side(torch.zeros_like(identity), identity)

    def renew(self) -> Tensor:
        """Take one step of orthogonal iteration. Return the order [weights, side] of the former columns."""
        estimates = torch.einsum("kij,kil,klj->kj", self.basis, self.factor, self.basis)
        order = torch.argsort(estimates, dim=-1, descending=True, stable=True)
        sorted_basis = torch.gather(self.basis, 2, order[:, None].expand_as(self.basis))
        q, r = torch.linalg.qr(self.factor @ sorted_basis + self._least() * sorted_basis)
        # a QR decomposition is unique up to signs
        signs = torch.where(torch.diagonal(r, dim1=-2, dim2=-1) < 0, -1.0, 1.0)
        self.basis.copy_(q * signs[:, None])
        return order

    def start(self) -> None:
        """Set the basis to the eigenvectors, each with its largest component positive."""
        side = self.factor.shape[-1]
        ties = torch.linspace(1.0, 0.0, side, dtype=torch.float64, device=self.factor.device)
        parted = self.factor.double() + torch.diag_embed(self._least()[..., 0] * ties)
        vectors = torch.linalg.eigh(parted).eigenvectors.flip(-1)
        largest = torch.gather(vectors, 1, vectors.abs().argmax(dim=1, keepdim=True))
        self.basis.copy_(torch.where(largest < 0, -vectors, vectors))

    def _least(self) -> Float[Tensor, "weights 1 1"]:
        return LEAST * torch.diagonal(self.factor, dim1=-2, dim2=-1).mean(dim=-1)[:, None, None]


@dataclass
class _Group:
    """Matrices of one shape: their state, stacked."""

    weights: list[nn.Parameter]
    first: Stack
    """The mean of the gradient in the bases; `second` that of its square."""
    second: Stack
    left: _Side
    right: _Side

    @staticmethod
    def of(weights: list[nn.Parameter]) -> "_Group":
        like, count = weights[0].detach(), len(weights)
        zeros = torch.zeros((count, *like.shape), dtype=like.dtype, device=like.device)
        left, right = (_Side.of(count, side, like) for side in like.shape)
        return _Group(weights, zeros, zeros.clone(), left, right)

    def state(self) -> dict[str, Tensor]:
        sides = {"left": self.left, "right": self.right}
        factors = {f"{name}_factor": side.factor for name, side in sides.items()}
        bases = {f"{name}_basis": side.basis for name, side in sides.items()}
        return {"first": self.first, "second": self.second, **factors, **bases}

    def into(self, g: Stack) -> Stack:
        return self.left.basis.mT @ g @ self.right.basis

    def back(self, g: Stack) -> Stack:
        return self.left.basis @ g @ self.right.basis.mT

    def observe(self, g: Stack, beta: float) -> None:
        self.left.factor.lerp_(g @ g.mT, 1.0 - beta)
        self.right.factor.lerp_(g.mT @ g, 1.0 - beta)

    def renew(self) -> None:
        """Renew the bases. The mean of the gradient turns with them; the mean of its square is only reordered."""
        first = self.back(self.first)
        for side, axis in ((self.left, 1), (self.right, 2)):
            order = side.renew()
            order = order[:, :, None] if axis == 1 else order[:, None]
            self.second.copy_(torch.gather(self.second, axis, order.expand_as(self.second)))
        self.first.copy_(self.into(first))


class Soap:
    """SOAP over the weights of a method, whose gradients are in `grad`; a missing gradient counts as zero.

    As in the authors' implementation the first step only begins the factors.
    """

    def __init__(self, weights: Iterable[nn.Parameter], betas: tuple[float, float], renewed_every: int) -> None:
        self.betas, self.renewed_every, self.taken = betas, renewed_every, 0
        by_shape: dict[torch.Size, list[nn.Parameter]] = defaultdict(list)
        self._others: list[nn.Parameter] = []
        for weight in weights:
            (by_shape[weight.shape] if weight.ndim == 2 else self._others).append(weight)
        self._groups = [_Group.of(group) for group in by_shape.values()]
        flat = torch.cat([other.detach().reshape(-1) for other in self._others]) if self._others else torch.zeros(0)
        self._first, self._second = torch.zeros_like(flat), torch.zeros_like(flat)

    @torch.no_grad()
    def step(self, rate: float | Tensor) -> None:
        gradients = [torch.stack([_gradient(weight) for weight in group.weights]) for group in self._groups]
        for group, g in zip(self._groups, gradients, strict=True):
            group.observe(g, self.betas[1])
        if self.taken == 0:
            for group in self._groups:
                group.left.start()
                group.right.start()
        else:
            size = float(rate) * math.sqrt(1.0 - self.betas[1] ** self.taken) / (1.0 - self.betas[0] ** self.taken)
            for group, g in zip(self._groups, gradients, strict=True):
                moved = group.back(self._direction(group.first, group.second, group.into(g)))
                torch._foreach_add_(list[Tensor](group.weights), list(moved.unbind()), alpha=-size)
            if self._others:
                g = torch.cat([_gradient(weight).reshape(-1) for weight in self._others])
                parts = self._direction(self._first, self._second, g).split([w.numel() for w in self._others])
                for weight, part in zip(self._others, parts, strict=True):
                    weight.add_(part.reshape(weight.shape), alpha=-size)
            if self.taken % self.renewed_every == 0:
                for group in self._groups:
                    group.renew()
        self.taken += 1

    def _direction(self, first: Tensor, second: Tensor, g: Tensor) -> Tensor:
        first.lerp_(g, 1.0 - self.betas[0])
        second.mul_(self.betas[1]).addcmul_(g, g, value=1.0 - self.betas[1])
        return first / (second.sqrt() + EPSILON)

    def tensors(self) -> dict[str, Tensor]:
        groups = enumerate(self._groups)
        stacks = {f"{number}.{name}": value for number, group in groups for name, value in group.state().items()}
        return {**stacks, "first": self._first, "second": self._second, "taken": torch.tensor(self.taken)}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `tensors` returned; raises `KeyError` or `RuntimeError` for the state of other weights."""
        for name, value in self.tensors().items():
            if value.shape != tensors[name].shape:
                raise RuntimeError(f"{name} of {tuple(tensors[name].shape)}, not {tuple(value.shape)}")
            value.copy_(tensors[name])
        self.taken = int(tensors["taken"])


def _gradient(weight: nn.Parameter) -> Tensor:
    return torch.zeros_like(weight) if weight.grad is None else weight.grad
