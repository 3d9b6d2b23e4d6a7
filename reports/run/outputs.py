"""Several outputs side by side → outputs.html: each against the first, cell by cell, judged like methods."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from harness.records.cells import Budget, CellRecord, Comparison
from harness.records.metric_table import METRICS, PRIMARY, Metric
from harness.verdicts.comparisons import Judgement, differences, family_of, judged, scored_along
from reports.claims.claim_list import claims
from reports.claims.psnr_table import lines, losses, spent_entry, tone_of
from reports.data.load import Records
from reports.data.table import cells_frame, curves_frame, spread_of
from reports.data.wording import BUDGETS, NOTHING, counted, interval, listed, number, signed, tone_of_sign
from reports.drawing.figure import plots, with_common_limits
from reports.drawing.palette import colours_of
from reports.drawing.traces import Panel, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid
from reports.page.shell import Layout, section, settings_rows
from reports.run.curves import middle_of, points_of
from scenes.files.atomic import write_atomically

EVERYWHERE = "all"
PSNR = METRICS[PRIMARY]
ALIKE: tuple[Budget, ...] = ("steps", "seconds")
"""The budgets at which outputs are compared."""
FIRST, OTHER = "first", "other"
SAME_CLOCK = ("processor", "cores", "threads", "waiting", "device")
"""The facts that two runs must share before seconds are compared; without `waiting`, batches were not counted."""
DASHES = (("solid:", ()), ("dashed:", (5.0, 2.0)), ("dotted:", (1.5, 1.5)), ("dash-dotted:", (6.0, 2.0, 1.5, 2.0)))
"""The dashes of the outputs; further outputs start again from the first."""
FEW = 3
ABOUT_SCORES = (
    "Means over finished seeds ± sample standard deviation. A difference is paired by scene and seed, and judged like "
    "a difference between methods: its 95 % interval, below it the wider interval of all that are looked at together, "
    "from which the verdict is taken."
)


@dataclass(frozen=True)
class Output:
    letter: str
    name: str
    records: Records


@dataclass(frozen=True)
class Against:
    other: Output
    identical: int
    shared: int
    unshared: list[str]
    """The names of the cells that only one of them has."""
    unlike: dict[str, str]
    """Scene → how its ground truth differs, so that its scores are not comparable."""
    same_clock: bool
    rows: dict[tuple[str, str, str, str], Judgement]
    """Scene (or `all` with the same ground truth), method, metric and budget → the difference `other` − `first`."""

    def row(self, scene: str, method: str, metric: str = PRIMARY, budget: str = "steps") -> Judgement | None:
        return self.rows.get((scene, method, metric, budget))


def named(runs: list[Records]) -> list[Output]:
    """Name each run by the shortest end of its path that no other path has."""
    paths = [records.out.resolve() for records in runs]

    def name(path: Path) -> str:
        ends = [path.parts[-many:] for many in range(1, len(path.parts))]
        unique = (end for end in ends if sum(other.parts[-len(end) :] == end for other in paths) == 1)
        return "/".join(next(unique, path.parts))

    return [Output(chr(ord("A") + place), name(paths[place]), records) for place, records in enumerate(runs)]


def against(first: Output, other: Output) -> Against:
    """Compare `other` with `first`, over the scenes, methods and seeds that both have."""
    ours, theirs = ({(c.scene, c.method, c.seed): c for c in output.records.cells} for output in (first, other))
    pairs = [(ours[key], theirs[key]) for key in ours if key in theirs]
    unlike = {pair[0].scene: why for pair in reversed(pairs) if (why := other_truth(*pair))}
    origins = [output.records.run.provenance for output in (first, other)]
    same_clock = all(origins[0].get(fact) == origins[1].get(fact) for fact in SAME_CLOCK)
    unshared = [
        f"{scene} · {method} · seed {seed} only in {(first if (scene, method, seed) in ours else other).name}"
        for scene, method, seed in ours.keys() ^ theirs.keys()
    ]
    identical = sum(results(cell) == results(another) for cell, another in pairs)
    rows = _rows([pair for pair in pairs if pair[0].scene not in unlike], same_clock)
    return Against(other, identical, len(pairs), sorted(unshared), unlike, same_clock, rows)


def results(cell: CellRecord) -> tuple[object, ...]:
    """Return a cell's numbers: status, steps, scores, curve without its clock, scores by view."""
    curve = [(point.step, point.network_evaluations, point.psnr, point.rmse_linear) for point in cell.curve]
    return cell.status, cell.steps, cell.scores, curve, cell.views


