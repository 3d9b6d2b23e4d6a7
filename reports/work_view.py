"""Work–precision diagrams → what the page shows: a choice of error and axis that needs no script."""

from dataclasses import dataclass

from markupsafe import Markup

from reports.figure import svg
from reports.load import Records
from reports.work_precision import Cost, Measure, diagrams


@dataclass(frozen=True)
class Plot:
    title: str
    svg: Markup
    notes: list[str]


@dataclass(frozen=True)
class Choice:
    """What is seen when its measure and its cost are chosen."""

    measure: Measure
    cost: Cost
    plots: list[Plot]

    @property
    def name(self) -> str:
        return f"{self.measure.name}-{self.cost.name}"


@dataclass(frozen=True)
class Work:
    measures: list[Measure]
    costs: list[Cost]
    choices: list[Choice]
    """Of these, those for which the records know enough."""

    @property
    def rules(self) -> Markup:
        """The style that shows what is chosen, and what is missing where nothing can be shown for it."""
        known = {one.name for one in self.choices}
        pairs = [f"{measure.name}-{cost.name}" for measure in self.measures for cost in self.costs]
        shown = [_chosen(name) + f" .{name if name in known else 'unknown'}" for name in pairs]
        return Markup(f"{','.join(shown)}{{display:block}}\n")


def work(records: Records) -> Work | None:
    """None where no cell has a curve."""
    made = diagrams(records)
    choices = [
        Choice(
            one.measure,
            one.cost,
            [
                Plot(panel.title, svg(panel, f"{one.measure.name}-{one.cost.name}-{place}"), notes)
                for place, (panel, notes) in enumerate(zip(one.panels, one.notes, strict=True))
            ],
        )
        for one in made
    ]
    if not choices:
        return None
    return Work(
        list(dict.fromkeys(one.measure for one in choices)), list(dict.fromkeys(one.cost for one in choices)), choices
    )


def _chosen(name: str) -> str:
    measure, _, cost = name.partition("-")
    return f'.chooser:has([name=measure][value="{measure}"]:checked):has([name=cost][value="{cost}"]:checked)'
