"""Encoding → MLP → density and colour: the network of Table 1 with replaceable parts.

Matrix multiplications run in the chosen precision on float32 master weights. All else runs in float32.
"""

import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pkgutil import resolve_name
from typing import Any, cast

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn.functional import linear, pad

from baselines.amplifiers import AMPLIFIERS, Amplifier, MeanAmplifier
from baselines.catalog import Method
from baselines.composition import ACTIVATIONS, LADDERS, Parts, skip_layer
from baselines.contract import (
    DTYPES,
    Box,
    Densities,
    FieldSpec,
    NetworkSize,
    Points,
    Precision,
    RayOf,
    Views,
    counts_by_component,
    glorot,
)
from baselines.numerics.encoding import encode, feature_count, features_at, frequency_ladder

ROWS_MULTIPLE = 1024
"""In reduced precision, the number of points is padded to a multiple of this: the processor's library builds and keeps
a kernel for each new shape, which takes longer than the multiplication.
"""


SIDE = 8
"""Sides of matrices are padded to a multiple of this where a GPU multiplies them: 16 bytes in half precision."""


class NetworkField(nn.Module):
    """A radiance field held by one MLP (`baselines.contract.RadianceField`).

    The concatenations of Listing 3 and of the view direction are not built: each matrix is applied to the two halves
    separately. The result is the same, and the direction's half is computed once per ray. Where a scene looks the same
    from all sides (`view_dependent` False), colour does not depend on the direction.
    """

    amplifier: Amplifier
    position_omega: Tensor
    direction_omega: Tensor

    def __init__(
        self,
        parts: Parts,
        size: NetworkSize,
        box: Box,
        precision: Precision,
        seed: int | str,
        view_dependent: bool = True,
    ) -> None:
        super().__init__()
        size = parts.size(size)
        self.activation = ACTIVATIONS[parts.activation]
        self.box = box
        self.dtype = DTYPES[precision]
        ladder = LADDERS[parts.encoding]
        self.base = ladder.base
        self.in_scene_units = parts.coordinates == "scene"
        self.position_bands = ladder.bands(size.position_bands)
        self.direction_bands = ladder.bands(size.direction_bands)
        self.view_dependent = view_dependent and parts.sees_direction
        position = feature_count(3, self.position_bands)
        direction = feature_count(3, self.direction_bands) if self.view_dependent else 0
        self.skip = skip_layer(parts.skip, size.depth)

        widths = [size.width + position * (i == self.skip) for i in range(size.depth)]
        self.density_net = nn.ModuleList(nn.Linear(inputs, size.width) for inputs in [position, *widths[:-1]])
        self.density_head = nn.Linear(widths[-1], 1)
        colour_widths = [widths[-1] + direction] + [size.colour_width] * size.colour_layers
        self.colour_net = nn.ModuleList(
            nn.Linear(inputs, outputs) for inputs, outputs in zip(colour_widths, [*colour_widths[1:], 3], strict=True)
        )
        self.amplifier = AMPLIFIERS[parts.amplifier](parts.start_in_units)
        self.density_unit = parts.density_unit(box)
        # for `_outputs_of_rays`: the angular frequencies as `encode` rounds them, on the device of the weights
        for name, bands in (("position", self.position_bands), ("direction", self.direction_bands)):
            omega = (math.pi * frequency_ladder(self.base, bands, torch.float32)).to(torch.float32)
            self.register_buffer(f"{name}_omega", omega, persistent=False)
        # the amplifier keeps the paper's α and β
        glorot((named for named in self.named_parameters() if not named[0].startswith("amplifier")), seed)

    def parameter_counts(self) -> dict[str, int]:
        return counts_by_component(self)

    @property
    def pointwise(self) -> bool:
        return self.amplifier.pointwise

    @property
    def density_limit(self) -> float:
        return self.density_unit if self.amplifier.bounded else math.inf

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Views:
        if not self.view_dependent:
            return d[:, :0]
        return encode(self.direction_coordinates(d), self.base, self.direction_bands)

    def density(self, x: Points) -> Densities:
        return self.density_before_and_after(x)[1]

    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        before, after = self.amplifier.before_and_after(self._outputs(x, None, None)[0])
        return before * self.density_unit, after * self.density_unit

    def density_and_colour(
        self, x: Points, view: Views, ray: RayOf, counted: Bool[Tensor, " points"] | None = None
    ) -> tuple[Densities, Float[Tensor, "points 3"]]:
        """Return density and colour; with `counted`, the other points only fill a fixed shape."""
        raw, logits = self._outputs(x, view, ray)
        assert logits is not None
        return self._rendered(raw, counted), torch.sigmoid(logits)

    def density_and_colour_of_rays(
        self, x: Float[Tensor, "rays points 3"], d: Float[Tensor, "rays 3"], counted: Bool[Tensor, "rays points"]
    ) -> tuple[Float[Tensor, "rays points"], Float[Tensor, "rays points 3"]]:
        """Return `density_and_colour` of all points of all rays, to rounding: in fewer and aligned multiplications."""
        raw, logits = self._outputs_of_rays(x, d)
        sigma = self._rendered(raw.reshape(-1), counted.reshape(-1))
        return sigma.unflatten(0, counted.shape), torch.sigmoid(logits)

    def _rendered(self, raw: Tensor, counted: Tensor | None) -> Tensor:
        own = counted is None or not isinstance(self.amplifier, MeanAmplifier)
        density = self.amplifier.rendered(raw) if own else self.amplifier.rendered(raw, counted)
        return density * self.density_unit

    @torch.no_grad()
    def dead_units(self) -> dict[str, float]:
        """Return the share of units of each density layer that are 0 at all `SPREAD_POINTS`: they get no gradient."""
        spread = self.box.from_unit(_evenly_spread().to(self.box.lower))
        layers = self._hidden(self._encoded(spread).to(self.dtype))
        return {f"density_net.{index}": float((hidden == 0).all(dim=0).float().mean()) for index, hidden in layers}

    def coordinates(self, x: Points) -> Points:
        """Return the numbers whose sines are taken: times π, normalised by the box or in scene units."""
        return x / math.pi if self.in_scene_units else self.box.normalised(x)

    def direction_coordinates(self, d: Float[Tensor, "rays 3"]) -> Float[Tensor, "rays 3"]:
        return d / math.pi if self.in_scene_units else d

    def _encoded(self, x: Tensor) -> Tensor:
        return encode(self.coordinates(x), self.base, self.position_bands)

    def _outputs(self, x: Tensor, view: Tensor | None, ray: Tensor | None) -> tuple[Tensor, Tensor | None]:
        """Return raw density [points] and, with a view, colour logits [points, 3], both float32 as the weights are."""
        count = len(x)
        if self.dtype.itemsize < 4 and x.device.type == "cpu":
            missing = -count % ROWS_MULTIPLE
            x = pad(x, (0, 0, 0, missing))
            ray = None if ray is None else pad(ray, (0, missing))
        position = self._encoded(x).to(self.dtype, memory_format=torch.contiguous_format)
        *_, (last, hidden) = self._hidden(position)
        skipped = position if last == self.skip else None
        raw = self._split_linear(self.density_head, hidden, skipped)[:count, 0].to(self.density_head.weight.dtype)
        if view is None or ray is None:
            return raw, None
        first, *others = _linears(self.colour_net)
        for_view = first.weight.to(self.dtype)[:, first.in_features - view.shape[-1] :]
        # in full precision, as its gradient is a sum over the points of a ray
        of_view = linear(view.to(self.dtype), for_view, first.bias.to(self.dtype)).to(raw.dtype)
        h = self._split_linear(first, hidden, skipped, with_bias=False) + of_view.index_select(0, ray)
        for layer in others:
            h = linear(self.activation(h).to(self.dtype), layer.weight.to(self.dtype), layer.bias.to(self.dtype))
        return raw, h[:count].to(raw.dtype)

    def _outputs_of_rays(self, x: Tensor, d: Tensor) -> tuple[Tensor, Tensor]:
        """Return `_outputs` of points on rays [rays, points, …], in matrix multiplications with aligned sides.

        The matrix units of a GPU need sides that are multiples of 8, and few large multiplications rather than many
        small ones: inputs are padded with zeros, the density head and the first colour layer are one matrix, and the
        direction's part of that layer is added ray by ray. No value is cached between calls.
        """
        dtype, shape = self.dtype, x.shape[:2]
        position = features_at(self.coordinates(x.reshape(-1, 3)), self.position_omega).to(dtype)
        view = features_at(self.direction_coordinates(d), self.direction_omega) if self.view_dependent else d[:, :0]
        hidden = position
        for index, layer in enumerate(_linears(self.density_net)):
            hidden = self.activation(linear(_padded(hidden), _padded(layer.weight).to(dtype), layer.bias.to(dtype)))
            if index == self.skip:
                hidden = torch.cat([hidden, position], dim=-1)
        first, *others = _linears(self.colour_net)
        seen = self.density_head.in_features
        heads = torch.cat([first.weight[:, :seen], self.density_head.weight])
        both = linear(_padded(hidden), _padded(_padded(heads), rows=True).to(dtype))
        colours = first.out_features
        of_view = linear(view.to(dtype), first.weight[:, seen:].to(dtype), first.bias.to(dtype)).to(first.weight.dtype)
        h = both[:, :colours].unflatten(0, shape) + of_view.unsqueeze(1)
        for layer in others:
            weight, bias = _padded(_padded(layer.weight), rows=True), _padded(layer.bias)
            h = linear(_padded(self.activation(h)).to(dtype), weight.to(dtype), bias.to(dtype))[
                ..., : layer.out_features
            ]
        raw = both[:, colours].to(first.weight.dtype) + self.density_head.bias
        return raw.unflatten(0, shape), h.to(first.weight.dtype)

    def _hidden(self, position: Tensor) -> Iterator[tuple[int, Tensor]]:
        """Yield the outputs of the layers of the density network, [points, width] each."""
        hidden, skipped = position, None
        for index, layer in enumerate(_linears(self.density_net)):
            hidden = self.activation(self._split_linear(layer, hidden, skipped))
            skipped = position if index == self.skip else None
            yield index, hidden

    def _split_linear(self, layer: nn.Linear, hidden: Tensor, skipped: Tensor | None, with_bias: bool = True) -> Tensor:
        """Apply `layer` to [hidden, skipped, …]; the caller applies further columns of its weight."""
        weight = layer.weight.to(self.dtype)
        bias = layer.bias.to(self.dtype) if with_bias else None
        width = hidden.shape[-1]
        result = linear(hidden, weight[:, :width], bias)
        if skipped is None:
            return result
        return result + linear(skipped, weight[:, width : width + skipped.shape[-1]])