def other_truth(cell: CellRecord, other: CellRecord) -> str:
    """Return why two cells were not scored against the same images; nothing if they were."""
    first, second = (own.settings.get("view_set") or {} for own in (cell, other))
    for key, words in (("width", "px wide"), ("height", "px high"), ("test", "test views")):
        if first.get(key) != second.get(key):
            return f"{first.get(key)} against {second.get(key)} {words}"
    return "other images of the same size" if first.get("digest") != second.get("digest") else ""


def _rows(pairs: list[tuple[CellRecord, CellRecord]], same_clock: bool) -> dict[tuple[str, str, str, str], Judgement]:
    rows: dict[tuple[str, str, str, str], Judgement] = {}
    budgets = ALIKE if same_clock else ALIKE[:1]
    for method in dict.fromkeys(cell.method for cell, _ in pairs):
        own = [pair for pair in pairs if pair[0].method == method]
        keyed = {(cell.scene, FIRST, cell.seed): cell for cell, _ in own}
        keyed |= {(cell.scene, OTHER, cell.seed): cell for _, cell in own}
        seeds, scenes = sorted({cell.seed for cell, _ in own}), list(dict.fromkeys(cell.scene for cell, _ in own))
        has = {scene: np.array([(scene, FIRST, seed) in keyed for seed in seeds]) for scene in scenes}
        common = np.all(list(has.values()), axis=0)
        for metric, about in METRICS.items():
            along = scored_along((cell for pair in own for cell in pair), metric)
            for budget in budgets if along else budgets[:1]:
                table = differences(keyed, scenes, seeds, OTHER, FIRST, metric, budget)
                if about.optional and not any(np.isfinite(values).any() for values in table.values()):
                    continue
                # a seed that neither run has on a scene is not a lost pair
                started = {scene: values[has[scene]] for scene, values in table.items()}
                for scene in scenes:
                    family = family_of(metric, scene, len(scenes))
                    rows[scene, method, metric, budget] = judged(started, metric, family, scene)
                if len(scenes) > 1 and common.any():
                    shared = {scene: values[common] for scene, values in table.items()}
                    family = family_of(metric, EVERYWHERE, len(scenes))
                    rows[EVERYWHERE, method, metric, budget] = judged(shared, metric, family)
    return rows


def headline(first: Output, others: list[Against]) -> str:
    return "; ".join(_sentence(first, versus) for versus in others)


def _sentence(first: Output, versus: Against) -> str:
    name, both = versus.other.name, [first, versus.other]
    if versus.shared == 0:
        return f"{name} and {first.name} have no cell in common"
    if versus.identical == versus.shared and not versus.unshared:
        return f"{name} has the same results as {first.name}, to the last bit"
    every, compared = scenes_of(both), {scene for scene, *_ in versus.rows}
    scenes = [scene for scene in every if scene in compared]
    words = [f"{name} against {first.name}"]
    if not len(scenes) == len(every) > 1:
        some = f"only on {listed(scenes)}" if len(scenes) <= FEW else f"on {len(scenes)} of {len(every)} scenes"
        words.append(some)
    if versus.unshared:
        every_cell = counted(versus.shared + len(versus.unshared), "cell")
        words.append(f"in the {versus.shared} of {every_cell} that both have")
    verdicts = []
    for method in methods_of(both):
        row = next(filter(None, (versus.row(scene, method) for scene in (EVERYWHERE, *scenes))), None)
        same = row and row.difference == 0 and row.chosen.interval == (0.0, 0.0)
        change = f"{signed(row.difference)} dB ({row.chosen.verdict.phrase})" if row else "not compared"
        verdicts.append(f"{method} {'the same' if same else change}")
    return f"{', '.join(words)}: {listed(verdicts)}"


def methods_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(method for output in outputs for method in output.records.methods))


def scenes_of(outputs: list[Output]) -> list[str]:
    return list(dict.fromkeys(scene for output in outputs for scene in output.records.scenes))


def sentences(first: Output, others: list[Against]) -> list[str]:
    notes = []
    for versus in others:
        name, unshared = versus.other.name, versus.unshared
        if versus.shared:
            same = f"{versus.identical} of {counted(versus.shared, 'cell')}"
            notes.append(f"{same} that {first.name} and {name} share have the same results bit for bit.")
        if unshared:
            more = f" and {len(unshared) - 3} more" if len(unshared) > 3 else ""
            notes.append(f"Not compared: {', '.join(unshared[:3])}{more}.")
        if versus.unlike:
            why = listed([f"{scene} ({reason})" for scene, reason in versus.unlike.items()])
            notes.append(f"{name} has a different ground truth in {why}: shown, and not judged.")
        if not versus.same_clock:
            notes.append(f"{name} ran on another kind of machine or was timed otherwise: seconds are not compared.")
    return notes


