"""O3: how many digits of a trained network are left in half precision, layer by layer."""

import math
from collections.abc import Iterator
from dataclasses import replace

import torch
from torch import Tensor

from baselines.field import NetworkField
from baselines.numerics.encoding import encode
from harness.chart_record import Series, Table
from harness.seeds import generator_for
from harness.stability.situation import Finding, Situation, whose
from harness.stability.small_training import new_trainer, not_made_of_parts, setup, trained
from harness.stability_record import Outcome, judged

DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
POINTS = 4096
COLOUR_BAR = 0.5 / 255
"""Half a step of an 8-bit picture; measured 5e-4 for bfloat16 and 5e-5 for float16."""


@torch.no_grad()
def layers(field: NetworkField, position: Tensor, dtype: torch.dtype, fed: list[Tensor] | None = None) -> list[Tensor]:
    """Rectified outputs of each density layer and the raw density, [points, width] each, products in `dtype`.

    With `fed`, the outputs of another precision, each layer gets that one's input instead of its own.
    """
    position = position.to(dtype)
    h, again, found = position, None, []
    for index, layer in enumerate([*field.density_net, field.density_head]):
        x = h if again is None else torch.cat([h, again], dim=-1)
        weight, bias = layer.weight.detach().to(dtype), layer.bias.detach().to(dtype)
        h = torch.nn.functional.linear(x, weight, bias)
        h = torch.relu(h) if index < len(field.density_net) else h
        found.append(h)
        h = h if fed is None else fed[index].to(dtype)
        again = position if index == field.skip else None
    return found


def digits(found: Tensor, truth: Tensor) -> float:
    """−log10 of the root mean square error relative to the truth's root mean square."""
    error = (found.double() - truth).square().mean().sqrt()
    return float(-torch.log10(error / truth.square().mean().sqrt()))


def digits_by_layer(situation: Situation) -> Iterator[Finding]:
    """O3: every method's trained network against its float64 twin, fed the same encoded positions."""
    rows: list[list[str | float | None]] = []
    for method in situation.methods:
        if reason := not_made_of_parts(method):
            yield Outcome("O3", method, whose(method), "not_applicable", why=reason)
            continue
        field = trained(situation, method).trainer.field
        points = torch.rand(256 if situation.quick else POINTS, 3, generator=generator_for("stability", "O3"))
        position = encode(field.box.normalised(field.box.from_unit(points)), field.base, field.position_bands)
        truth = layers(field, position, torch.float64)
        names = [f"layer {index + 1}" for index in range(len(truth) - 1)] + ["raw density"]
        exact = [digits(one, true) for one, true in zip(layers(field, position, torch.float32), truth, strict=True)]
        for name, dtype in DTYPES.items():
            through = [digits(a, b) for a, b in zip(layers(field, position, dtype), truth, strict=True)]
            alone = [digits(a, b) for a, b in zip(layers(field, position, dtype, fed=truth), truth, strict=True)]
            yield Series(
                f"Digits left in {method}, layer by layer", 7, name, "layer", "decimal digits",
                [float(index + 1) for index in range(len(truth))], through, log_x=False, log_y=False,
            )  # fmt: skip
            rows += [
                [method, name, layer, through[i], exact[i] - through[i], alone[i]] for i, layer in enumerate(names)
            ]
        yield from _seen(situation, method)
    columns = [
        "method",
        "products",
        "after",
        "digits left",
        "digits lost to float32",
        "digits left by this layer alone",
    ]
    yield Table("digits", 7, "Digits of a trained network, against its float64 twin fed the same", columns, rows)


def _seen(situation: Situation, method: str) -> Iterator[Finding]:
    """What is left of the loss in the picture: the same weights rendered with reduced products."""
    source = trained(situation, method).trainer
    rays = setup(situation).test.all_rays(0)
    exact = source.render(rays, len(rays)).colour
    for precision in ("bfloat16", "float16"):
        settings = replace(source.settings, precision=precision)
        twin = new_trainer(situation, method, settings)
        twin.fields.load_state_dict(source.fields.state_dict())
        twin.step, twin.grid = source.step, source.grid
        apart = twin.render(rays, len(rays)).colour - exact
        yield judged(
            "O3", f"{method}, {precision}", whose(method), math.sqrt(float(apart.square().mean())), COLOUR_BAR,
            what="root mean square change of a colour (0 … 1) that reduced products alone make",
            why=f"largest {float(apart.abs().max()):.2g}",
        )  # fmt: skip
