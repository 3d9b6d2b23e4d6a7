"""Several outputs side by side → outputs.html: each against the first, cell by cell, judged as methods are."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from harness.records.cells import CellRecord
from harness.records.metric_table import METRICS, PRIMARY
from harness.verdicts.comparisons import Budget, Judgement, differences, family_of, judged
from reports.claims.claim_list import claims
from reports.claims.headline import BUDGETS
from reports.claims.psnr_table import lines, losses, tone_of
from reports.data.load import Records
from reports.data.table import cells_frame, curves_frame, spread_of
from reports.data.wording import counted, interval, listed, number, signed
from reports.drawing.figure import plots, with_common_limits
from reports.drawing.palette import colours_of
from reports.drawing.traces import Panel, Trace
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid
from reports.page.script import content_policy
from reports.page.shell import flat
from reports.run.curves import middle_of, points_of
from reports.run.run_page import named as in_colours
from scenes.files.atomic import write_atomically

EVERYWHERE = "all"
FIRST, OTHER = "first", "other"
SAME_CLOCK = ("processor", "cores", "threads", "device")
"""The facts that two runs must share before their seconds are compared."""
DASHES = (("solid:", ()), ("dashed:", (5.0, 2.0)), ("dotted:", (1.5, 1.5)), ("dash-dotted:", (6.0, 2.0, 1.5, 2.0)))
"""The dashes, one per output, over and over."""
FEW = 3
"""The number of scenes that a headline names; more are counted."""
SECTIONS = (
    ("scores", "Scores"),
    ("verdicts", "Does the answer change?"),
    ("curves", "Convergence"),
    ("metrics", "Other scores"),
    ("seconds", "Training time"),
    ("facts", "What differs"),
)


@dataclass(frozen=True)
class Output:
    """A run under the name that distinguishes it from the others, and a letter for the heads of columns."""

    letter: str
    name: str
    records: Records


@dataclass(frozen=True)
class Row:
    """The difference `other` − `first` in one metric of one method."""

    scene: str
    """The name of a scene, or `all`: those with the same ground truth in both."""
    method: str
    metric: str
    budget: Budget
    found: Judgement


@dataclass(frozen=True)
class Against:
    """An output beside the first one."""

    other: Output
    identical: int
    """The number of cells with every score and every weight count the same to the last bit."""
    shared: int
    """The number of cells that both have."""
    alone: list[str]
    """The cells that only one of them has, in words."""
    unlike: dict[str, str]
    """Map scene → why its scores are of another question: another ground truth."""
    same_clock: bool
    rows: list[Row]

    def row(self, scene: str, method: str, metric: str = PRIMARY, budget: str = "steps") -> Row | None:
        wanted = (scene, method, metric, budget)
        return next((row for row in self.rows if (row.scene, row.method, row.metric, row.budget) == wanted), None)


def named(found: list[Records]) -> list[Output]:
    """Name each by the shortest end of its path that none of the others has."""
    paths = [records.out.resolve() for records in found]

    def name(path: Path) -> str:
        ends = [path.parts[-many:] for many in range(1, len(path.parts))]
        alone = (end for end in ends if sum(other.parts[-len(end) :] == end for other in paths) == 1)
        return "/".join(next(alone, path.parts))

    letters = [chr(ord("A") + place) if place < 26 else str(place + 1) for place in range(len(found))]
    return [Output(*one) for one in zip(letters, map(name, paths), found, strict=True)]


def against(first: Output, other: Output) -> Against:
    """Return what `other` changes of `first`: only scenes, methods and seeds that both have can be compared."""
    ours, theirs = ({(c.scene, c.method, c.seed): c for c in one.records.cells} for one in (first, other))
    pairs = [(ours[key], theirs[key]) for key in ours if key in theirs]
    unlike: dict[str, str] = {}
    for pair in pairs:
        if pair[0].scene not in unlike:
            unlike[pair[0].scene] = other_truth(*pair)
    unlike = {scene: why for scene, why in unlike.items() if why}
    origins = [one.records.run.provenance for one in (first, other)]
    same_clock = all(origins[0].get(fact) == origins[1].get(fact) for fact in SAME_CLOCK)
    alone = [
        f"{scene} · {method} · seed {seed} in {(first if (scene, method, seed) in ours else other).name} alone"
        for scene, method, seed in ours.keys() ^ theirs.keys()
    ]
    identical = sum(results(one) == results(another) for one, another in pairs)
    rows = _rows(pairs, set(unlike), same_clock)
    return Against(other, identical, len(pairs), sorted(alone), unlike, same_clock, rows)


def results(cell: CellRecord) -> tuple[Any, ...]:
    """Return a cell's numbers: status, steps, scores, curve but for its clock, scores by view."""
    curve = [(point.step, point.network_evaluations, point.psnr, point.rmse_linear) for point in cell.curve]
    return cell.status, cell.steps, cell.scores, curve, cell.views