def scores_grid(outputs: list[Output], others: list[Against], method: str) -> Grid:
    frames = [cells_frame(output.records) for output in outputs]
    shown = [(versus, budget) for versus in others for budget in (ALIKE if versus.same_clock else ALIKE[:1])]
    columns = [Column("scene", numeric=False), *(Column(output.letter, small=output.name) for output in outputs)]
    columns += [
        Column(f"{versus.other.letter} − {outputs[0].letter}", small=f"at {BUDGETS[budget]}")
        for versus, budget in shown
    ]

    def changes(scene: str) -> list[Entry]:
        return [difference_entry(versus.row(scene, method, budget=budget), PSNR) for versus, budget in shown]

    rows = []
    for scene in scenes_of(outputs):
        row = [Entry(scene)]
        for output, frame in zip(outputs, frames, strict=True):
            cells, spread = output.records.cells_of(scene, method), spread_of(frame, scene, method, "psnr")
            text = number(spread.mean) + (f" ± {number(spread.sd)}" if spread.sd is not None else "")
            row.append(Entry(text, losses(cells), tone_of(cells), spread.mean) if cells else EMPTY)
        rows.append([*row, *changes(scene)])
    total = [Entry("all scenes"), *([EMPTY] * len(outputs)), *changes(EVERYWHERE)]
    return Grid(f"{method}: test PSNR (dB)", columns, rows, [total] if len(rows) > 1 else [])


def difference_entry(row: Judgement | None, metric: Metric) -> Entry:
    """Return the difference, its interval and verdict, and the verdict's own interval where that is wider."""
    digits = metric.digits_of_difference
    if row is None:
        return EMPTY
    chosen, lost = row.chosen, f"{counted(row.unpaired, 'pair')} not judged" if row.unpaired else ""
    if row.difference is None:
        return Entry(NOTHING, lines(chosen.verdict.phrase, lost), "open")
    wide = chosen.simultaneous if chosen.simultaneous != chosen.interval else None
    together = f"together: {interval(wide, digits)}" if wide else ""
    tone = tone_of_sign(chosen.verdict.sign, metric.higher_is_better)
    verdict = f"{interval(chosen.interval, digits)} {chosen.verdict.phrase}".strip()
    return Entry(signed(row.difference, digits), lines(verdict, together, lost), tone, row.difference)


def metrics_grid(outputs: list[Output], others: list[Against]) -> Grid:
    columns = [Column("method", numeric=False), Column("metric", numeric=False)]
    columns += [Column(f"{versus.other.letter} − {outputs[0].letter}") for versus in others]
    rows = []
    for method in methods_of(outputs):
        for metric, about in METRICS.items():
            changes = [versus.row(EVERYWHERE, method, metric) for versus in others]
            if any(changes):
                shown = [difference_entry(row, about) for row in changes]
                rows.append([Entry(method), Entry(metric), *shown])
    return Grid("Every score over all scenes, at equal steps", columns, rows)


def _by_output(caption: str, label: str, outputs: list[Output], rows: list[list[Entry]], numeric: bool = False) -> Grid:
    columns = [Column(label, numeric=False), *(Column(output.letter, numeric=numeric) for output in outputs)]
    return Grid(caption, columns, rows)


def seconds_grid(outputs: list[Output]) -> Grid:
    rows = []
    for method in methods_of(outputs):
        row = [Entry(method)]
        for output in outputs:
            done = [cell for cell in output.records.cells if (cell.method, cell.status) == (method, "done")]
            spent = spent_entry(done)
            row.append(replace(spent, small=lines(spent.small, counted(len(done), "cell"))) if done else EMPTY)
        rows.append(row)
    grid = _by_output("Training time per cell", "method", outputs, rows, numeric=True)
    return replace(grid, note="Means over the finished cells of each output.")


def verdicts_grid(outputs: list[Output]) -> Grid:
    answers = [
        {
            (comparison.method, comparison.against, comparison.budget): comparison
            for comparison in output.records.comparisons
            if (comparison.scene, comparison.metric) == (EVERYWHERE, PRIMARY) and comparison.difference is not None
        }
        for output in outputs
    ]

    def answer(comparison: Comparison | None) -> Entry:
        if comparison is None:
            return EMPTY
        words = lines(interval(comparison.interval), comparison.verdict.phrase)
        tone = tone_of_sign(comparison.verdict.sign)
        return Entry(signed(comparison.difference), words, tone, comparison.difference)

    rows = [
        [Entry(f"{key[0]} − {key[1]}", f"at {BUDGETS[key[2]]}"), *(answer(own.get(key)) for own in answers)]
        for key in dict.fromkeys(key for own in answers for key in own)
    ]
    caption = "What each output says: difference in test PSNR over its scenes (dB)"
    return _by_output(caption, "comparison", outputs, rows, numeric=True)


