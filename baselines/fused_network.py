"""The network's forward and backward pass written out by hand, in blocks of points that stay in the processor's cache.

Autograd keeps a copy of every intermediate and walks over all points once for each operation. Here one block of points
goes through all layers before the next one, activations are rectified in place, and weight gradients add up in place.
It computes what `baselines.field` composes from single operations (its oracle in the tests); only the order of sums
over points differs. The gradient of the position is computed if learnt features need it.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

_Result = TypeVar("_Result")

BLOCK_BYTES = 1 << 21
"""The bytes of one layer's activations in a block: a few such layers fit a core's second-level cache."""
ROWS_MULTIPLE = 1024
"""Blocks in reduced precision have a multiple of this number of rows. The CPU library builds and keeps a kernel for
each new shape, which takes longer than the multiplication, so that few shapes should occur.
"""


@dataclass(frozen=True)
class Layout:
    """The order of the flat list of weights: W, b of each density layer, of the density head, of each colour layer."""

    depth: int
    skip: int
    """The density layer to whose output the encoded position is concatenated."""
    dtype: torch.dtype
    """The type of matrix multiplications; everything that adds up over points is float32 or better."""


def evaluate(
    layout: Layout,
    position: Float[Tensor, "points features"],
    view: Float[Tensor, "rays directions"] | None,
    ray: Int[Tensor, " points"] | None,
    weights: list[Tensor],
) -> tuple[Float[Tensor, " points"], Float[Tensor, "points 3"] | None]:
    """Return raw density and colour logits in float32 or better, differentiable once with respect to `weights` and
    `position`. Without a `view` only the density is computed, without gradient. `ray`: row of `view` per point.
    """
    count = len(position)
    if layout.dtype.itemsize < 4 and position.device.type == "cpu":
        missing = -count % ROWS_MULTIPLE
        position = torch.nn.functional.pad(position, (0, 0, 0, missing))
        ray = None if ray is None else torch.nn.functional.pad(ray, (0, missing))
    if view is not None and torch.is_grad_enabled() and any(weight.requires_grad for weight in weights):
        raw, logits = _Evaluation.apply(layout, position, view, ray, *weights)
    else:
        raw, logits, _ = _forward(_prepared(layout, position.shape[1], weights), position, view, ray, keep=False)
    return raw[:count], None if logits is None else logits[:count]


@dataclass(frozen=True)
class _Stage:
    """The weights of one multiplication, or the sums of their gradient: `hidden` for the layer before, `again` for the
    encoded position where it enters.
    """

    hidden: Tensor
    bias: Tensor
    again: Tensor | None = None

    def zeros(self) -> "_Stage":
        sums = _sums(self.bias.dtype)
        hidden, bias = (part.new_zeros(part.shape, dtype=sums) for part in (self.hidden, self.bias))
        return _Stage(hidden, bias, None if self.again is None else self.again.new_zeros(self.again.shape, dtype=sums))

    def add(self, gradient: Tensor, x: Tensor, position: Tensor) -> None:
        _add_matmul(self.hidden, gradient, x)
        if self.again is not None:
            _add_matmul(self.again, gradient, position)
        self.bias.add_(gradient.sum(dim=0, dtype=self.bias.dtype))

    def merge(self, other: "_Stage") -> None:
        self.hidden.add_(other.hidden)
        if self.again is not None and other.again is not None:
            self.again.add_(other.again)
        self.bias.add_(other.bias)

    def weight(self) -> Tensor:
        return self.hidden if self.again is None else torch.cat([self.hidden, self.again], dim=1)


@dataclass(frozen=True)
class _Prepared:
    density: list[_Stage]
    heads: _Stage
    """The density head (column 0) and the first colour layer without its direction part in one multiplication."""
    direction: _Stage
    colour: list[_Stage]
    dtype: torch.dtype
    sums: torch.dtype


def _prepared(layout: Layout, features: int, weights: list[Tensor]) -> _Prepared:
    cast = [weight.detach().to(layout.dtype) for weight in weights]
    pairs = list(zip(cast[::2], cast[1::2], strict=True))
    density, head, colour = pairs[: layout.depth], pairs[layout.depth], pairs[layout.depth + 1 :]
    stages = []
    for index, (weight, bias) in enumerate(density):
        cut = weight.shape[1] - features if index == layout.skip + 1 else weight.shape[1]
        stages.append(_stage(weight, bias, cut))
    inputs = head[0].shape[1]
    first, first_bias = colour[0]
    heads = torch.cat([head[0], first[:, :inputs]])
    bias = torch.cat([head[1], torch.zeros_like(first_bias)])  # the first colour layer's bias is added once per ray
    cut = inputs - features if layout.skip == layout.depth - 1 else inputs
    return _Prepared(
        density=stages,
        heads=_stage(heads, bias, cut),
        direction=_Stage(first[:, inputs:], first_bias),
        colour=[_Stage(weight, bias) for weight, bias in colour[1:]],
        dtype=layout.dtype,
        sums=_sums(layout.dtype),
    )


def _sums(dtype: torch.dtype) -> torch.dtype:
    return torch.promote_types(dtype, torch.float32)


def _stage(weight: Tensor, bias: Tensor, cut: int) -> _Stage:
    again = weight[:, cut:] if cut < weight.shape[1] else None
    return _Stage(weight[:, :cut], bias, again)


@dataclass(frozen=True)
class _Kept:
    """The rectified activations [points, width] of each layer, kept for the backward pass."""

    density: list[Tensor]
    colour: list[Tensor]


def _blocks(points: int, width: int, like: Tensor) -> list[slice]:
    if like.device.type != "cpu":
        return [slice(0, points)]
    rows = max(ROWS_MULTIPLE, BLOCK_BYTES // (width * like.element_size()) // ROWS_MULTIPLE * ROWS_MULTIPLE)
    return [slice(start, min(start + rows, points)) for start in range(0, points, rows)]


def _side_by_side(through: Callable[[list[slice]], _Result], blocks: list[slice]) -> list[_Result]:
    """Run `through` on the blocks, one thread per core: blocks do not wait for each other, while a multiplication that
    is shared between cores ends with the slowest core. If there are few blocks, this thread runs them all.
    """
    threads = torch.get_num_threads() if blocks else 0
    if threads < 2 or len(blocks) < 4 * threads:
        return [through(blocks)] if blocks else []
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(threads) as pool:
            # whether gradients are recorded is a setting of each thread
            return list(pool.map(torch.no_grad()(through), [blocks[first::threads] for first in range(threads)]))
    finally:
        torch.set_num_threads(threads)


def _apply(stage: _Stage, x: Tensor, position: Tensor, out: Tensor) -> Tensor:
    torch.addmm(stage.bias, x, stage.hidden.t(), out=out)
    if stage.again is not None:
        out.addmm_(position, stage.again.t())
    return out


def _forward(
    net: _Prepared, position: Tensor, view: Tensor | None, ray: Tensor | None, keep: bool
) -> tuple[Tensor, Tensor | None, _Kept]:
    """Run every block through every layer. Without `keep`, each block overwrites the activations of the last one."""
    count, points = len(position), position.to(net.dtype)
    width, colour_width = net.density[0].hidden.shape[0], net.heads.hidden.shape[0] - 1
    blocks = _blocks(count, width, points)
    kept = _Kept(
        [points.new_empty((count, width)) for _ in net.density] if keep else [],
        [points.new_empty((count, stage.hidden.shape[1])) for stage in net.colour] if keep else [],
    )
    raw = points.new_empty(count, dtype=net.sums)
    logits = None if view is None else points.new_empty((count, 3), dtype=net.sums)
    of_view = None
    if view is not None:
        of_view = torch.addmm(net.direction.bias, view.to(net.dtype), net.direction.hidden.t())

    def through(mine: list[slice]) -> None:
        largest = mine[0].stop - mine[0].start
        heads_of_block = points.new_empty((largest, colour_width + 1))
        spare = [points.new_empty((0 if keep else largest, width)) for _ in range(2)]
        for block in mine:
            size = block.stop - block.start
            here = h = points[block]
            for index, stage in enumerate(net.density):
                out = kept.density[index][block] if keep else spare[index % 2][:size]
                h = _apply(stage, h, here, out).clamp_min_(0.0)
            if of_view is None or logits is None or ray is None:
                again = None if net.heads.again is None else net.heads.again[:1]
                density_head = _Stage(net.heads.hidden[:1], net.heads.bias[:1], again)
                raw[block] = _apply(density_head, h, here, heads_of_block[:size, :1])[:, 0]
                continue
            heads = _apply(net.heads, h, here, heads_of_block[:size])
            raw[block] = heads[:, 0]
            c = of_view.index_select(0, ray[block]).add_(heads[:, 1:])
            for index, stage in enumerate(net.colour):
                c = torch.clamp_min(c, 0.0, out=kept.colour[index][block]) if keep else c.clamp_min_(0.0)
                c = torch.addmm(stage.bias, c, stage.hidden.t())
            logits[block] = c

    _side_by_side(through, blocks)
    return raw, logits, kept


def _add_matmul(total: Tensor, a: Tensor, b: Tensor) -> None:
    if a.dtype == total.dtype:
        total.addmm_(a.t(), b)
    else:
        total.add_(torch.mm(a.t(), b))


class _Evaluation(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, layout: Layout, position: Tensor, view: Tensor, ray: Tensor, *weights: Tensor
    ) -> tuple[Tensor, Tensor]:
        net = _prepared(layout, position.shape[1], list(weights))
        raw, logits, kept = _forward(net, position, view, ray, keep=True)
        assert logits is not None
        ctx.net, ctx.kept = net, kept
        ctx.save_for_backward(position, view, ray)
        return raw, logits

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        position, view, ray = ctx.saved_tensors
        (g_raw, g_logits), net, kept = gradients, ctx.net, ctx.kept
        del ctx.net, ctx.kept
        blocks = _blocks(len(position), net.density[0].hidden.shape[0], kept.density[0])
        g_position = torch.zeros_like(position, dtype=net.dtype) if ctx.needs_input_grad[1] else None
        shares = _side_by_side(
            partial(_way_back, net, kept, position.to(net.dtype), view, ray, g_raw, g_logits, g_position), blocks
        )
        total = shares[0] if shares else _Gradients(net, len(view))
        for share in shares[1:]:
            total.add(share)
        g_position = None if g_position is None else g_position.to(position.dtype)
        return None, g_position, None, None, *total.flat(view.to(net.sums))


class _Gradients:
    def __init__(self, net: _Prepared, rays: int) -> None:
        self.density = [stage.zeros() for stage in net.density]
        self.heads = net.heads.zeros()
        self.colour = [stage.zeros() for stage in net.colour]
        self.of_view = net.heads.hidden.new_zeros((rays, net.direction.hidden.shape[0]), dtype=net.sums)

    def add(self, other: "_Gradients") -> None:
        for mine, theirs in zip(self._stages(), other._stages(), strict=True):
            mine.merge(theirs)
        self.of_view.add_(other.of_view)

    def _stages(self) -> list[_Stage]:
        return [*self.density, self.heads, *self.colour]

    def flat(self, view: Tensor) -> list[Tensor]:
        heads, bias = self.heads.weight(), self.heads.bias
        direction = torch.mm(self.of_view.t(), view)
        flat = [part for stage in self.density for part in (stage.weight(), stage.bias)]
        flat += [heads[:1], bias[:1], torch.cat([heads[1:], direction], dim=1), self.of_view.sum(dim=0)]
        return flat + [part for stage in self.colour for part in (stage.weight(), stage.bias)]


def _way_back(
    net: _Prepared,
    kept: _Kept,
    points: Tensor,
    view: Tensor,
    ray: Tensor,
    g_raw: Tensor,
    g_logits: Tensor,
    g_position: Tensor | None,
    blocks: list[slice],
) -> _Gradients:
    """Return the sums over `blocks` and fill `g_position`, if there is one."""
    rectified = torch.ops.aten.threshold_backward.grad_input
    sums = _Gradients(net, len(view))
    largest = blocks[0].stop - blocks[0].start
    to_heads = points.new_empty((largest, net.heads.hidden.shape[0]))
    buffers = [points.new_empty((largest, kept.density[0].shape[1])) for _ in range(2)]
    for block in blocks:
        size, here = block.stop - block.start, points[block]
        g = g_logits[block].to(net.dtype)
        for index in reversed(range(len(net.colour))):
            x = kept.colour[index][block]
            sums.colour[index].add(g, x, here)
            g = torch.mm(g, net.colour[index].hidden)
            rectified(g, x, 0.0, grad_input=g)
        sums.of_view.index_add_(0, ray[block], g.to(net.sums))
        into = to_heads[:size]
        into[:, 0] = g_raw[block]
        into[:, 1:] = g
        sums.heads.add(into, kept.density[-1][block], here)
        if g_position is not None and net.heads.again is not None:
            g_position[block].addmm_(into, net.heads.again)
        g = torch.mm(into, net.heads.hidden, out=buffers[0][:size])
        for index in reversed(range(len(net.density))):
            rectified(g, kept.density[index][block], 0.0, grad_input=g)
            stage = net.density[index]
            sums.density[index].add(g, kept.density[index - 1][block] if index else here, here)
            if g_position is not None and (to_position := stage.again if index else stage.hidden) is not None:
                g_position[block].addmm_(g, to_position)
            if index:
                g = torch.mm(g, stage.hidden, out=buffers[(len(net.density) - index) % 2][:size])
    return sums
