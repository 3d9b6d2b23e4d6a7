"""The blocks of numbers of runs; `python -m tools.published` writes them into the pages."""

from collections import Counter
from collections.abc import Iterable
from statistics import fmean, stdev

import numpy as np

from harness.records.cells import USUAL, Comparison
from harness.records.json_record import as_promised
from harness.records.study import Check, Studies
from harness.records.verdict import common
from harness.verdicts.changes import Condition, changes
from harness.verdicts.comparisons import judged
from reports.claims.estimands import SENSES, between, judged_in_words
from reports.data.outcome import between_runs, doubts, in_runs, shared
from reports.data.wording import BUDGETS, VERDICTS, counted, listed, number, signed
from reports.run.ceiling import lines_of
from tools.published.published_cells import Run, condition_of
from tools.published.replicates import (
    BASELINE,
    CONTROL,
    FAVOURITE,
    REPAIRED,
    answer,
    replicated,
    row,
    verdict_in,
)

DUELS = (
    *((FAVOURITE, BASELINE), (FAVOURITE, CONTROL)),
    *((REPAIRED, BASELINE), (REPAIRED, CONTROL)),
    (CONTROL, BASELINE),
)
NO_ESTIMATE = "–"
NONE_REPEATED = "Neither run was repeated on another instruction set."
NOT_REPEATED = "{} was not repeated on another instruction set."


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def with_estimates(head: Iterable[str], rows: list[tuple[str, ...]]) -> str:
    """Format a table without the columns that hold no estimate: one seed gives no interval on these scenes."""
    columns = list(zip(head, *rows, strict=True))
    head, *rows = zip(*(column for column in columns if set(column[1:]) != {NO_ESTIMATE}), strict=True)
    return table(head, rows)


def main_methods(run: Run) -> list[str]:
    return [method for method in run["methods"] if method in run["settings"]["methods"]]


def in_both(run: Run, other: Run) -> list[str]:
    return [method for method in main_methods(run) if method in main_methods(other)]


def estimate(comparison: Run, sense: str, replicates: Run | None = None) -> str:
    """Format `−0.13 to +0.50: sign and size open`; if a replicate does not repeat the words, what all share:
    `−0.13 to +0.50; +0.12 to +0.14 dB in three runs: above 0, size open`.
    """
    known = comparison[sense]
    pair = known and (known["simultaneous"] or known["interval"])
    if not pair:
        return NO_ESTIMATE
    runs = replicated(comparison, sense, replicates or {})
    if not runs.repeated:
        return f"{between(pair)}; {shared(runs.differences, runs.verdicts)}"
    return judged_in_words(pair, verdict_in(known))


def scale(run: Run) -> str:
    train, provenance, scene = run["settings"]["train"], run["provenance"], run["scenes"][0]
    network = f"{train['network']['depth']} × {train['network']['width']}"
    return (
        f"Published run: {counted(len(run['scenes']), 'scene')} × {counted(len(run['seeds']), 'seed')}, "
        f"{scene['width']} × {scene['height']} px, {network} networks, {run['settings']['budget']['steps']} steps; "
        f"{run['phases']['total'] / 60:.0f} minutes on {provenance['cores']} cores ({provenance['processor']}, "
        f"{train['precision']}), commit {provenance['commit']}."
    )


def result(run: Run, replicates: Run) -> str:
    gains = [claim for claim in run["claims"] if claim["id"] == "table2-average" and claim["printed"] is not None]
    printed = "".join(
        f"The paper prints {signed(gain['printed'], 1)} dB on average: **{gain['verdict']}**. " for gain in gains
    )
    repeated = "" if replicates.get("runs") else f"\n\n{NOT_REPEATED.format('The run')}"
    return f"{printed}**{answer(run, replicates)}.**\n\n{differences(run, replicates=replicates)}{repeated}"


