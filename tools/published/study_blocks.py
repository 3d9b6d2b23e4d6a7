"""The blocks of numbers of studies and measurements; `python -m tools.published` writes them into the pages."""

from collections import Counter
from statistics import fmean

import numpy as np

from harness.records.metric_table import METRICS
from harness.records.study import Studies
from harness.records.verdict import verdict_of
from harness.studies.frontier.front import not_distinguished
from harness.studies.frontier.frontier_context import PHI_BUDGET
from harness.studies.frontier.phi import sentences
from harness.verdicts.statistics import paired_difference
from reports.data.wording import counted, interval, listed, number, signed, significant
from reports.studies.check_words import describe
from tools.published.published_cells import Run
from tools.published.run_blocks import table, target

OPAQUE = 0.995
SIZES = (100, 400, 800)
LEADING = {"calibration": 4, "objections": 0}
"""Study of the evidence → how many of its answers are stated, if not the first; `objections` has a block of its own."""
FRONTIER_PICTURE = "![Error against core seconds of training](frontier/frontier.png)"


def evidence(record: Studies) -> str:
    """State the answer of each study and the failing checks."""
    checks, broken = list(record.checks()), record.broken
    answers = [
        f"* **{study.info.title}** {' '.join(stated)}"
        for study in record.studies
        if (stated := study.answers[: LEADING.get(study.info.id, 1)])
    ]
    lost = "; ".join(f"{check.what} ({study.info.title})" for study, check in broken)
    hold = f"{len(checks) - len(broken)} of {len(checks)} checks hold{'; not: ' if broken else ''}{lost}."
    pictures = "![What each part does](reduced/evidence_effects.png)", "![Frequencies](reduced/bandwidth.png)"
    return "\n\n".join(["\n".join(answers), hold, *pictures])


def objections(record: Studies) -> str:
    return "\n".join(f"* {answer}" for answer in _answers(record, "objections"))


def _answers(record: Studies, id: str) -> list[str]:
    return [answer for study in record.studies if study.info.id == id for answer in study.answers]


def frontier(record: Studies) -> str:
    by_title = {
        study.info.title: sentences(study.effects, min(PHI_BUDGET, max(record.settings["amount"]["budgets"])))
        if study.info.id == "phi"
        else study.answers[:1]
        for study in record.studies
    }
    answers = [f"* **{title.rstrip('?')}.** {' '.join(words)}" for title, words in by_title.items() if words]
    machine = f"Measured on {record.provenance['cores']} cores ({record.provenance['processor']})."
    return "\n\n".join([*_over_scenes(record), "\n".join(answers), machine, FRONTIER_PICTURE])


def longer(late: Studies, large: Studies) -> str:
    """Tabulate a longer budget with who is ahead in it, and a longer one of larger pictures."""
    amount, larger, made = late.settings["amount"], large.settings["amount"], late.provenance
    scales = [
        f"{counted(len(amount['scenes']), 'scene')} of {amount['resolution']} pixels, {_seeds(amount)}",
        f"{counted(len(larger['large_scenes']), 'scene')} of {larger['large_resolution']} pixels, {_seeds(larger)}",
    ]
    machine = f"{'; '.join(scales)}. Measured on {made['cores']} cores ({made['processor']})."
    return "\n\n".join([*_over_scenes(late), *_over_scenes(large), " ".join([*_answers(late, "front"), machine])])


def _seeds(amount: Run) -> str:
    return counted(len(amount["seeds"]), "seed")


def _over_scenes(record: Studies) -> list[str]:
    return [
        f"{study.info.title}:\n\n{table(grid.columns, (map(str, line) for line in grid.rows))}"
        for study in record.studies
        for grid in study.tables
        if grid.id == "over_scenes"
    ]


def families(searched: Run) -> str:
    """Tabulate the trials of each family as means over scenes, and state the largest gains."""
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
    amount = record.settings["amount"]
    scale = f"{counted(len(amount['scenes']), 'scene')}, {_seeds(amount)}"
    where = f"{scale}, {record.provenance['processor']}: on another machine a core second is another amount of work."
    best, winners, *_ = _answers(record, "front")
    by_time = next(study for study in record.studies if study.info.id == "error_against_time")
    scores = next(grid for grid in by_time.tables if grid.id == "by_scene")
    by_budget: dict[str, list[list[float]]] = {}
    for _, budget, *psnr in scores.rows:
        by_budget.setdefault(str(budget), []).append([float(str(value)) for value in psnr])
    near = [
        sentence
        for budget, rows in by_budget.items()
        for sentence in not_distinguished(float(budget), scores.columns[2:], np.array(rows).T)
    ]
    return f"{' '.join([best, winners, *near])} {where}"


def stability(record: Studies) -> str:
    many = Counter((check.owner, check.status) for _, check in record.checks())
    tried = {whose: many[whose, "pass"] + many[whose, "fail"] for whose in ("ours", "paper", "usual")}
    broken = [f"{study.info.id}, {describe(check)}" for study, check in record.broken]
    failing = f" The failures of our code: {'; '.join(broken)}." if broken else ""
    unclear = many["ours", "inconclusive"]
    more = f"{unclear} more {'is' if unclear == 1 else 'are'}" if unclear else "none is"
    minutes = sum(study.seconds for study in record.studies) / 60
    return (
        f"In {len(record.studies)} cases, of {tried['ours']} checks of our code with a verdict, "
        f"{many['ours', 'pass']} pass and {many['ours', 'fail']} fail; {more} inconclusive. The paper's printed "
        f"formulas fail {many['paper', 'fail']} of {tried['paper']} and the field's usual ones "
        f"{many['usual', 'fail']} of {tried['usual']}.{failing} It took {minutes:.0f} minutes.\n\n"
        "![The matrix of cases in miniature](stability.png)"
    )


