"""Outputs side by side → headline, tables and drawings."""

from collections.abc import Callable

from harness.comparisons import METRICS, Budget, Judgement
from reports.claims import claims
from reports.figure import with_common_limits
from reports.grid import EMPTY, Column, Entry, Grid
from reports.ledger import Claim
from reports.outputs import EVERYWHERE, Against, Output, Row, unequal_facts
from reports.palette import colours_of
from reports.psnr_table import lines, losses, tone_of
from reports.table import cells_frame, curves_frame, spread_of
from reports.trace_data import Panel, Trace
from reports.wording import counted, interval, listed, number, signed

DASHES = ((), (5.0, 2.0), (1.5, 1.5), (6.0, 2.0, 1.5, 2.0))
"""One an output, over and over."""
FEW = 3
"""Scenes that a headline names; more are counted."""
BUDGETS: tuple[tuple[Budget, str], ...] = (("steps", "equal steps"), ("seconds", "equal training time"))


def headline(first: Output, found: list[Against]) -> str:
    """What the others change of the first, in one sentence each."""
    said = []
    for one in found:
        if one.shared == 0:
            said.append(f"{one.other.name} and {first.name} have no cell in common")
        elif one.identical == one.shared and not one.alone:
            said.append(f"{one.other.name} has the same results as {first.name}, to the last bit")
        else:
            known = methods_of([first, one.other])
            places = {_place(first, one, method) for method in known} - {None}
            # said once where it is the same for all
            where = ", ".join(filter(None, [*(places if len(places) == 1 else []), _extent(one)]))
            verdicts = [f"{method} {_verdict(first, one, method, placed=len(places) > 1)}" for method in known]
            said.append(f"{one.other.name} against {first.name}{', ' if where else ''}{where}: {listed(verdicts)}")
    return "; ".join(said)


def _extent(one: Against) -> str:
    """How much the verdicts stand on, where it is not all of both."""
    return f"in the {one.shared} of {counted(one.shared + len(one.alone), 'cell')} that both have" if one.alone else ""


def _place(first: Output, one: Against, method: str) -> str | None:
    """The scenes that the verdict on a method is of, where they are not all of several; None without a verdict."""
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
    """The one over all scenes; else that of the first scene which both have."""
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
    """What a reader must know before the tables."""
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
    """Mean test PSNR of a method by scene in each output, and each difference to the first."""
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
    """The difference, its interval, the one that the verdict is taken from where it is wider, and the verdict."""
    aside = f"{counted(found.unpaired, 'pair')} not judged" if found.unpaired else ""
    one = found.chosen
    if found.difference is None:
        return Entry("–", lines(one.verdict, aside), one.verdict)
    wide = one.simultaneous if one.simultaneous != one.interval else None
    together = f"together: {interval(wide, digits)}" if wide else ""
    words = lines(" ".join(filter(None, [interval(one.interval, digits), one.verdict])), together, aside)
    return Entry(signed(found.difference, digits), words, one.verdict)


def metrics_grid(outputs: list[Output], found: list[Against]) -> Grid:
    """Every metric over all scenes, at equal steps."""
    columns = [Column("method", numeric=False), Column("metric", numeric=False)]
    columns += [Column(f"{one.other.letter} − {outputs[0].letter}") for one in found]
    rows = []
    for method in methods_of(outputs):
        for metric in METRICS:
            entries = [one.row(EVERYWHERE, method, metric) for one in found]
            if any(entries):
                digits = 2 if metric in ("psnr", "delta_e") else 4
                shown = [difference_entry(row.found, digits) if row else EMPTY for row in entries]
                rows.append([Entry(method), Entry(metric), *shown])
    return Grid("Every score over all scenes, at equal steps", columns, rows)


def seconds_grid(outputs: list[Output]) -> Grid:
    """Mean training seconds of the finished cells: what each clock said, judged by nobody."""
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
    """The answer of each output to its own question: what is compared with what, over all scenes."""
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
    """The printed claims that all outputs list and of which they do not all say the same."""
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
    """What differs in settings and origins."""
    columns = [Column("setting", numeric=False), *(Column(one.letter, numeric=False) for one in outputs)]
    parts = (("settings", "Settings that differ"), ("provenance", "Machine and versions that differ"))
    grids = []
    for part, caption in parts:
        rows = [[Entry(name), *map(Entry, values)] for name, values in unequal_facts(outputs, part)]
        grids.append(Grid(caption, columns, rows))
    return [grid for grid in grids if grid.rows]


def curves(outputs: list[Output]) -> list[Panel]:
    """Mean test PSNR over steps, scene by scene: a colour a method, a dash an output."""
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