def verdict(late: Run, early: Run, replicates: Run) -> str:
    """State the paper's claim and the differences of a late and of the default run in a few sentences."""
    printed = {claim["id"]: claim for claim in late["claims"]}.get("table2-average")
    early_too = {claim["id"]: claim for claim in early["claims"]}.get("table2-average")
    sentences = []
    if printed and early_too and printed["printed"] is not None:
        words = " and ".join(dict.fromkeys(f"**{claim['verdict']}**" for claim in (printed, early_too)))
        sentences.append(f"The paper prints {signed(printed['printed'], 1)} dB on average: {words}.")
    for run, repeats in ((late, None), (early, replicates)):
        parts = [
            f"`{FAVOURITE}` − `{against}` is {signed(duel['difference'])} dB "
            f"({estimate(duel, 'scenes_like_these', repeats)})"
            for against in (BASELINE, CONTROL)
            if (duel := row(run, "all", FAVOURITE, against))
        ]
        sentences.append(f"After {run['settings']['budget']['steps']} steps {listed(parts)}.")
    sentences.append(
        f"`{CONTROL}` is NeRF with φ's highest frequency. In brackets: 95 % intervals on scenes like these, and the "
        "verdict on sign and size (0.2 dB or more matters)."
    )
    sentences.append(NOT_REPEATED.format("The late run") if replicates.get("runs") else NONE_REPEATED)
    minutes = listed([f"{run['phases']['total'] / 60:.0f}" for run in (late, early)])
    commits = list(dict.fromkeys(run["provenance"]["commit"] for run in (late, early)))
    trained_at = f"commit{'s' * (len(commits) > 1)} {listed(commits)}"
    scene = late["scenes"][0]
    sentences.append(
        f"{counted(len(late['scenes']), 'scene')} × {counted(len(late['seeds']), 'seed')}, {scene['width']} × "
        f"{scene['height']} px; {minutes} minutes on {late['provenance']['cores']} cores; {trained_at}."
    )
    return " ".join(sentences)


def differences(run: Run, budget: str = "steps", replicates: Run | None = None) -> str:
    duels = {pair: duel for pair in DUELS if (duel := row(run, "all", *pair, budget))}
    rows = [
        (
            f"`{pair[0]}` − `{pair[1]}`",
            f"{signed(duel['difference'])} dB",
            *(estimate(duel, name, replicates) for name in SENSES),
        )
        for pair, duel in duels.items()
    ]
    head = (f"test PSNR, {BUDGETS[budget]}", "", *(f"{words}, 95 %" for words in SENSES.values()))
    notes = [words for duel in duels.values() for words in doubts(as_promised(duel, Comparison))]
    return "\n\n".join([with_estimates(head, rows), *notes])


def equal_time(run: Run, replicates: Run | None = None) -> str:
    steps, time = (condition_of(run, main_methods(run), equal_time) for equal_time in (False, True))
    words = f"from {BUDGETS[steps.budget]} to {BUDGETS[time.budget]}"
    return f"{differences(run, time.budget, replicates)}\n\n{changed(run, steps, time, words)}"


def changed(run: Run, before: Condition, after: Condition, words: str) -> str:
    """Tabulate by how much the difference of each pair changed between two situations, in both senses."""
    trained = [{cell.method for cell in side.cells} for side in (before, after)]
    methods = [method for method in main_methods(run) if all(method in side for side in trained)]
    by_pair = {(change.method, change.against): change for change in changes(USUAL.pairs(methods), before, after)}
    rows = []
    for pair in DUELS:
        if (change := by_pair.get(pair)) is None:
            continue
        size, scenes = change.judgement.difference or 0.0, change.by_scene.values()
        estimates = (
            judged_in_words(known.simultaneous, known.verdict) if known and known.simultaneous else NO_ESTIMATE
            for known in (change.judgement.on_these_scenes, change.judgement.scenes_like_these)
        )
        same = f"{sum(moved * size > 0 for moved in scenes)} of {counted(len(scenes), 'scene')}"
        rows.append((f"`{pair[0]}` − `{pair[1]}`", f"{signed(size)} dB", *estimates, same))
    head = (
        f"change of the difference {words}",
        "",
        *(f"{sense}, 95 %" for sense in SENSES.values()),
        "scenes with that sign",
    )
    return with_estimates(head, rows) if rows else ""


def training(run: Run) -> str:
    train = run["settings"]["train"]
    optimiser = train["optimiser"]["name"]
    named = optimiser.upper() if optimiser == "soap" else optimiser.capitalize()
    return f"{run['settings']['budget']['steps']} steps of {train['rays']} rays, {named}"