def speed(record: Studies) -> str:
    by_id = {check.id: check for _, check in record.checks()}
    rows = [
        (
            measured.what,
            f"{number(measured.value)} {measured.unit} [{number(measured.spread[0])}, {number(measured.spread[1])}]",
            target(measured),
        )
        for name in ("training.dense.ratio", "matrix.paper.share", "matrix.reduced.share", "memory.worker.nerf.peak")
        if (measured := by_id.get(name)) and measured.value is not None and measured.spread
    ]
    where = record.provenance
    return table((f"{where['cores']} cores, {where['processor']}", "measured", "target"), rows) if rows else ""


def serving(record: Studies) -> str:
    by_id = {check.id: check for _, check in record.checks() if check.value is not None}
    hits = [
        f"{number(min(ratios), 0)} to {number(max(ratios), 0)} × from {where}"
        for id, where in (("hit.memory.0.", "memory"), ("hit.disk.warm.", "disk"))
        if (ratios := [check.value or 0.0 for check in by_id.values() if check.id.startswith(id)])
    ]
    key = by_id["key.pose"]
    times = [
        f"{number(measured.value, 0)} ms {words}"
        for order, words in (("attention", "by attention"), ("plain", "in plain order"))
        if (measured := by_id.get(f"whole.{order}"))
    ]
    return (
        f"A hit in the cache is faster than rendering: {listed(hits)}. A key of the pose alone, as in Listing 5, would "
        f"return another picture in {number(key.value, 0)} of {key.repeats} kinds of change. The error of the whole "
        f"picture falls to 10 % of the coarse frame's in {listed(times)} (medians)."
    )


def fresh_fields(record: Studies) -> str:
    """Tabulate the cases A4 and A6: what a bounded density can show, and which readings learn at all without help."""
    slab, fresh = (study for study in record.studies if study.info.id in ("A4", "A6"))
    # the sizes are steps of a ladder, and rounded where they are compared
    places = {size: place for place, x in enumerate(slab.series[0].x) if (size := round(x)) in SIZES}
    rows = [
        [f"`{line.name}`", *(number(line.y[place] or 0.0) for place in places.values())]
        for line in slab.series
        if (line.y[max(places.values())] or 0.0) < OPAQUE
    ]
    head = ["opacity at the largest density", *(f"{size} px" for size in places)]
    (grid,) = fresh.tables
    ends = []
    for reading, *values in grid.rows:
        error, largest, norm, _, white = (float(value or 0.0) for value in values)
        ends.append([str(reading), number(error), number(largest, 1), number(norm), number(100.0 * white, 0)])
    columns = ("reading", "error / the background's", "largest density", "gradient's norm", "white points, %")
    return f"{table(head, rows)}\n\nOther readings reach 1.\n\n{table(columns, ends)}"


def left_out(effects: Run) -> str:
    rows = effects["omissions"]
    titles = {effect["name"]: effect["what"] for effect in reversed(rows)}
    by_cell = {(effect["scene"], effect["name"]): omission(effect) for effect in rows}
    names = dict.fromkeys(effect["name"] for effect in rows)
    lines = [
        (scene, *(by_cell.get((scene, name), "–") for name in names))
        for scene in dict.fromkeys(effect["scene"] for effect in rows)
    ]
    return table(("scene", *(titles[name] for name in names)), lines)


def left_out_over_scenes(effects: Run) -> str:
    """State the effect of each omission on PSNR over scenes, judged like the headline, on scenes like these."""
    words, seeds = [], dict.fromkeys(effects["settings"]["seeds"])
    of_interest = METRICS["psnr"].smallest_of_interest
    for name, what in {row["name"]: row["what"] for row in reversed(effects["omissions"])}.items():
        rows = [row for row in effects["omissions"] if row["name"] == name and row["unit"] == "dB"]
        changes = [row["difference"] for row in rows if row["difference"] is not None]
        if len(changes) < 2:
            continue
        effect = paired_difference(np.array(changes))
        saved = fmean(row["seconds_saved"] for row in rows)
        words.append(
            f"{what} {signed(effect.mean)} dB {interval(effect.interval)} on {counted(len(changes), 'scene')} "
            f"({verdict_of(effect.simultaneous, of_interest).phrase}), {number(saved, 0)} core s saved per cell"
        )
    return f"Left out, over scenes ({counted(len(seeds), 'seed')}): {'; '.join(words)}." if words else ""


def omission(effect: Run) -> str:
    """Format `−0.31 [−0.57, −0.05] dB: inconclusive, 27.7 s saved`; an omission in rendering has a change of colour."""
    if effect["difference"] is None:
        return "–"
    ends = f" {interval(effect['interval'])}" if effect["interval"] else ""
    change = f"{signed(effect['difference'])}{ends} dB" if effect["unit"] == "dB" else significant(effect["difference"])
    return f"{change}: {effect['verdict']}, {number(effect['seconds_saved'], 1)} s saved"


def environment(installed: Run) -> str:
    size, gpus = (installed[name] / 1e9 for name in ("bytes", "bytes_for_gpus"))
    return (
        f"The environment takes {size:.1f} GB, {gpus:.1f} GB of it for NVIDIA GPUs, which "
        "`UV_TORCH_BACKEND=cpu nox -s benchmark` leaves out."
    )
