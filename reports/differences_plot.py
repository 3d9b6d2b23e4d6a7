"""Differences in PSNR scene by scene with their intervals: what the verdicts look like."""

from reports.figure import with_common_limits
from reports.headline import BUDGETS, roles
from reports.load import Records
from reports.palette import INK, MUTED, colours_of
from reports.selection import behind_difference
from reports.trace_data import Panel, Trace
from reports.wording import interval, signed


def difference_panels(records: Records) -> list[Panel]:
    """For the contender of the headline: one panel a budget and rival, a row a scene, the mean of all at the bottom."""
    cast = roles(records)
    if not cast.contenders:
        return []
    method = cast.contenders[0]
    panels = []
    for budget, words in BUDGETS:
        for rival in (cast.baseline, cast.control):
            if rival and rival != method:
                panel = _panel(records, method, rival, budget, words)
                panels += [panel] if panel else []
    return with_common_limits(panels, "x")


def _panel(records: Records, method: str, rival: str, budget: str, words: str) -> Panel | None:
    rows = [scene for scene in [*records.scenes, "all"] if records.comparison(scene, method, rival, budget=budget)]
    found = {scene: records.comparison(scene, method, rival, budget=budget) for scene in rows}
    shown = [(place, one) for place, one in enumerate(found.values()) if one and one.difference is not None]
    if not shown:
        return None
    colour = colours_of(records.methods)[rival].light
    # of a family, the interval that the verdict is taken from
    with_interval = [(place, pair) for place, one in shown if (pair := one.simultaneous or one.interval)]
    behind = {place: behind_difference(one) for place, one in shown}
    traces = [
        Trace("no difference", INK.light, "floor", (0.0, 0.0), (-0.5, len(rows) - 0.5)),
        Trace(
            "95 % interval",
            colour,
            "range",
            tuple(pair[0] for _, pair in with_interval),
            tuple(float(place) for place, _ in with_interval),
            tuple(pair[1] for _, pair in with_interval),
            runs=tuple(behind[place] for place, _ in with_interval),
        ),
        Trace(
            "difference",
            colour,
            "dots",
            tuple(one.difference for _, one in shown if one.difference is not None),
            tuple(float(place) for place, _ in shown),
            runs=tuple(behind.values()),
        ),
    ]
    if rival == "nerf" and method == "qnerf":
        traces += _printed(records, rows)
    said = [
        f"{one.scene} {signed(one.difference)} {interval(one.simultaneous or one.interval)} {one.verdict}"
        for _, one in shown
    ]
    title = f"{method} − {rival} at {words}"
    height = 0.75 + 0.25 * len(rows)
    alt = f"{title}, in dB: {'; '.join(said)}."
    return Panel(title, "difference in test PSNR (dB)", "", tuple(traces), alt, rows=tuple(rows), size=(4.6, height))


def _printed(records: Records, rows: list[str]) -> list[Trace]:
    """The paper's differences as hollow diamonds."""
    table = records.run.paper.get("table2") or {}
    printed = {scene.lower(): row["qnerf"] - row["nerf"] for scene, row in table.items() if "qnerf" in row}
    if printed and set(rows) - {"all"} <= set(printed):
        printed["all"] = sum(printed[row] for row in rows if row != "all") / max(len(rows) - 1, 1)
    there = [(place, printed[row]) for place, row in enumerate(rows) if row in printed]
    if not there:
        return []
    x, y = tuple(value for _, value in there), tuple(float(place) for place, _ in there)
    return [Trace("printed in the paper", MUTED.light, "mark", x, y)]