def second_run(run: Run, other: Run, replicates: Run) -> str:
    """Tabulate a second run next to the default run, to which `replicates` belong; scene by scene if scenes differ."""
    runs, methods = (run, other), in_both(run, other)
    names, others = ([scene["scene"] for scene in each["scenes"]] for each in runs)
    common = [name for name in names if name in others]
    same = len(common) == len(names) == len(others)
    sense, places = ("scenes_like_these", ["all"]) if same else ("on_these_scenes", common)
    rows: list[tuple[str, ...]] = []
    for place in places:
        where = f", mean of {counted(len(common), 'scene')}" if same else f" on {place}"
        inside = common if same else [place]
        rows += [(f"`{method}`{where}", *(_score(each, inside, method) for each in runs)) for method in methods]
        for pair in DUELS:
            duels = [row(each, place, *pair) for each in runs]
            if all(duels):
                differences = (
                    f"{signed(duel['difference'])} dB, {estimate(duel, sense, repeats)}"
                    for duel, repeats in zip(duels, (replicates if same else None, None), strict=True)
                    if duel
                )
                rows.append((f"`{pair[0]}` − `{pair[1]}`{'' if same else where}", *differences))
    gains = [{gained["method"]: gained["gain"] for gained in each["last_doubling"]} for each in runs]
    rows += [
        (f"`{method}`, last doubling", *(f"{signed(gain[method])} dB" for gain in gains))
        for method in methods
        if same and all(gain.get(method) is not None for gain in gains)
    ]
    words = "on scenes like these" if same else "on single scenes"
    head = (f"test PSNR; differences {words}, 95 %", *map(training, runs))
    seconds = OTHER_PROCESSORS if len(processors_of(*runs)) > 1 else ""
    notes = f"{NOT_REPEATED.format('The run of the second column')} {seconds}".rstrip()
    return "\n\n".join(filter(None, [table(head, rows), notes, _change_between(run, other, methods), scale(other)]))


def _change_between(run: Run, other: Run, methods: list[str]) -> str:
    same = all(density_of(run, method) == density_of(other, method) for method in methods)
    first, second = (condition_of(each, methods) for each in (run, other))
    change = changed(run, first, second, "from the first column to the second")
    return change if same else f"{change}\n\n{OWN_CONSTANTS}"


def _score(run: Run, scenes: list[str], method: str) -> str:
    """Format `28.34 dB, 23 core s`: the mean over scenes of the mean over seeds, and the mean cost of a cell."""
    psnr = fmean(fmean(psnr_of(run, scene, method)) for scene in scenes)
    cells = (cell for cell in run["cells"] if cell["method"] == method and cell["scene"] in scenes)
    return f"{number(psnr)} dB, {fmean(cell['train_core_seconds'] for cell in cells):.0f} core s"


def scores(run: Run) -> str:
    methods = main_methods(run)
    rows = [
        (
            scene["scene"],
            *(spread(psnr_of(run, scene["scene"], method)) for method in methods),
            *(number(scene[name], 1) for name in ("psnr_ceiling", "psnr_floor")),
        )
        for scene in run["scenes"]
    ]
    return table(("test PSNR, dB", *(f"`{method}`" for method in methods), "ceiling", "floor"), rows)


def psnr_of(run: Run, scene: str, method: str) -> list[float]:
    cells = (cell for cell in run["cells"] if (cell["scene"], cell["method"]) == (scene, method))
    return [cell["psnr"] for cell in cells if cell["psnr"] is not None]


def spread(values: list[float]) -> str:
    more = f" ± {number(stdev(values))}" if len(values) > 1 else ""
    return f"{number(fmean(values))}{more}" if values else "–"


OTHER_PROCESSORS = "The columns are of different processors: compare core seconds only inside a column."
RUNS_APART = "The two runs are of different processors, which alone move scores."
OWN_CONSTANTS = "In each column, every method has the constants that a search chose at the column's own scale."


def density_of(run: Run, method: str) -> tuple[float, float | None]:
    own = run["settings"]["train"]["own"][method]
    return own["density_scale"], own["start"]


