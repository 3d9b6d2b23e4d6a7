"""Several outputs → outputs.html, in the same design as the report and as self-contained."""

from pathlib import Path
from typing import Any

from markupsafe import Markup

from reports import palette, shell
from reports.load import Records
from reports.outputs import against, named
from reports.outputs_view import (
    claims_grid,
    curves,
    facts_grids,
    headline,
    methods_of,
    metrics_grid,
    scores_grid,
    seconds_grid,
    sentences,
    verdicts_grid,
)
from reports.page import named as in_colours
from reports.plots import plots
from reports.script import content_policy

SECTIONS = (
    ("scores", "Scores"),
    ("verdicts", "Does the answer change?"),
    ("curves", "Convergence"),
    ("metrics", "Other scores"),
    ("seconds", "Training time"),
    ("facts", "What differs"),
)
LOOKS = ("solid:", "dashed:", "dotted:", "dash-dotted:")


def outputs_page(found: list[Records]) -> str:
    """The whole page as text; the first output is what the others are held against."""
    outputs = named(found)
    pairs = [against(outputs[0], other) for other in outputs[1:]]
    methods = methods_of(outputs)
    environment = shell.environment()
    colours = palette.colours_of(methods)
    environment.filters["named"] = lambda text: in_colours(text, colours)
    content: dict[str, Any] = {
        "scores": [scores_grid(outputs, pairs, method) for method in methods],
        "verdicts": verdicts_grid(outputs),
        "claims": claims_grid(outputs),
        "metrics": metrics_grid(outputs, pairs),
        "seconds": seconds_grid(outputs),
        "facts": facts_grids(outputs),
    }
    drawn = plots(curves(outputs), "curves")
    there = {"verdicts": content["verdicts"].rows, "curves": drawn, "metrics": content["metrics"].rows}
    return environment.get_template("outputs_page.html").render(
        **content,
        policy=content_policy(shell.code()),
        script=Markup(shell.code()),
        style=shell.style("page.css", "explore.css"),
        title=headline(outputs[0], pairs),
        sentences=sentences(outputs[0], pairs),
        sections=[(name, title) for name, title in SECTIONS if there.get(name, True)],
        colours=colours,
        methods=methods,
        outputs=outputs,
        plots=drawn,
        looks=[(one, LOOKS[place % len(LOOKS)]) for place, one in enumerate(outputs)],
    )


def write_outputs_page(found: list[Records], path: Path) -> str:
    """Beside its place, then renamed; gives the headline."""
    shell.write_whole(outputs_page(found), path)
    outputs = named(found)
    return headline(outputs[0], [against(outputs[0], other) for other in outputs[1:]])
