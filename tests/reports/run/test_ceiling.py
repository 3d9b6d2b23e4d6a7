"""The lines about the ceiling of density on the first screen."""

import pytest

from reports.data.load import Records
from reports.run.ceiling import ceilings
from reports.run.run_page import page
from tests.replacing import replace


def with_properties(records: Records, **by_method: dict[str, list[float | None]]) -> Records:
    """Return the run with these properties of its cells, the values of a list in turn."""
    cells = []
    for place, cell in enumerate(records.cells):
        own = by_method.get(cell.method, {})
        given = {name: values[place % len(values)] for name, values in own.items()}
        cells.append(replace(cell, properties={**cell.properties, **given}))
    return replace(records, cells=cells)


UNBOUNDED = {"density_limit": [None], "opacity_of_a_pixel": [1.0], "weight_at_ceiling": [0.0]}


def bounded(limit: float, *opacities: float, share: float = 0.25) -> dict[str, list[float | None]]:
    return {"density_limit": [limit], "opacity_of_a_pixel": list(opacities), "weight_at_ceiling": [share]}


def test_a_constant_that_limits_a_method_is_named(whole: Records) -> None:
    assert ceilings(whole) == [], "no record has the properties"
    (line,) = ceilings(with_properties(whole, nerf=UNBOUNDED, qnerf=bounded(25.0, 0.38)))
    cells = sum(cell.method == "qnerf" for cell in whole.cells)
    assert line == (
        "qnerf: at its largest density, 25 per half box, geometry one pixel thick has an opacity of 0.38; "
        f"25.0\u202f% of the weight of its pictures is at this ceiling ({cells} cells). "
        "The constant, a unit of density of 25 per half box, limits qnerf at this resolution."
    )


@pytest.mark.parametrize(("opacities", "limits"), [((0.9899, 0.9999), True), ((0.99, 0.9999), False)])
def test_the_thinnest_cell_decides_whether_it_limits(
    whole: Records, opacities: tuple[float, ...], limits: bool
) -> None:
    (line,) = ceilings(with_properties(whole, qnerf=bounded(250.0, *opacities)))
    assert line.endswith("limits qnerf at this resolution.") == limits
    assert f"an opacity of {'0.9899' if limits else '0.9900'} to 0.9999;" in line


def test_the_page_has_the_lines_below_the_headline(whole: Records, whole_page: str) -> None:
    text = page(with_properties(whole, qnerf=bounded(25.0, 0.38)))
    assert text.index("<h1>") < text.index("<dt>Ceiling</dt>") < text.index("<dt>Scale</dt>")
    assert "<dt>Ceiling</dt>" not in whole_page