def ceiling(run: Run, late: Run) -> str:
    """State the largest densities of early and late trainings, and which methods end at their unit of density."""
    ranges, bound = [], []
    for method in in_both(run, late):
        densities = [
            [cell["properties"]["largest_density"] for cell in side["cells"] if cell["method"] == method]
            for side in (run, late)
        ]
        ends = [f"{number(min(values), 0)} to {number(max(values), 0)}" for values in densities]
        ranges.append(f"`{method}` {ends[0]} early and {ends[1]} late")
        units = [density_of(side, method)[0] for side in (run, late)]
        shares = [value / unit for values, unit in zip(densities, units, strict=True) for value in values]
        if max(shares) <= 1.001:
            reached = sum(share >= 0.99 for share in shares)
            limit = " early and ".join(f"{unit:g}" for unit in dict.fromkeys(units))
            late_too = " late" if " early" in limit else ""
            bound.append(
                f"`{method}` cannot exceed {limit}{late_too}, and reaches it in {reached} of {len(shares)} trainings"
            )
    reached_in = f" {'; '.join(bound)}." if bound else ""
    return (
        f"Largest density of each training, per half of the box: {listed(ranges)}.{reached_in}\n\n{limits(run, late)}"
    )


def limits(*runs: Run) -> str:
    """State what the largest density of each bounded main method can show at the resolution of each run."""
    return "\n\n".join(
        f"After {run['settings']['budget']['steps']} steps: {line}"
        for run in runs
        for line in lines_of(
            (f"`{method}`", [cell["properties"] for cell in run["cells"] if cell["method"] == method])
            for method in main_methods(run)
        )
    )


def failed(run: Run) -> str:
    rates = run["failures"]["rates"]
    lost = [
        f"`{rate['method']}` in {rate['diverged'] + rate['collapsed']} of {counted(rate['runs'], 'run')} "
        f"(95 % interval {' to '.join(number(100 * end, 0) for end in rate['interval'])} %)"
        for rate in rates
        if rate["rate"]
    ]
    if lost:
        return f"Diverged or showed background alone: {listed(lost)}; differences are of the others."
    return f"None of {sum(rate['runs'] for rate in rates)} runs diverged or showed background alone."


def ledger(run: Run) -> str:
    many = Counter(claim["verdict"] for claim in run["claims"])
    verdicts = listed([f"{many[verdict]} {verdict}" for verdict in VERDICTS if many[verdict]])
    return f"Of {len(run['claims'])} statements of the paper: {verdicts}." if run["claims"] else ""


def doubling(run: Run) -> str:
    """State the gain of each method from the last doubling of the steps, and the cost of training."""
    rows = {gained["method"]: gained for gained in run["last_doubling"]}
    named = [
        f"`{method}` {signed(rows[method]['gain'])} dB ({between(rows[method]['interval'])})"
        for method in main_methods(run)
        if method in rows and rows[method]["gain"] is not None
    ]
    spent = [cell["train_core_seconds"] for cell in run["cells"] if cell["method"] == BASELINE]
    known = [seconds for seconds in spent if seconds is not None]
    cost = f" A cell of `{BASELINE}` takes {fmean(known):.0f} core seconds of training." if known else ""
    return f"The last doubling of the steps brought {listed(named)}.{cost}" if named else ""


def processors_of(*runs: Run) -> set[str]:
    return {run["provenance"]["processor"] for run in runs}


def twice_the_steps(shorter: Run, longer: Run) -> str:
    """Tabulate the effect of twice the steps, between two trainings of the same constants and within the longer one."""
    if any(density_of(shorter, method) != density_of(longer, method) for method in (BASELINE, FAVOURITE)):
        return ""
    cells = [
        {(cell["scene"], cell["seed"], cell["method"]): cell["psnr"] for cell in run["cells"]}
        for run in (shorter, longer)
    ]
    shared = [key for key in cells[0] if key in cells[1]]
    scenes, seeds = (sorted({key[place] for key in shared}) for place in (0, 1))
    before, after = (
        {
            method: np.array([[scores[scene, seed, method] for seed in seeds] for scene in scenes], dtype=np.float64)
            for method in (BASELINE, FAVOURITE)
        }
        for scores in cells
    )

    def mean_of(differences: np.ndarray) -> str:
        mean = judged(dict(zip(scenes, differences, strict=True)), "psnr", family=1)
        return _with_interval(mean.difference, mean.chosen.interval)

    steps = " and ".join(str(run["settings"]["budget"]["steps"]) for run in (shorter, longer))
    scale = f"{steps} steps; {counted(len(scenes), 'scene')}, {counted(len(seeds), 'seed')}"
    entries = {}
    own = {gained["method"]: gained for gained in longer["last_doubling"]}
    for method in before:
        entries[f"`{method}`, longer training − shorter"] = mean_of(after[method] - before[method])
        within = own[method]  # over all seeds of the run; the other rows use only the seeds of both runs
        entries[f"`{method}`, last doubling of the longer, all its cells"] = _with_interval(
            within["gain"], within["interval"]
        )
    for scores, which in ((before, "shorter"), (after, "longer")):
        entries[f"`{FAVOURITE}` − `{BASELINE}`, {which}"] = mean_of(scores[FAVOURITE] - scores[BASELINE])
    rows = table(("test PSNR, 95 %", scale), entries.items())
    return f"{rows}\n\n{RUNS_APART}" if len(processors_of(shorter, longer)) > 1 else rows