def field_of(method: Method, spec: FieldSpec) -> Any:
    """Return a fresh `NetworkField` or the module of `make_field`. Raises `ValueError` if the method has neither."""
    if method.make_field is not None:
        make = method.make_field
        return (resolve_name(make) if isinstance(make, str) else make)(spec)
    if not isinstance(spec.own, Parts):
        raise ValueError(f"{method.title}: it is not made of parts; it has its own trainer")
    return NetworkField(spec.own, spec.size, spec.box, spec.precision, spec.seed, spec.view_dependent)


@contextmanager
def training_step(fields: Iterable[nn.Module]) -> Iterator[None]:
    """Enclose a training step: only its evaluations move the running means of density, unless an error ends it."""
    amplifiers = [
        field.amplifier
        for field in fields
        if isinstance(field, NetworkField) and isinstance(field.amplifier, MeanAmplifier)
    ]
    for amplifier in amplifiers:
        amplifier.mean.begin()
    try:
        yield
    except BaseException:
        for amplifier in amplifiers:
            amplifier.mean.drop()
        raise
    for amplifier in amplifiers:
        amplifier.update_mean()


SPREAD_POINTS = 512
"""The number of points at which `NetworkField.dead_units` evaluates the layers."""


@cache
def _evenly_spread() -> Float[Tensor, "points 3"]:
    return torch.quasirandom.SobolEngine(3).draw(SPREAD_POINTS)


def _padded(matrix: Tensor, rows: bool = False) -> Tensor:
    """Return the matrix with its last axis, or its rows, padded with zeros to a multiple of `SIDE`."""
    missing = -matrix.shape[0 if rows else -1] % SIDE
    return pad(matrix, (0, 0, 0, missing) if rows else (0, missing)) if missing else matrix


def _linears(layers: nn.ModuleList) -> list[nn.Linear]:
    return cast("list[nn.Linear]", list(layers))