def other_truth(one: CellRecord, other: CellRecord) -> str:
    """Return why two cells were not scored against the same images; nothing if they were."""
    first, second = (cell.settings.get("view_set") or {} for cell in (one, other))
    for key, words in (("width", "px wide"), ("height", "px high"), ("test", "test views")):
        if first.get(key) != second.get(key):
            return f"{first.get(key)} against {second.get(key)} {words}"
    return "other images of the same size" if first.get("digest") != second.get("digest") else ""


def _rows(pairs: list[tuple[CellRecord, CellRecord]], unlike: set[str], same_clock: bool) -> list[Row]:
    rows = []
    for method in dict.fromkeys(cell.method for cell, _ in pairs):
        own = [pair for pair in pairs if pair[0].method == method]
        keyed = {(cell.scene, FIRST, cell.seed): cell for cell, _ in own}
        keyed |= {(cell.scene, OTHER, cell.seed): cell for _, cell in own}
        seeds = sorted({cell.seed for cell, _ in own})
        like = [scene for scene in dict.fromkeys(cell.scene for cell, _ in own) if scene not in unlike]
        has = {scene: np.array([(scene, FIRST, seed) in keyed for seed in seeds]) for scene in like}
        common = np.all(list(has.values()), axis=0)
        for metric, about in METRICS.items():
            budgets: tuple[Budget, ...] = ("steps", "seconds") if about.along_training and same_clock else ("steps",)
            for budget in budgets:
                table = differences(keyed, like, seeds, OTHER, FIRST, metric, budget)
                # a seed that a scene has in neither run is not a pair that was lost
                there = {scene: values[has[scene]] for scene, values in table.items()}
                for scene in like:
                    family = family_of(metric, scene, len(like))
                    rows.append(Row(scene, method, metric, budget, judged(there, metric, family, scene)))
                if len(like) > 1 and common.any():
                    shared = {scene: values[common] for scene, values in table.items()}
                    family = family_of(metric, EVERYWHERE, len(like))
                    rows.append(Row(EVERYWHERE, method, metric, budget, judged(shared, metric, family)))
    return rows


def unequal_facts(outputs: list[Output], part: str) -> list[tuple[str, list[str]]]:
    """Return settings (`settings`) or origins (`provenance`) that differ between outputs: name, value in each."""
    found = [dict(flat(getattr(one.records.run, part))) for one in outputs]
    rows = [(name, [facts.get(name, "–") for facts in found]) for name in dict.fromkeys(n for f in found for n in f)]
    return [(name, values) for name, values in rows if len(set(values)) > 1]


def headline(first: Output, found: list[Against]) -> str:
    """State what the others change of the first, in one sentence each."""
    return "; ".join(_sentence(first, one) for one in found)