def claims_grid(outputs: list[Output]) -> Grid:
    """Tabulate the claims that all outputs list and on which their verdicts differ."""
    ledgers = [{claim.id: claim for claim in claims(output.records)} for output in outputs]
    rows = []
    for name, claim in ledgers[0].items():
        verdicts = [ledger[name].verdict for ledger in ledgers if name in ledger]
        if len(verdicts) == len(outputs) and len(set(verdicts)) > 1:
            rows.append([Entry(claim.statement, name), *map(Entry, verdicts)])
    return _by_output("Claims on which the outputs disagree", "claim", outputs, rows)


def facts_grid(outputs: list[Output], part: str, caption: str) -> Grid:
    """Tabulate the values of a part of the runs' records, `settings` or `provenance`, that differ between outputs."""
    facts = [dict(settings_rows(getattr(output.records.run, part))) for output in outputs]
    rows = []
    for name in dict.fromkeys(name for own in facts for name in own):
        values = [own.get(name, NOTHING) for own in facts]
        if len(set(values)) > 1:
            rows.append([Entry(name), *map(Entry, values)])
    return _by_output(caption, "setting", outputs, rows)


def curves(outputs: list[Output]) -> list[Panel]:
    frames = [curves_frame(output.records) for output in outputs]
    points = [points_of(frame.assign(x=frame["step"], y=frame["psnr"])) for frame in frames]
    panels = []
    for scene in scenes_of(outputs):
        traces = []
        for place, (output, known) in enumerate(zip(outputs, points, strict=True)):
            done = known[(known["scene"] == scene) & (known["status"] == "done")]
            for method, colour in colours_of(methods_of(outputs)).items():
                mean = middle_of(done[done["method"] == method], log=False)
                if len(mean):
                    x, y = (tuple(map(float, mean[name])) for name in "xy")
                    dash = DASHES[place % len(DASHES)][1]
                    traces.append(Trace(f"{output.letter}: {method}", colour.light, "line", x, y, dash=dash, width=1.6))
        if traces:
            ends = "; ".join(f"{trace.label} {number(trace.y[-1])} dB" for trace in traces)
            alt = f"{scene}: mean test PSNR against steps. At the end: {ends}."
            panels.append(Panel(scene, "training step", "test PSNR (dB)", tuple(traces), alt, "log", "linear"))
    return with_common_limits(panels, "x")


def outputs_page(runs: list[Records]) -> tuple[str, str]:
    outputs = named(runs)
    others = [against(outputs[0], other) for other in outputs[1:]]
    methods = methods_of(outputs)
    layout = Layout(colours_of(methods))
    parts, title = layout.parts, headline(outputs[0], others)
    drawn = plots(curves(outputs), "curves")
    looks = [(DASHES[place % len(DASHES)][0], f" {output.letter}") for place, output in enumerate(outputs)]
    legend = parts.legend([*((parts.swatch(method), method) for method in methods), *looks])
    facts = [
        parts.table(facts_grid(outputs, "settings", "Settings that differ")),
        parts.table(facts_grid(outputs, "provenance", "Machine and versions that differ")),
    ]
    same = "" if any(facts) else "Nothing: settings, versions and machine are the same."
    scores = [parts.table(scores_grid(outputs, others, method)) for method in methods]
    answers = parts.table(verdicts_grid(outputs))
    judged_otherwise = parts.table(claims_grid(outputs)) if answers else answers
    sections = [
        section("scores", "Scores", *scores, parts.paragraph(ABOUT_SCORES, "note")),
        section("verdicts", "Does the answer change?", answers, judged_otherwise),
        section("curves", "Convergence", *([legend, parts.figures(drawn)] if drawn else [])),
        section("metrics", "Other scores", parts.table(metrics_grid(outputs, others), False)),
        section("seconds", "Training time", parts.table(seconds_grid(outputs), False)),
        section("facts", "What differs in how they were made", *facts, parts.paragraph(same)),
    ]
    notes = sentences(outputs[0], others)
    return title, layout.page("outputs_page.html", title, sections, [], outputs=outputs, sentences=notes)


def write_outputs_page(runs: list[Records], path: Path) -> str:
    title, text = outputs_page(runs)
    write_atomically(path, text, fsync=False)
    return title
