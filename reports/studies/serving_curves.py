"""Curves of a picture while it is refined, and of its error over the number of samples, as plain data."""

from harness.records.serving_record import Allocation, Anytime, Measure, Order, Reaching
from harness.records.study import Series
from reports.data.wording import of_any_size
from reports.drawing import palette
from reports.drawing.figure import padded, with_common_limits
from reports.drawing.palette import Pen
from reports.drawing.traces import Panel, Trace
from reports.studies.serving_said import MEASURES, ORDERS, WAYS, brief

PENS: dict[Order, Pen] = {
    "attention": Pen(palette.OTHERS[0], "o", False, ()),
    "raster": Pen(palette.OTHERS[1], "D", True, (5, 2)),
    "spread": Pen(palette.OTHERS[2], "s", False, (1.2, 1.2)),
    "plain": Pen(palette.OTHERS[3], "^", True, (8, 2, 1.2, 2)),
}
"""The pens of the orders, not in the colours of methods."""
ALLOCATED: dict[str, Pen] = {
    f"{words}, {where}": Pen(colour, marker, where == "whole", () if where == "attended" else (1.2, 1.2))
    for words, colour, marker in (
        (WAYS["evaluations"], palette.OTHERS[0], "o"),
        (WAYS["samples"], palette.OTHERS[2], "s"),
        (WAYS["even"], palette.OTHERS[1], "D"),
    )
    for where in ("attended", "whole")
}
INVISIBLE = 1e-4
"""The smallest visible difference of display colour, a fortieth of a step of an 8-bit picture: below it a curve stands
at the foot of its axis.
"""
AT_MOST = 80
"""The steps of a line, at most."""
SIZE = (3.4, 2.3)


def anytime_panels(curves: list[Anytime], reaching: list[Reaching], measure: Measure) -> list[Panel]:
    """Return one panel per scene and one line per order; a marker stands where it has come down to the error that
    `reaching` says.
    """
    panels = []
    for scene in dict.fromkeys(one.scene for one in curves):
        some = [one for one in curves if one.scene == scene]
        names = {(scene, one.method, one.attention, one.order, measure) for one in some}
        goals = [
            one
            for one in reaching
            if (one.scene, one.method, one.attention, one.order, one.measure) in names and one.error > INVISIBLE
        ]
        panels.append(_panel(scene, some, goals, measure))
    return with_common_limits(panels, "xy")


def _panel(scene: str, curves: list[Anytime], goals: list[Reaching], measure: Measure) -> Panel:
    traces: list[Trace] = []
    foot = None
    for one in curves:
        pen = PENS[one.order]
        seconds, shown = _drawn(one.seconds, one.rmse(measure))
        if min(shown) < INVISIBLE:
            foot = INVISIBLE
        width = 2.2 if one.order == "attention" else 1.6
        line = tuple(max(value, INVISIBLE) for value in shown)
        traces.append(Trace(one.order, pen.colour.light, "line", tuple(seconds), line, dash=pen.dash, width=width))
    for goal in goals:
        if goal.seconds is not None:
            pen, at, left = PENS[goal.order], (goal.seconds,), (goal.error,)
            mark = Trace(goal.order, pen.colour.light, "mark", at, left, marker=pen.marker, hollow=pen.hollow, size=6)
            traces.append(mark)
    if goals:
        ends = (min(one.seconds[0] for one in curves), max(one.seconds[-1] for one in curves))
        traces.append(Trace("share", palette.MUTED.light, "floor", ends, (goals[0].error, goals[0].error)))
    every = [value for trace in traces for value in trace.y]
    said = "; ".join(
        f"{ORDERS[one.order]} {of_any_size(one.rmse(measure)[0])} after {brief(one.seconds[0])} to "
        f"{of_any_size(one.rmse(measure)[-1])} after {brief(one.seconds[-1])}"
        for one in curves
    )
    return Panel(
        scene,
        "seconds since the view was asked for",
        "RMSE, display",
        tuple(traces),
        f"Error of {MEASURES[measure]} on {scene} while the picture is refined: {said}.",
        "linear",
        "log",
        y_limits=padded(every, True),
        size=SIZE,
        zero_at=foot,
    )


def _drawn(seconds: list[float], error: list[float]) -> tuple[list[float], list[float]]:
    """Return the curve as steps, for an error stays until the next region is done; what is done at once, to the eye, is
    one step.
    """
    apart = (seconds[-1] - seconds[0]) / AT_MOST
    kept = [(seconds[0], error[0])]
    for place in range(1, len(seconds)):
        last = place + 1 == len(seconds)
        if last or seconds[place + 1] - kept[-1][0] > apart:
            kept.append((seconds[place], error[place]))
    x, y = [kept[0][0]], [kept[0][1]]
    for at, value in kept[1:]:
        x += [at, at]
        y += [y[-1], value]
    return x, y


def allocation_series(found: list[Allocation]) -> list[Series]:
    """Return error over network evaluations, one chart per scene; a line for each way to distribute samples and each
    error.
    """
    series = []
    for scene in dict.fromkeys(one.scene for one in found):
        for way, words in WAYS.items():
            chosen = [one for one in found if (one.scene, one.way) == (scene, way)]
            for name, errors in (
                ("attended", [one.rmse_attended for one in chosen]),
                ("whole", [one.rmse_whole for one in chosen]),
            ):
                evaluations = [one.evaluations for one in chosen]
                series.append(
                    Series(
                        scene, 0, f"{words}, {name}", "network evaluations a view", "RMSE, display", evaluations, errors
                    )
                )
    return [one for one in series if one.x]