def _sentence(first: Output, one: Against) -> str:
    name = one.other.name
    if one.shared == 0:
        return f"{name} and {first.name} have no cell in common"
    if one.identical == one.shared and not one.alone:
        return f"{name} has the same results as {first.name}, to the last bit"
    methods = methods_of([first, one.other])
    chosen = {method: _row(one, method) for method in methods}
    places = {method: _place(first, one, row) for method, row in chosen.items() if row}
    same_place = len(set(places.values())) == 1  # stated once if it is the same for all
    cells = counted(one.shared + len(one.alone), "cell")
    extent = f"in the {one.shared} of {cells} that both have" if one.alone else ""
    where = ", ".join(filter(None, [*(set(places.values()) if same_place else ()), extent]))
    verdicts = []
    for method, row in chosen.items():
        same = row and row.found.difference == 0 and row.found.chosen.interval == (0.0, 0.0)
        words = ("the same" if same else row.found.chosen.verdict) if row else "not compared"
        verdicts.append(" ".join(filter(None, [method, words, "" if same_place else places.get(method, "")])))
    return f"{name} against {first.name}{', ' if where else ''}{where}: {listed(verdicts)}"


def _place(first: Output, one: Against, row: Row) -> str:
    """Return the scenes that a row is of, if they are not all of several."""
    every = scenes_of([first, one.other])
    own = {r.scene for r in one.rows if (r.method, r.metric, r.budget) == (row.method, row.metric, row.budget)}
    judged_on = [scene for scene in every if scene in own] if row.scene == EVERYWHERE else [row.scene]
    if len(judged_on) == len(every) > 1:
        return ""
    return f"on {listed(judged_on)} alone" if len(judged_on) <= FEW else f"on {len(judged_on)} of {len(every)} scenes"


def _row(one: Against, method: str) -> Row | None:
    """Return the row over all scenes; else that of the first scene which both have."""
    scenes = dict.fromkeys([EVERYWHERE, *(row.scene for row in one.rows)])
    return next(filter(None, (one.row(scene, method) for scene in scenes)), None)


def methods_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(method for one in outputs for method in one.records.methods))


def scenes_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(scene for one in outputs for scene in one.records.scenes))


def sentences(first: Output, found: list[Against]) -> list[str]:
    """Return the notes that a reader needs before the tables."""
    notes = []
    for one in found:
        name, cells = one.other.name, counted(one.shared, "cell")
        if one.shared:
            notes.append(
                f"{one.identical} of {cells} that {first.name} and {name} share have the same results bit for bit."
            )
        if one.alone:
            more = f" and {len(one.alone) - 3} more" if len(one.alone) > 3 else ""
            notes.append(f"Not compared: {', '.join(one.alone[:3])}{more}.")
        if one.unlike:
            why = listed([f"{scene} ({reason})" for scene, reason in one.unlike.items()])
            notes.append(f"The ground truth of {name} is another one in {why}: shown, and not judged.")
        if not one.same_clock:
            notes.append(f"{name} ran on another kind of machine, or on other cores: their seconds are not compared.")
    return notes


def _heads(outputs: list[Output], numeric: bool = True) -> list[Column]:
    return [Column(one.letter, numeric=numeric) for one in outputs]


def scores_grid(outputs: list[Output], found: list[Against], method: str) -> Grid:
    """Tabulate mean test PSNR of a method by scene in each output, and each difference to the first."""
    frames = [cells_frame(one.records) for one in outputs]
    shown = [(one, budget, words) for one in found for budget, words in BUDGETS if one.same_clock or budget == "steps"]
    columns = [Column("scene", numeric=False), *(Column(one.letter, small=one.name) for one in outputs)]
    columns += [Column(f"{one.other.letter} − {outputs[0].letter}", small=f"at {words}") for one, _, words in shown]

    def changes(scene: str) -> list[Entry]:
        return [difference_entry(one.row(scene, method, budget=budget), 2) for one, budget, _ in shown]

    rows = []
    for scene in scenes_of(outputs):
        row = [Entry(scene)]
        for one, frame in zip(outputs, frames, strict=True):
            cells, spread = one.records.cells_of(scene, method), spread_of(frame, scene, method, "psnr")
            text = number(spread.mean) + (f" ± {number(spread.sd)}" if spread.sd is not None else "")
            row.append(Entry(text, losses(cells), tone_of(cells)) if cells else EMPTY)
        rows.append([*row, *changes(scene)])
    total = [Entry("all scenes"), *([EMPTY] * len(outputs)), *changes(EVERYWHERE)]
    return Grid(f"{method}: test PSNR (dB)", columns, rows, [total] if len(rows) > 1 else [])


