"""python -m reports.run.saving.published: the numbers of README.md and docs, written from what is published.

    <!-- numbers: NAME -->
    what `block(NAME, docs)` makes of docs/*.json
    <!-- end -->

A block is empty if a file of it is not published, or was measured before all methods had one unit of density: its
figures would be those of another program.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from harness.records.study import Studies, read_studies
from reports.claims.estimands import SENSES, between
from reports.claims.headline import BASELINE, CONTROL, FAVOURITE
from reports.data.wording import BUDGETS, VERDICTS, counted, interval, listed, number, signed, significant

Run = dict[str, Any]
"""The content of a published JSON file that is no record of studies."""
SAYS = {
    "better": "scores above",
    "worse": "scores below",
    "equivalent": "scores the same within the margin as",
    "inconclusive": "is not told apart from",
}
"""Map verdict → the verb of a sentence about it: no other words compare two methods on these pages."""
DUELS = ((FAVOURITE, BASELINE), (FAVOURITE, CONTROL), (CONTROL, BASELINE))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    head = list(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def main_methods(run: Run) -> list[str]:
    """Return the methods that were trained on every scene."""
    return [method for method in run["methods"] if method in run["settings"]["methods"]]


def row(run: Run, scene: str, method: str, against: str, budget: str = "steps") -> Run | None:
    """Return the comparison of two methods by PSNR; None if there is no difference."""
    asked = {"scene": scene, "method": method, "against": against, "metric": "psnr", "budget": budget}
    rows = (comparison for comparison in run["comparisons"] if asked.items() <= comparison.items())
    return next((effect for effect in rows if effect["difference"] is not None), None)


def estimate(comparison: Run, sense: str) -> str:
    """Format `−0.13 to +0.50: inconclusive`, of the interval that the verdict is taken from."""
    known = comparison[sense]
    pair = known and (known["simultaneous"] or known["interval"])
    return f"{between(pair)}: {known['verdict']}" if pair else "–"


def scale(run: Run) -> str:
    """State the scale at which the default run was measured, and its machine."""
    train, provenance, scene = run["settings"]["train"], run["provenance"], run["scenes"][0]
    network = f"{train['network']['depth']} × {train['network']['width']}"
    return (
        f"Published run: {counted(len(run['scenes']), 'scene')} × {counted(len(run['seeds']), 'seed')}, "
        f"{scene['width']} × {scene['height']} px, {network} networks, {run['settings']['budget']['steps']} steps; "
        f"{run['phases']['total'] / 60:.0f} minutes on {provenance['cores']} cores ({provenance['processor']}, "
        f"{train['precision']}), commit {provenance['commit']}."
    )


def result(run: Run) -> str:
    """State the answer, the printed gain, and who scores how much more than whom, asked twice."""
    gain = next(
        (claim for claim in run["claims"] if claim["id"] == "table2-average" and claim["printed"] is not None), None
    )
    printed = f" The paper prints {signed(gain['printed'], 1)} dB on average: *{gain['verdict']}*." if gain else ""
    return f"**{run['headline']}.**{printed}\n\n{differences(run)}"


def differences(run: Run, budget: str = "steps") -> str:
    rows = [
        (f"`{pair[0]}` − `{pair[1]}`", f"{signed(duel['difference'])} dB", *(estimate(duel, name) for name in SENSES))
        for pair in DUELS
        if (duel := row(run, "all", *pair, budget))
    ]
    return table((f"test PSNR, {BUDGETS[budget]}", "", *(f"{words}, 95 %" for words in SENSES.values())), rows)


def training(run: Run) -> str:
    """State what a cell was given: steps, rays, optimiser."""
    train = run["settings"]["train"]
    optimiser = train["optimiser"]["name"]
    named = optimiser.upper() if optimiser == "soap" else optimiser.capitalize()
    return f"{run['settings']['budget']['steps']} steps of {train['rays']} rays, {named}"


def beside(run: Run, other: Run) -> str:
    """Tabulate a second run of the same methods beside the default one: over all scenes if both have the same, else
    scene by scene.
    """
    runs = (run, other)
    names, others = ([scene["scene"] for scene in each["scenes"]] for each in runs)
    common = [name for name in names if name in others]
    whole = len(common) == len(names) == len(others)
    sense, places = ("scenes_like_these", ["all"]) if whole else ("on_these_scenes", common)
    rows: list[tuple[str, ...]] = []
    verdicts = []
    for place in places:
        where = f", mean of {counted(len(common), 'scene')}" if whole else f" on {place}"
        inside = common if whole else [place]
        rows += [
            (f"`{method}`{where}", *(_score(each, inside, method) for each in runs)) for method in main_methods(run)
        ]
        for pair in DUELS:
            duels = [row(each, place, *pair) for each in runs]
            if all(duels):
                verdicts.append([duel[sense]["verdict"] for duel in duels if duel])
                told = (f"{signed(duel['difference'])} dB, {estimate(duel, sense)}" for duel in duels if duel)
                rows.append((f"`{pair[0]}` − `{pair[1]}`{'' if whole else where}", *told))
    gains = [{gained["method"]: gained["gain"] for gained in each["last_doubling"]} for each in runs]
    rows += [
        (f"`{method}`, last doubling", *(f"{signed(gain[method])} dB" for gain in gains))
        for method in main_methods(run)
        if whole and all(gain.get(method) is not None for gain in gains)
    ]
    same = sum(len(set(pair)) == 1 for pair in verdicts)
    words = "on scenes like these" if whole else "on single scenes"
    head = (f"test PSNR; differences {words}, 95 %", *map(training, runs))
    return f"{same} of {len(verdicts)} verdicts are the same.\n\n{table(head, rows)}\n\n{scale(other)}"


def _score(run: Run, scenes: list[str], method: str) -> str:
    """Format `28.34 dB, 23 core s`: the mean over scenes of the mean over seeds, and the mean cost of a cell."""
    psnr = fmean(fmean(psnr_of(run, scene, method)) for scene in scenes)
    cells = (cell for cell in run["cells"] if cell["method"] == method and cell["scene"] in scenes)
    return f"{number(psnr)} dB, {fmean(cell['train_core_seconds'] for cell in cells):.0f} core s"


def scores(run: Run) -> str:
    """Tabulate test PSNR by scene, with the ceiling that the truth's noise sets, and the floor: the nearest training
    view.
    """
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
    """Return the scores, one per seed."""
    cells = (cell for cell in run["cells"] if (cell["scene"], cell["method"]) == (scene, method))
    return [cell["psnr"] for cell in cells if cell["psnr"] is not None]


def spread(values: list[float]) -> str:
    """Format mean ± standard deviation over seeds."""
    more = f" ± {number(stdev(values))}" if len(values) > 1 else ""
    return f"{number(fmean(values))}{more}" if values else "–"


def explained_scene(run: Run) -> str:
    """Return the scene of the further methods; empty if there are none."""
    return next((cell["scene"] for cell in run["cells"] if cell["method"] not in main_methods(run)), "")


def why(run: Run) -> str:
    """State the effect of the unit of density, and the printed form apart."""
    scene = explained_scene(run)
    sentences, moved = [], []
    scales: set[float] = set()
    for base in (BASELINE, FAVOURITE):
        means = {
            unit["scale"]: fmean(psnr)
            for method, unit in run["settings"]["density_units"].items()
            if method.split("_unit_")[0] == base and (psnr := psnr_of(run, scene, method))
        }
        scales |= means.keys()
        if len(means) > 1:
            least, most = min(means.values()), max(means.values())
            moved.append(f"`{base}` scores {number(least, 1)} to {number(most, 1)} dB")
    if moved:
        units = f"{min(scales):g} and {max(scales):g} units of density per half of the box"
        sentences.append(f"Between {units}, {listed(moved)} on {scene}.")
    if printed := row(run, scene, f"{FAVOURITE}_printed", BASELINE):
        sentences.append(
            f"`{printed['method']}` {SAYS[printed['verdict']]} `{BASELINE}` there: {signed(printed['difference'])} dB "
            f"({between(printed['simultaneous'] or printed['interval'])})."
        )
    return " ".join(sentences)


def further(run: Run) -> str:
    """Tabulate the methods that were trained on one scene alone, without the ladder."""
    scene = explained_scene(run)
    rows = [
        (f"`{method}`", title, f"{signed(duel['difference'])} dB, {estimate(duel, 'on_these_scenes')}")
        for method, title in run["methods"].items()
        if method not in main_methods(run) and "_unit_" not in method and (duel := row(run, scene, method, BASELINE))
    ]
    return table((f"on {scene}", "what it is", f"− `{BASELINE}`, 95 % on this scene"), rows) if rows else ""


def failed(run: Run) -> str:
    """State how often runs diverged or collapsed."""
    rates = run.get("failures", {}).get("rates", [])
    lost = [
        f"`{rate['method']}` in {rate['diverged'] + rate['collapsed']} of {counted(rate['runs'], 'run')} "
        f"(95 % interval {' to '.join(number(100 * end, 0) for end in rate['interval'])} %)"
        for rate in rates
        if rate["rate"]
    ]
    if lost:
        return f"Diverged or showed background alone: {listed(lost)}; differences are of the others."
    return f"None of {sum(rate['runs'] for rate in rates)} runs diverged or showed background alone." if rates else ""


def ledger(run: Run) -> str:
    """State how many printed statements came out how."""
    many = Counter(claim["verdict"] for claim in run["claims"])
    verdicts = listed([f"{many[verdict]} {verdict}" for verdict in VERDICTS if many[verdict]])
    return f"Of {len(run['claims'])} statements of the paper: {verdicts}." if run["claims"] else ""


def doubling(run: Run) -> str:
    """State what the last doubling of the steps brought each method, and what training cost."""
    rows = {gained["method"]: gained for gained in run.get("last_doubling", [])}
    named = [
        f"`{method}` {signed(rows[method]['gain'])} dB ({between(rows[method]['interval'])})"
        for method in main_methods(run)
        if method in rows and rows[method]["gain"] is not None
    ]
    spent = [cell.get("train_core_seconds") for cell in run["cells"] if cell["method"] == BASELINE]
    known = [seconds for seconds in spent if seconds is not None]
    cost = f" A cell of `{BASELINE}` takes {fmean(known):.0f} core seconds of training." if known else ""
    return f"The last doubling of the steps brought {listed(named)}.{cost}" if named else ""


def learning(swept: Run) -> str:
    """Tabulate the means of a sweep over its scenes and methods, the best settings first."""
    arms: dict[tuple[str, ...], list[Run]] = {}
    for row in swept["rows"]:
        arms.setdefault(_settings_in_words(row["tried"]), []).append(row)
    averaged = [
        (fmean(row["psnr_val"] for row in rows), arm, fmean(row["core_seconds"] for row in rows))
        for arm, rows in arms.items()
        if all(row["psnr_val"] is not None for row in rows)
    ]
    scenes, methods = (dict.fromkeys(row[key] for row in swept["rows"]) for key in ("scene", "method"))
    head = ("optimiser", "β", "learning rate", "rays through covered pixels", "validation PSNR, dB", "core seconds")
    lines = [(*arm, number(psnr), number(seconds, 0)) for psnr, arm, seconds in sorted(averaged, reverse=True)]
    named = listed([f"`{name}`" for name in methods])
    what = f"Means over {listed(list(scenes))} and {named}, one seed that no verdict uses:"
    return f"{what}\n\n{table(head, lines)}"


def _settings_in_words(tried: Run) -> tuple[str, ...]:
    rate = f"{tried['learning_rate']:g} to {tried['last_learning_rate']:g}, {tried['decay']}"
    share = f"{tried['covered_share']:.0%}" if tried["covered_share"] else "as they come"
    return tried["optimiser"], " / ".join(f"{beta:g}" for beta in tried["betas"]), rate, share


def processors(run: Run) -> str:
    """State how far the same plan and seeds move on another processor."""
    changed = next(change for change in run["changed"] if change["sense"] == "scenes_like_these")
    return (
        f"The same plan and seeds on another processor or instruction set move a run's score by "
        f"{number(run['all']['rms'])} dB (RMS; at most {number(abs(run['all']['largest']))}), and change "
        f"{changed['verdicts']} of {changed['compared']} verdicts on scenes like these, {changed['signs']} in sign "
        "(`python -m harness compare A B`)."
    )


def environment(installed: Run) -> str:
    """State the disk space of the installation."""
    size, gpus = (installed[name] / 1e9 for name in ("bytes", "bytes_for_gpus"))
    return (
        f"The environment takes {size:.1f} GB, {gpus:.1f} GB of it for NVIDIA GPUs, which "
        "`UV_TORCH_BACKEND=cpu nox -s benchmark` leaves out."
    )


def evidence(record: Studies) -> str:
    """State the answer of each study, in the words that were made from its figures, and the failing checks."""
    checks, broken = list(record.checks()), record.broken
    answers = [f"* **{study.info.title}** {study.answers[0]}" for study in record.studies if study.answers]
    lost = "; ".join(f"{check.what} ({study.info.title})" for study, check in broken)
    hold = f"{len(checks) - len(broken)} of {len(checks)} checks hold{'; not: ' if broken else ''}{lost}."
    pictures = "![What each part does](reduced/evidence_effects.png)", "![Frequencies](reduced/bandwidth.png)"
    return "\n\n".join(["\n".join(answers), hold, *pictures])


def collapse(record: Studies) -> str:
    """State how often short trainings ended without a picture, in boxes of several sizes."""
    return " ".join(answer for study in record.studies if study.info.id == "collapse" for answer in study.answers)


def frontier(record: Studies) -> str:
    """State the answers of the frontier, with the mean score of each family at each budget."""
    said = {
        study.info.title: study.answers if study.info.id == "phi" else study.answers[:1] for study in record.studies
    }
    answers = [f"* **{title.rstrip('?')}.** {' '.join(words)}" for title, words in said.items() if words]
    means = [found for study in record.studies for found in study.tables if found.id == "over_scenes"]
    tables = [table(found.columns, (map(str, line) for line in found.rows)) for found in means]
    minutes, made = sum(study.seconds for study in record.studies) / 60, record.provenance
    took = f"It took {minutes:.0f} minutes on {made['cores']} cores ({made['processor']})."
    return "\n\n".join([*tables, "\n".join(answers), took, FRONTIER_PICTURE])


def families(searched: Run) -> str:
    """Tabulate the trials of each family, means over scenes, and the largest gains."""
    trials, lines, gains = list(dict.fromkeys(row["trial"] for row in searched["rows"])), [], []
    for family, means in searched["means"].items():
        rows = [row for row in searched["rows"] if row["family"] == family]
        steps = {name: number(fmean(row["steps"] for row in rows if row["trial"] == name), 0) for name in trials}
        what = {name: f"{words}; " if name != trials[0] else "" for name, words in searched["trials"][family].items()}
        lines.append([family, *(f"{number(means[name])} ({what[name]}{steps[name]} steps)" for name in trials)])
        gains.append((max(means[name] or 0.0 for name in trials) - (means[trials[0]] or 0.0), family))
    (most, where), (next_most, _), *_ = sorted(gains, reverse=True)
    budget, scenes = searched["settings"]["budget"]["core_seconds"], dict.fromkeys(row["scene"] for row in rows)
    return (
        f"Validation PSNR after {budget:g} core seconds, dB, mean over {listed(list(scenes))}, one seed of its "
        f"own. The best trial of {where} gained {signed(most)} dB, that of no other family more than "
        f"{signed(next_most)} dB.\n\n{table(['family', *trials], lines)}"
    )


def leaders(record: Studies) -> str:
    """State who is best at which budget, with the picture, for the README."""
    who = [answer for study in record.studies if study.info.id == "front" for answer in study.answers]
    amount = record.settings["amount"]
    scale = f"{counted(len(amount['scenes']), 'scene')}, {counted(len(amount['seeds']), 'seed')}"
    where = f"{scale}, {record.provenance['processor']}: on another machine a core second is another amount of work."
    return "\n\n".join([f"{' '.join(who)} {where}", FRONTIER_PICTURE.replace("(", "(docs/")])


def stability(record: Studies) -> str:
    """State how many checks came out how, by whose formula it is."""
    many = Counter((check.owner, check.status) for _, check in record.checks())
    tried = {whose: many[whose, "pass"] + many[whose, "fail"] for whose in ("ours", "paper", "usual")}
    return (
        f"In {len(record.studies)} cases {many['ours', 'pass']} of {tried['ours']} checks of our code pass and "
        f"{many['ours', 'inconclusive']} are inconclusive. The paper's printed formulas fail "
        f"{many['paper', 'fail']} of {tried['paper']} and the field's usual ones {many['usual', 'fail']} of "
        f"{tried['usual']}. It took {sum(study.seconds for study in record.studies) / 60:.0f} minutes.\n\n"
        "![The matrix of cases in miniature](stability.png)"
    )


def speed(record: Studies) -> str:
    """Tabulate ratios and memory, with their targets; none of them depends on what is trained."""
    by_id = {check.id: check for _, check in record.checks()}
    rows = [
        (
            measured.what,
            f"{number(measured.value)} {measured.unit} [{number(measured.spread[0])}, {number(measured.spread[1])}]",
            f"{measured.limit:g} {measured.unit}, {'met' if measured.holds else '**missed**'}",
        )
        for name in ("training.dense.ratio", "matrix.paper.share", "matrix.reduced.share", "memory.worker.nerf.peak")
        if (measured := by_id.get(name)) and measured.value is not None and measured.spread
    ]
    where = record.provenance
    return table((f"{where['cores']} cores, {where['processor']}", "measured", "target"), rows) if rows else ""


def serving(record: Studies) -> str:
    """State what the view cache and attention bring (§8)."""
    by_id = {check.id: check for _, check in record.checks() if check.value is not None}
    hits = [
        f"{number(min(ratios), 0)} to {number(max(ratios), 0)} × from {where}"
        for id, where in (("hit.memory.0.", "memory"), ("hit.disk.warm.", "disk"))
        if (ratios := [check.value or 0.0 for check in by_id.values() if check.id.startswith(id)])
    ]
    key = by_id["key.pose"]
    times = [
        f"{number(measured.value, 0)} ms {words}"
        for order, words in (("attention", "by attention"), ("plain", "plainly"))
        if (measured := by_id.get(f"whole.{order}"))
    ]
    return (
        f"Faster than rendering, a hit in the cache is {listed(hits)}. A key of the pose alone, as in Listing 5, would "
        f"return another picture in {number(key.value, 0)} of {key.repeats} kinds of change. Until 10 % of the coarse "
        f"frame's error is left in the whole picture: {listed(times)} (medians).\n\n![Serving](reduced/serving.png)"
    )


def left_out(effects: Run) -> str:
    """Tabulate the effect of each omission on each scene: verdicts by the complete interval."""
    rows = effects["omissions"]
    titles = {effect["name"]: effect["what"] for effect in reversed(rows)}
    by_cell = {(effect["scene"], effect["name"]): omission(effect) for effect in rows}
    names = dict.fromkeys(effect["name"] for effect in rows)
    lines = [
        (scene, *(by_cell.get((scene, name), "–") for name in names))
        for scene in dict.fromkeys(effect["scene"] for effect in rows)
    ]
    return table(("scene", *(titles[name] for name in names)), lines)


def omission(effect: Run) -> str:
    """Format `−0.31 [−0.57, −0.05] dB: inconclusive, 27.7 s saved`; of pictures the change of colour."""
    if effect["difference"] is None:
        return "–"
    ends = f" {interval(effect['interval'])}" if effect["interval"] else ""
    change = f"{signed(effect['difference'])}{ends} dB" if effect["unit"] == "dB" else significant(effect["difference"])
    return f"{change}: {effect['verdict']}, {number(effect['seconds_saved'], 1)} s saved"


FRONTIER_PICTURE = "![Error against core seconds of training](frontier/frontier.png)"
RUN = ("reduced/summary.json",)
BLOCKS: dict[str, tuple[tuple[str, ...], Callable[..., str]]] = {
    "scale": (RUN, scale),
    "result": (RUN, result),
    "equal time": (RUN, lambda run: differences(run, "seconds")),
    "scores": (RUN, scores),
    "why": (RUN, why),
    "further methods": (RUN, further),
    "failures": (RUN, failed),
    "last doubling": (RUN, doubling),
    "late verdict": ((*RUN, "converged/summary.json"), beside),
    "late equal time": (("converged/summary.json",), lambda run: differences(run, "seconds")),
    "under Adam": ((*RUN, "adam/summary.json"), beside),
    "learning": (("learning_rates.json",), learning),
    "ledger": (RUN, ledger),
    "processors": (("reduced/processors.json",), processors),
    "environment": (("environment.json",), environment),
    "evidence": (("reduced/evidence.json",), evidence),
    "collapse": (("collapse.json",), collapse),
    "frontier": (("frontier/frontier.json",), frontier),
    "families": (("frontier/families.json",), families),
    "leaders": (("frontier/frontier.json",), leaders),
    "stability": (("stability.json",), stability),
    "speed": (("speed.json",), speed),
    "serving": (("reduced/serving.json",), serving),
    "left out": (("left_out.json",), left_out),
}
"""Name → the files below docs, and what is written of them."""
TIMELESS = ("processors", "environment", "speed")
"""The blocks that no unit of density changes."""
MARKED = re.compile(r"<!-- numbers: ([\w ]+) -->\n(.*?)<!-- end -->", re.DOTALL)


def block(name: str, docs: Path) -> str:
    """Return a block; raises `KeyError` for a name that no block has.

    Settings of a run name the unit of density; the provenance of everything measured since has an instruction set.
    """
    files, write = BLOCKS[name]
    measured = [_published(docs / file, timeless=name in TIMELESS) for file in files]
    return "" if None in measured else write(*measured)


def _published(path: Path, *, timeless: bool) -> Run | Studies | None:
    if not path.is_file():
        return None
    data: Run = json.loads(path.read_text(encoding="utf-8"))
    has_unit = "density_units" in data.get("settings", {}) or "instruction_set" in data.get("provenance", {})
    if not has_unit and not timeless:
        return None
    return read_studies(path) if "studies" in data else data


def pages(root: Path) -> list[Path]:
    """Return the pages that may hold blocks."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def rewritten(text: str, docs: Path) -> str:
    """Return the page with every block as the data have it; raises `KeyError` for a name that no block has."""

    def replaced(place: re.Match[str]) -> str:
        words = block(place[1], docs)
        return f"<!-- numbers: {place[1]} -->\n{words}{chr(10) * bool(words)}<!-- end -->"

    return MARKED.sub(replaced, text)


def main(root: Path = Path()) -> int:
    """Print the pages that changed."""
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        new = rewritten(text, root / "docs")
        if new != text:
            page.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
