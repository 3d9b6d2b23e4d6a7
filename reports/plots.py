"""Panels → titled drawings for a page."""

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup

from reports.figure import svg
from reports.trace_data import Panel


@dataclass(frozen=True)
class Plot:
    title: str
    svg: Markup


def plots(panels: Iterable[Panel], name: str) -> list[Plot]:
    """`name` makes their ids unique on the page and is of letters, digits and dashes."""
    return [Plot(panel.title, svg(panel, f"{name}-{place}")) for place, panel in enumerate(panels)]
