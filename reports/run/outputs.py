"""Several outputs side by side → outputs.html: each against the first, cell by cell, judged as methods are."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from harness.records.cells import CellRecord
from harness.records.metric_table import METRICS, PRIMARY
from harness.verdicts.comparisons import Budget, Judgement, differences, family_of, judged
from reports.claims.claim_list import claims
from reports.claims.ledger import Claim
from reports.claims.psnr_table import lines, losses, tone_of
from reports.data.load import Records
from reports.data.table import cells_frame, curves_frame, spread_of
from reports.data.wording import counted, interval, listed, number, signed
from reports.drawing import palette
from reports.drawing.figure import plots, with_common_limits
from reports.drawing.palette import colours_of
from reports.drawing.traces import Panel, Trace
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid
from reports.page.script import content_policy
from reports.page.shell import flat
from reports.run.run_page import named as in_colours
from scenes.files.atomic import write_atomically

EVERYWHERE = "all"
FIRST, OTHER = "first", "other"
SAME_CLOCK = ("processor", "cores", "threads", "device")
"""The facts that two runs must share before their seconds are compared."""


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
    rows: list[Row] = field(default_factory=list)

    def row(self, scene: str, method: str, metric: str = PRIMARY, budget: Budget = "steps") -> Row | None:
        wanted = (scene, method, metric, budget)
        return next((one for one in self.rows if (one.scene, one.method, one.metric, one.budget) == wanted), None)


def named(found: list[Records]) -> list[Output]:
    """Name each by the shortest end of its path that none of the others has."""
    paths = [records.out.resolve() for records in found]
    return [
        Output(chr(ord("A") + place) if place < 26 else str(place + 1), _name(path, paths), records)
        for place, (path, records) in enumerate(zip(paths, found, strict=True))
    ]


def _name(path: Path, paths: list[Path]) -> str:
    for many in range(1, len(path.parts)):
        if sum(other.parts[-many:] == path.parts[-many:] for other in paths) == 1:
            return "/".join(path.parts[-many:])
    return str(path)


def against(first: Output, other: Output) -> Against:
    """Return what `other` changes of `first`: only scenes, methods and seeds that both have can be compared."""
    ours, theirs = ({(c.scene, c.method, c.seed): c for c in one.records.cells} for one in (first, other))
    both = [key for key in ours if key in theirs]
    unlike = {
        scene: why
        for scene in dict.fromkeys(scene for scene, _, _ in both)
        if (why := other_truth(*(next(c for key, c in cells.items() if key[0] == scene) for cells in (ours, theirs))))
    }
    same_clock = all(
        first.records.run.provenance.get(key) == other.records.run.provenance.get(key) for key in SAME_CLOCK
    )
    alone = [f"{scene} · {method} · seed {seed} in {first.name} alone" for scene, method, seed in ours.keys() - both]
    alone += [f"{scene} · {method} · seed {seed} in {other.name} alone" for scene, method, seed in theirs.keys() - both]
    return Against(
        other=other,
        identical=sum(same_results(ours[key], theirs[key]) for key in both),
        shared=len(both),
        alone=sorted(alone),
        unlike=unlike,
        same_clock=same_clock,
        rows=_rows([ours[key] for key in both], [theirs[key] for key in both], set(unlike), same_clock),
    )


def same_results(one: CellRecord, other: CellRecord) -> bool:
    """Return whether two cells have the same numbers: status, steps, scores, curve but for its clock,
    scores by view.
    """

    def results(cell: CellRecord) -> tuple[Any, ...]:
        curve = [(point.step, point.network_evaluations, point.psnr, point.rmse_linear) for point in cell.curve]
        return cell.status, cell.steps, cell.scores, curve, cell.views

    return results(one) == results(other)


def other_truth(one: CellRecord, other: CellRecord) -> str:
    """Return why two cells were not scored against the same images; nothing if they were."""
    facts = [cell.settings.get("view_set") or {} for cell in (one, other)]
    unequal = [key for key in ("width", "height", "test", "digest") if facts[0].get(key) != facts[1].get(key)]
    if not unequal:
        return ""
    key = unequal[0]
    if key == "digest":
        return "other images of the same size"
    words = {"width": "px wide", "height": "px high", "test": "test views"}[key]
    return f"{facts[0].get(key)} against {facts[1].get(key)} {words}"


def _rows(ours: list[CellRecord], theirs: list[CellRecord], unlike: set[str], same_clock: bool) -> list[Row]:
    scenes = list(dict.fromkeys(cell.scene for cell in ours))
    rows = []
    for method in dict.fromkeys(cell.method for cell in ours):
        keyed = {
            (cell.scene, side, cell.seed): cell
            for side, cells in ((FIRST, ours), (OTHER, theirs))
            for cell in cells
            if cell.method == method
        }
        seeds = sorted({seed for _, _, seed in keyed})
        like = [scene for scene in scenes if scene not in unlike and any(key[0] == scene for key in keyed)]
        common = np.array([all((scene, FIRST, seed) in keyed for scene in like) for seed in seeds])
        for metric, about in METRICS.items():
            budgets: tuple[Budget, ...] = ("steps", "seconds") if about.along_training and same_clock else ("steps",)
            for budget in budgets:
                table = differences(keyed, like, seeds, OTHER, FIRST, metric, budget)
                # a seed that a scene has in neither run is not a pair that was lost
                own = {
                    scene: values[[(scene, FIRST, seed) in keyed for seed in seeds]] for scene, values in table.items()
                }
                for scene in own:
                    family = family_of(metric, scene, len(like))
                    rows.append(Row(scene, method, metric, budget, judged(own, metric, family, scene)))
                if len(like) > 1 and common.any():
                    family = family_of(metric, EVERYWHERE, len(like))
                    shared = {scene: values[common] for scene, values in table.items()}
                    rows.append(Row(EVERYWHERE, method, metric, budget, judged(shared, metric, family)))
    return rows


def unequal_facts(outputs: list[Output], part: str) -> list[tuple[str, list[str]]]:
    """Return settings (`settings`) or origins (`provenance`) that differ between outputs: name, value in each."""
    found = [dict(flat(getattr(one.records.run, part))) for one in outputs]
    names = dict.fromkeys(name for facts in found for name in facts)
    rows = [(name, [facts.get(name, "–") for facts in found]) for name in names]
    return [(name, values) for name, values in rows if len(set(values)) > 1]


DASHES = ((), (5.0, 2.0), (1.5, 1.5), (6.0, 2.0, 1.5, 2.0))
"""The dashes, one per output, over and over."""
FEW = 3
"""The number of scenes that a headline names; more are counted."""
BUDGETS: tuple[tuple[Budget, str], ...] = (("steps", "equal steps"), ("seconds", "equal training time"))


def headline(first: Output, found: list[Against]) -> str:
    """State what the others change of the first, in one sentence each."""
    said = []
    for one in found:
        if one.shared == 0:
            said.append(f"{one.other.name} and {first.name} have no cell in common")
        elif one.identical == one.shared and not one.alone:
            said.append(f"{one.other.name} has the same results as {first.name}, to the last bit")
        else:
            known = methods_of([first, one.other])
            places = {_place(first, one, method) for method in known} - {None}
            # stated once if it is the same for all
            where = ", ".join(filter(None, [*(places if len(places) == 1 else []), _extent(one)]))
            verdicts = [f"{method} {_verdict(first, one, method, placed=len(places) > 1)}" for method in known]
            said.append(f"{one.other.name} against {first.name}{', ' if where else ''}{where}: {listed(verdicts)}")
    return "; ".join(said)


def _extent(one: Against) -> str:
    """State how much the verdicts rest on, if it is not all of both."""
    return f"in the {one.shared} of {counted(one.shared + len(one.alone), 'cell')} that both have" if one.alone else ""


def _place(first: Output, one: Against, method: str) -> str | None:
    """Return the scenes that the verdict on a method is of, if they are not all of several; None without a verdict."""
    row = _row(one, method)
    if row is None:
        return None
    every = scenes_of([first, one.other])
    of_method = [r.scene for r in one.rows if (r.method, r.metric, r.budget) == (method, row.metric, row.budget)]
    judged = [scene for scene in every if scene in of_method] if row.scene == EVERYWHERE else [row.scene]
    if len(judged) == len(every) > 1:
        return ""
    return f"on {listed(judged)} alone" if len(judged) <= FEW else f"on {len(judged)} of {len(every)} scenes"


def _row(one: Against, method: str) -> Row | None:
    """Return the row over all scenes; else that of the first scene which both have."""
    scenes = dict.fromkeys([EVERYWHERE, *(row.scene for row in one.rows)])
    return next(filter(None, (one.row(scene, method) for scene in scenes)), None)


def _verdict(first: Output, one: Against, method: str, placed: bool) -> str:
    row = _row(one, method)
    if row is None:
        return "not compared"
    same = row.found.difference == 0 and row.found.chosen.interval == (0.0, 0.0)
    place = _place(first, one, method) if placed else ""
    return " ".join(filter(None, ["the same" if same else row.found.chosen.verdict, place]))


def methods_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(method for one in outputs for method in one.records.methods))


def scenes_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(scene for one in outputs for scene in one.records.scenes))


def sentences(first: Output, found: list[Against]) -> list[str]:
    """Return the notes that a reader needs before the tables."""
    said = []
    for one in found:
        name = one.other.name
        if one.shared:
            cells = counted(one.shared, "cell")
            said.append(
                f"{one.identical} of {cells} that {first.name} and {name} share have the same results bit for bit."
            )
        if one.alone:
            more = f" and {len(one.alone) - 3} more" if len(one.alone) > 3 else ""
            said.append(f"Not compared: {', '.join(one.alone[:3])}{more}.")
        if one.unlike:
            why = listed([f"{scene} ({reason})" for scene, reason in one.unlike.items()])
            said.append(f"The ground truth of {name} is another one in {why}: shown, and not judged.")
        if not one.same_clock:
            said.append(f"{name} ran on another kind of machine, or on other cores: their seconds are not compared.")
    return said


def scores_grid(outputs: list[Output], found: list[Against], method: str) -> Grid:
    """Tabulate mean test PSNR of a method by scene in each output, and each difference to the first."""
    frames = [cells_frame(one.records) for one in outputs]
    shown = [(one, budget, words) for one in found for budget, words in BUDGETS if one.same_clock or budget == "steps"]
    columns = [Column("scene", numeric=False), *(Column(one.letter, small=one.name) for one in outputs)]
    columns += [Column(f"{one.other.letter} − {outputs[0].letter}", small=f"at {words}") for one, _, words in shown]
    rows = []
    for scene in scenes_of(outputs):
        row = [Entry(scene)]
        for one, frame in zip(outputs, frames, strict=True):
            cells = one.records.cells_of(scene, method)
            spread = spread_of(frame, scene, method, "psnr")
            text = number(spread.mean) + (f" ± {number(spread.sd)}" if spread.sd is not None else "")
            row.append(Entry(text, losses(cells), tone_of(cells)) if cells else EMPTY)
        rows.append(row + _differences(shown, scene, method))
    totals = []
    if len(rows) > 1:
        totals = [[Entry("all scenes"), *([EMPTY] * len(outputs)), *_differences(shown, EVERYWHERE, method)]]
    return Grid(f"{method}: test PSNR (dB)", columns, rows, totals)


def _differences(shown: list[tuple[Against, Budget, str]], scene: str, method: str) -> list[Entry]:
    rows = [one.row(scene, method, budget=budget) for one, budget, _ in shown]
    return [difference_entry(row.found, 2) if row else EMPTY for row in rows]


def difference_entry(found: Judgement, digits: int) -> Entry:
    """Return the difference, its interval, the one that the verdict is taken from if it is wider, and the verdict."""
    aside = f"{counted(found.unpaired, 'pair')} not judged" if found.unpaired else ""
    one = found.chosen
    if found.difference is None:
        return Entry("–", lines(one.verdict, aside), one.verdict)
    wide = one.simultaneous if one.simultaneous != one.interval else None
    together = f"together: {interval(wide, digits)}" if wide else ""
    words = lines(" ".join(filter(None, [interval(one.interval, digits), one.verdict])), together, aside)
    return Entry(signed(found.difference, digits), words, one.verdict)


def metrics_grid(outputs: list[Output], found: list[Against]) -> Grid:
    """Tabulate every metric over all scenes, at equal steps."""
    columns = [Column("method", numeric=False), Column("metric", numeric=False)]
    columns += [Column(f"{one.other.letter} − {outputs[0].letter}") for one in found]
    rows = []
    for method in methods_of(outputs):
        for metric in METRICS:
            entries = [one.row(EVERYWHERE, method, metric) for one in found]
            if any(entries):
                digits = METRICS[metric].digits_of_difference
                shown = [difference_entry(row.found, digits) if row else EMPTY for row in entries]
                rows.append([Entry(method), Entry(metric), *shown])
    return Grid("Every score over all scenes, at equal steps", columns, rows)


def seconds_grid(outputs: list[Output]) -> Grid:
    """Tabulate mean training seconds of the finished cells by each clock, without a verdict."""
    frames = [cells_frame(one.records) for one in outputs]
    columns = [Column("method", numeric=False), *(Column(one.letter) for one in outputs)]
    rows = []
    for method in methods_of(outputs):
        row = [Entry(method)]
        for frame in frames:
            done = frame[(frame["method"] == method) & (frame["status"] == "done")]
            row.append(
                Entry(f"{number(float(done['train_seconds'].mean()), 1)} s", counted(len(done), "cell"))
                if len(done)
                else EMPTY
            )
        rows.append(row)
    return Grid("Training seconds a cell", columns, rows, note="Means over the finished cells of each output.")


def verdicts_grid(outputs: list[Output]) -> Grid:
    """Tabulate the answer of each output to its own question: the compared methods, over all scenes."""
    columns = [Column("comparison", numeric=False), *(Column(one.letter) for one in outputs)]
    keys = dict.fromkeys(
        (one.method, one.against, one.budget)
        for output in outputs
        for one in output.records.comparisons
        if one.scene == EVERYWHERE and one.metric == "psnr"
    )
    words: dict[str, str] = dict(BUDGETS)
    rows = []
    for method, rival, budget in keys:
        row = [Entry(f"{method} − {rival}", f"at {words[budget]}")]
        for output in outputs:
            there = output.records.comparison(EVERYWHERE, method, rival, budget=budget)
            known = there is not None and there.difference is not None
            small = lines(interval(there.interval), there.verdict) if known and there else ""
            row.append(Entry(signed(there.difference), small, there.verdict) if known and there else EMPTY)
        rows.append(row)
    return Grid("What each output says: difference in test PSNR over its scenes (dB)", columns, rows)


def claims_grid(outputs: list[Output], judge: Callable[[Output], list[Claim]] | None = None) -> Grid:
    """Tabulate the printed claims that all outputs list and on which they disagree."""
    found = [{one.id: one for one in (judge or _claims)(output)} for output in outputs]
    columns = [Column("claim", numeric=False), *(Column(one.letter, numeric=False) for one in outputs)]
    rows = []
    for name in dict.fromkeys(name for one in found for name in one):
        if not all(name in one for one in found):
            continue  # an older record does not list it
        verdicts = [one[name].verdict for one in found]
        if len(set(verdicts)) > 1:
            rows.append([Entry(found[0][name].statement, name), *map(Entry, verdicts)])
    return Grid("Claims of which the outputs do not say the same", columns, rows)


def _claims(output: Output) -> list[Claim]:
    return claims(output.records)


def facts_grids(outputs: list[Output]) -> list[Grid]:
    """Tabulate the differences in settings and origins."""
    columns = [Column("setting", numeric=False), *(Column(one.letter, numeric=False) for one in outputs)]
    parts = (("settings", "Settings that differ"), ("provenance", "Machine and versions that differ"))
    grids = []
    for part, caption in parts:
        rows = [[Entry(name), *map(Entry, values)] for name, values in unequal_facts(outputs, part)]
        grids.append(Grid(caption, columns, rows))
    return [grid for grid in grids if grid.rows]


def curves(outputs: list[Output]) -> list[Panel]:
    """Draw mean test PSNR over steps, scene by scene: one colour per method, one dash per output."""
    frames = [curves_frame(one.records) for one in outputs]
    colours = colours_of(methods_of(outputs))
    panels = []
    for scene in scenes_of(outputs):
        traces = []
        for place, (one, frame) in enumerate(zip(outputs, frames, strict=True)):
            for method, colour in colours.items():
                chosen = frame[(frame["scene"] == scene) & (frame["method"] == method) & (frame["status"] == "done")]
                grouped = chosen.dropna(subset=["psnr"]).groupby("step")["psnr"]
                whole = grouped.mean()[grouped.size() == chosen["seed"].nunique()]
                if len(whole):
                    x, y = tuple(map(float, whole.index)), tuple(map(float, whole))
                    dash = DASHES[place % len(DASHES)]
                    traces.append(Trace(f"{one.letter}: {method}", colour.light, "line", x, y, dash=dash, width=1.6))
        if traces:
            ends = "; ".join(f"{trace.label} {number(trace.y[-1])} dB" for trace in traces)
            alt = f"{scene}: mean test PSNR against steps. At the end: {ends}."
            panels.append(Panel(scene, "training step", "test PSNR (dB)", tuple(traces), alt, "log", "linear"))
    return with_common_limits(panels, "x")


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
    """Return the complete page as text; the first output is the reference for the others."""
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
    write_atomically(path, outputs_page(found), fsync=False)
    outputs = named(found)
    return headline(outputs[0], [against(outputs[0], other) for other in outputs[1:]])