def difference_entry(row: Row | None, digits: int) -> Entry:
    """Return the difference, its interval, the one that the verdict is taken from if it is wider, and the verdict."""
    if row is None:
        return EMPTY
    found, one = row.found, row.found.chosen
    aside = f"{counted(found.unpaired, 'pair')} not judged" if found.unpaired else ""
    if found.difference is None:
        return Entry("–", lines(one.verdict, aside), one.verdict)
    wide = one.simultaneous if one.simultaneous != one.interval else None
    together = f"together: {interval(wide, digits)}" if wide else ""
    verdict = f"{interval(one.interval, digits)} {one.verdict}".strip()
    return Entry(signed(found.difference, digits), lines(verdict, together, aside), one.verdict)


def metrics_grid(outputs: list[Output], found: list[Against]) -> Grid:
    """Tabulate every metric over all scenes, at equal steps."""
    columns = [Column("method", numeric=False), Column("metric", numeric=False)]
    columns += [Column(f"{one.other.letter} − {outputs[0].letter}") for one in found]
    rows = []
    for method in methods_of(outputs):
        for metric, about in METRICS.items():
            changes = [one.row(EVERYWHERE, method, metric) for one in found]
            if any(changes):
                shown = [difference_entry(row, about.digits_of_difference) for row in changes]
                rows.append([Entry(method), Entry(metric), *shown])
    return Grid("Every score over all scenes, at equal steps", columns, rows)


def seconds_grid(outputs: list[Output]) -> Grid:
    """Tabulate mean training seconds of the finished cells by each clock, without a verdict."""
    rows = []
    for method in methods_of(outputs):
        row = [Entry(method)]
        for one in outputs:
            cells = [cell for cell in one.records.cells if (cell.method, cell.status) == (method, "done")]
            mean = number(float(np.mean([cell.train_seconds for cell in cells])), 1) if cells else ""
            row.append(Entry(f"{mean} s", counted(len(cells), "cell")) if cells else EMPTY)
        rows.append(row)
    columns = [Column("method", numeric=False), *_heads(outputs)]
    return Grid("Training seconds a cell", columns, rows, note="Means over the finished cells of each output.")


def verdicts_grid(outputs: list[Output]) -> Grid:
    """Tabulate the answer of each output to its own question: the compared methods, over all scenes."""
    found = [
        {
            (one.method, one.against, one.budget): one
            for one in output.records.comparisons
            if (one.scene, one.metric) == (EVERYWHERE, PRIMARY)
        }
        for output in outputs
    ]
    words, rows = dict(BUDGETS), []
    for key in dict.fromkeys(key for of_output in found for key in of_output):
        row = [Entry(f"{key[0]} − {key[1]}", f"at {words[key[2]]}")]
        for one in (of_output.get(key) for of_output in found):
            known = one is not None and one.difference is not None
            row.append(
                Entry(signed(one.difference), lines(interval(one.interval), one.verdict), one.verdict)
                if one and known
                else EMPTY
            )
        rows.append(row)
    columns = [Column("comparison", numeric=False), *_heads(outputs)]
    return Grid("What each output says: difference in test PSNR over its scenes (dB)", columns, rows)


