"""The ceiling of density: how opaque geometry one pixel thick can be, and how much of a picture is at the ceiling."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean

from reports.data.load import Records
from reports.data.wording import NARROW, bare, counted, number

OPAQUE = 0.99
"""The opacity of geometry one pixel thick below which a method's constant limits it."""
Properties = Mapping[str, float | str | None]


def ceilings(records: Records) -> list[str]:
    """Return a line for each bounded method; no line for records without the properties."""
    return lines_of(
        (method, [cell.properties for cell in records.cells if cell.method == method]) for method in records.methods
    )


def lines_of(methods: Iterable[tuple[str, Sequence[Properties]]]) -> list[str]:
    lines = []
    for method, cells in methods:
        opacities, limits, shares = (
            [float(cell[name] or 0.0) for cell in cells if cell.get(name) is not None]
            for name in ("opacity_of_a_pixel", "density_limit", "weight_at_ceiling")
        )
        if limits and opacities:
            lines.append(_line(method, opacities, limits, shares))
    return lines


def _line(method: str, opacities: list[float], limits: list[float], shares: list[float]) -> str:
    limit = f"{_between(limits, lambda value: bare(float(f'{value:.3g}')))} per half box"
    line = f"{method}: at its largest density, {limit}, geometry one pixel thick has an opacity of "
    line += _between(opacities, _opacity)
    if shares:
        line += f"; {number(100 * fmean(shares), 1)}{NARROW}% of the weight of its pictures is at this ceiling"
    line += f" ({counted(len(limits), 'cell')})."
    if min(opacities) < OPAQUE:
        line += f" The constant, a unit of density of {limit}, limits {method} at this resolution."
    return line


def _opacity(value: float) -> str:
    """Format with four digits near `OPAQUE`, so that the value does not round to it."""
    return number(value, 2 if value < OPAQUE - 0.01 else 4)


def _between(values: list[float], text: Callable[[float], str]) -> str:
    low, high = text(min(values)), text(max(values))
    return low if low == high else f"{low} to {high}"
