"""The ceiling of density: how opaque geometry one pixel thick can be in each bounded method of a run, and how much of
its pictures comes from densities there.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean

from reports.data.load import Records
from reports.data.wording import NARROW, bare, counted, number

OPAQUE = 0.99
"""The opacity of geometry one pixel thick below which a method's constant limits it."""


Properties = Mapping[str, float | str | None]
"""Those of a cell, by name."""


def ceilings(records: Records) -> list[str]:
    """Return one line for each bounded method; none for records that lack the properties."""
    return lines_of(
        (method, [cell.properties for cell in records.cells if cell.method == method]) for method in records.methods
    )


def lines_of(methods: Iterable[tuple[str, Sequence[Properties]]]) -> list[str]:
    """Return the line of each bounded method, from its name and the properties of its cells."""
    lines = (_ceiling(method, cells) for method, cells in methods)
    return [line for line in lines if line]


def _ceiling(method: str, cells: Sequence[Properties]) -> str:
    opacities, limits, shares = (
        [float(cell[name] or 0.0) for cell in cells if cell.get(name) is not None]
        for name in ("opacity_of_a_pixel", "density_limit", "weight_at_ceiling")
    )
    if not limits or not opacities:
        return ""
    limit = f"{_between(limits, lambda value: bare(float(f'{value:.3g}')))} per half box"
    weight = f"; {number(100 * fmean(shares), 1)}{NARROW}% of the weight of its pictures is at this ceiling"
    line = (
        f"{method}: at its largest density, {limit}, geometry one pixel thick has an opacity of "
        f"{_between(opacities, _opacity)}{weight if shares else ''} ({counted(len(limits), 'cell')})."
    )
    if min(opacities) < OPAQUE:
        line += f" The constant, a unit of density of {limit}, limits {method} at this resolution."
    return line


def _opacity(value: float) -> str:
    """Format with the digits that tell a value near `OPAQUE` from it."""
    return number(value, 2 if value < OPAQUE - 0.01 else 4)


def _between(values: list[float], text: Callable[[float], str]) -> str:
    low, high = text(min(values)), text(max(values))
    return low if low == high else f"{low} to {high}"