def _with_interval(gain: float | None, interval: tuple[float, float] | None) -> str:
    return f"{signed(gain)} dB{f', {between(interval)}' if interval else ''}"


def processors(run: Run, published: Run, replicates: Run) -> str:
    """State how far scores move on another processor, and what the published run and the replicates share."""
    here = ", ".join(
        f"{place.replace('_', ' ')} {listed(ours)} and {listed(theirs)}"
        for place, (ours, theirs) in run["origins"].items()
    )
    by_verdict: dict[str, list[str]] = {}
    for first, second in DUELS:
        if (duel := row(published, "all", first, second)) is None:
            continue
        runs = replicated(duel, "scenes_like_these", replicates)
        unlike = "" if runs.repeated else f", published as {runs.verdicts[0].phrase}"
        pair = f"`{first}` − `{second}` ({in_runs(runs.differences)}{unlike})"
        by_verdict.setdefault(common(runs.verdicts).phrase, []).append(pair)
    stated = "; ".join(f"*{phrase}* for {listed(pairs)}" for phrase, pairs in by_verdict.items())
    return (
        f"The same plan and seeds on another processor or instruction set (here: {here}) {_moved(run)} "
        f"(`python -m harness compare A B`). What the published run and these share over all scenes: {stated}."
    )


def on_a_gpu(apart: Run, again: Run, there: Run, speed: Studies, here: Run) -> str:
    """State how far a GPU's scores are from the processor's, whether it repeats its bits, and how fast it is."""
    key = ("scene", "method", "seed")
    cell = next(cell for cell in there["cells"] if cell["method"] == BASELINE)
    alike = next(other for other in here["cells"] if all(other[name] == cell[name] for name in key))
    measured = {check.id: check for _, check in speed.checks()}
    plain, ours, bfloat16 = (
        number(measured[f"training.dense.{side}.rate"].value) for side in ("plain", "float32", "accelerated")
    )
    share = measured["matrix.paper.share"]
    return (
        f"One GPU was tried, an {there['provenance']['device']}. Against a processor, the same plan and seeds "
        f"{_moved(apart)}. Made again, {again['identical']} of {again['all']['cells']} trainings had the same scores "
        "to the last bit.\n\n"
        f"It is not for small networks: at the reduced settings `{BASELINE}` on {cell['scene']} takes "
        f"{cell['train_seconds']:.0f} s there and {alike['train_core_seconds']:.0f} core seconds here, and a step "
        f"uses {number(measured['matrix.reduced.share'].value)} % of the GPU's matrix rate. A step of the paper's "
        f"network uses {number(share.value)} % (target: {target(share)}). It trains on {bfloat16} million samples a "
        f"second in bfloat16 and on {ours} in float32; plain torch, in float32, on {plain}."
    )


def _moved(run: Run) -> str:
    """State how far scores moved, and how far the differences at equal steps moved, if that was recorded."""
    moves, signed_moves = [], []
    for move in run.get("moved", ()):
        known = move["scenes_like_these"] or move["on_these_scenes"]
        if move["budget"] == "steps" and known and known["simultaneous"]:
            moves.append(move["difference"])
            if (verdict := verdict_in(known)).sign != "open":
                words = judged_in_words(known["simultaneous"], verdict)
                pair = f"`{move['method']}` − `{move['against']}`"
                signed_moves.append(f"{pair} {signed(move['difference'])} dB ({words})")
    signs = f"with a sign: {listed(signed_moves)}" if signed_moves else "no sign is known of any"
    return (
        f"move a training's score by {number(run['all']['rms'])} dB (RMS of {run['all']['cells']}; at most "
        f"{number(abs(run['all']['largest']))})"
        f"{f', and the differences over all scenes by {between_runs(moves)} ({signs})' if moves else ''}"
    )


def target(measured: Check) -> str:
    return f"{measured.limit:g} {measured.unit}, {'met' if measured.holds else '**missed**'}"