def claims_grid(outputs: list[Output]) -> Grid:
    """Tabulate the printed claims that all outputs list and on which they disagree."""
    found = [{claim.id: claim for claim in claims(output.records)} for output in outputs]
    rows = []
    for name, claim in found[0].items():
        verdicts = [of_output[name].verdict for of_output in found if name in of_output]
        if len(verdicts) == len(outputs) and len(set(verdicts)) > 1:
            rows.append([Entry(claim.statement, name), *map(Entry, verdicts)])
    columns = [Column("claim", numeric=False), *_heads(outputs, numeric=False)]
    return Grid("Claims of which the outputs do not say the same", columns, rows)


def facts_grids(outputs: list[Output]) -> list[Grid]:
    """Tabulate the differences in settings and origins."""
    columns = [Column("setting", numeric=False), *_heads(outputs, numeric=False)]
    parts = (("settings", "Settings that differ"), ("provenance", "Machine and versions that differ"))
    grids = []
    for part, caption in parts:
        rows = [[Entry(name), *map(Entry, values)] for name, values in unequal_facts(outputs, part)]
        grids += [Grid(caption, columns, rows)] if rows else []
    return grids


def curves(outputs: list[Output]) -> list[Panel]:
    """Draw mean test PSNR over steps, scene by scene: one colour per method, one dash per output."""
    frames = [curves_frame(one.records) for one in outputs]
    points = [points_of(frame.assign(x=frame["step"], y=frame["psnr"])) for frame in frames]
    panels = []
    for scene in scenes_of(outputs):
        traces = []
        for place, (one, known) in enumerate(zip(outputs, points, strict=True)):
            done = known[(known["scene"] == scene) & (known["status"] == "done")]
            for method, colour in colours_of(methods_of(outputs)).items():
                mean = middle_of(done[done["method"] == method], log=False)
                if len(mean):
                    x, y = (tuple(map(float, mean[name])) for name in "xy")
                    dash = DASHES[place % len(DASHES)][1]
                    traces.append(Trace(f"{one.letter}: {method}", colour.light, "line", x, y, dash=dash, width=1.6))
        if traces:
            ends = "; ".join(f"{trace.label} {number(trace.y[-1])} dB" for trace in traces)
            alt = f"{scene}: mean test PSNR against steps. At the end: {ends}."
            panels.append(Panel(scene, "training step", "test PSNR (dB)", tuple(traces), alt, "log", "linear"))
    return with_common_limits(panels, "x")


def outputs_page(found: list[Records]) -> str:
    """Return the complete page as text; the first output is the reference for the others."""
    return _page(found)[0]


def _page(found: list[Records]) -> tuple[str, str]:
    outputs = named(found)
    pairs = [against(outputs[0], other) for other in outputs[1:]]
    methods, title = methods_of(outputs), headline(outputs[0], pairs)
    environment, colours = shell.environment(), colours_of(methods)
    environment.filters["named"] = lambda text: in_colours(text, colours)
    drawn, verdicts, metrics = plots(curves(outputs), "curves"), verdicts_grid(outputs), metrics_grid(outputs, pairs)
    there = {"verdicts": verdicts.rows, "curves": drawn, "metrics": metrics.rows}
    text = environment.get_template("outputs_page.html").render(
        scores=[scores_grid(outputs, pairs, method) for method in methods],
        verdicts=verdicts,
        claims=claims_grid(outputs),
        metrics=metrics,
        seconds=seconds_grid(outputs),
        facts=facts_grids(outputs),
        policy=content_policy(shell.code()),
        script=Markup(shell.code()),
        style=shell.style("page.css", "explore.css"),
        title=title,
        sentences=sentences(outputs[0], pairs),
        sections=[(name, caption) for name, caption in SECTIONS if there.get(name, True)],
        colours=colours,
        methods=methods,
        outputs=outputs,
        plots=drawn,
        looks=[(one, DASHES[place % len(DASHES)][0]) for place, one in enumerate(outputs)],
    )
    return text, title


def write_outputs_page(found: list[Records], path: Path) -> str:
    """Write the page atomically; returns its headline."""
    text, title = _page(found)
    write_atomically(path, text, fsync=False)
    return title
