"""The search for the constants that the paper does not give: its scores as a picture, its choice as a table.

python -m tools.published.search_blocks RECORD.json PICTURE.png
"""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from statistics import fmean
from typing import Literal

import numpy as np

from harness.verdicts.comparisons import judged
from reports.claims.estimands import judged_in_words
from reports.data.wording import listed, number, signed
from reports.drawing.palette import MARKERS, OTHERS
from reports.drawing.sheet import Drawing, key_of, save_sheet
from reports.drawing.traces import Panel, Trace
from scenes.files.json_object import JsonObject
from tools.published.run_blocks import table

Search = JsonObject
"""What `python -m harness study constants` writes."""
COMPARED = (
    *(("qnerf", "nerf"), ("qnerf", "nerf_matched"), ("nerf_matched", "nerf")),
    *(("qnerf_running_mean", "nerf"), ("qnerf_running_mean", "nerf_matched"), ("qnerf_shifted", "nerf")),
)
"""The pairs of methods whose difference at the chosen constants is stated."""
Pair = tuple[float, float | None]
"""Unit of density and start, both per half of the longest side of the scene's box."""


def means(search: Search, method: str, steps: int) -> dict[Pair, float]:
    """Map each pair of constants → its mean PSNR on validation views over scenes; pairs that diverged are left out."""
    scores: dict[Pair, list[float | None]] = {}
    for row in search["rows"]:
        if (row["method"], row["steps"]) == (method, steps):
            pair = (row["constants"]["unit"], row["constants"]["start"])
            scores.setdefault(pair, []).append(row["psnr_val"])
    known = {pair: [value for value in values if value is not None] for pair, values in scores.items()}
    return {pair: fmean(values) for pair, values in known.items() if len(values) == len(scores[pair])}


def budgets(search: Search) -> tuple[int, int]:
    steps = [row["steps"] for row in search["rows"]]
    return min(steps), max(steps)


def methods(search: Search) -> list[str]:
    return list(dict.fromkeys(row["method"] for row in search["rows"]))


def start_in_words(start: float | None) -> str:
    return "as printed" if start is None else f"{start:g}"


def surface(search: Search) -> list[Panel]:
    """Draw a panel for each method: a line for each start, and marks for the pairs that were trained for all steps."""
    brief, full = budgets(search)
    every = [
        mean for method in methods(search) for steps in (brief, full) for mean in means(search, method, steps).values()
    ]
    limits = (min(every) - 0.5, max(every) + 0.5)
    panels = []
    for method in methods(search):
        finals = _traces(search, method, full, "mark") if full > brief else ()
        traces = (*_traces(search, method, brief, "line"), *finals)
        alt = f"{method}: validation PSNR against the unit of density, a line for each start."
        x_label, y_label = "unit of density, per half of the box", "validation PSNR, dB"
        panels.append(Panel(method, x_label, y_label, traces, alt, "log", "linear", y_limits=limits, size=(3.2, 2.7)))
    return panels


def _traces(search: Search, method: str, steps: int, kind: Literal["line", "mark"]) -> Iterator[Trace]:
    starts = list(dict.fromkeys(row["constants"]["start"] for row in search["rows"]))
    scores = means(search, method, steps)
    for place, start in enumerate(starts):
        units = sorted(unit for unit, of in scores if of == start)
        if units:
            label = f"start {start_in_words(start)}{f', {steps} steps' if kind == 'mark' else ''}"
            y = tuple(scores[unit, start] for unit in units)
            yield Trace(label, OTHERS[place].light, kind, tuple(units), y, marker=MARKERS[place][0])


def drawings(search: Search) -> list[Drawing]:
    panels = surface(search)
    key = {name: look for panel in panels for name, look in key_of(panel).items()}
    return [(panel, key) for panel in panels]


def choice(search: Search) -> str:
    """Tabulate each method's constants, their score and the range of all pairs; if stopped, the best pairs so far."""
    brief, full = budgets(search)
    chosen = search["chosen"] or {method: best(search, method, brief) for method in methods(search)}
    steps = full if search["chosen"] else brief
    rows = []
    for method, pair in chosen.items():
        every = means(search, method, brief).values()
        score = means(search, method, steps)[pair["unit"], pair["start"]]
        shown = (f"{pair['unit']:g}", start_in_words(pair["start"]), number(score))
        rows.append((f"`{method}`", *shown, f"{number(min(every))} to {number(max(every))}"))
    scenes = list(dict.fromkeys(row["scene"] for row in search["rows"]))
    columns = ("method", "unit", "start", f"validation PSNR, dB, {steps} steps", f"all pairs, {brief} steps")
    unfinished = "**Not finished**: these are the best pairs so far, and no method is made with them. "
    pairs = [words for pair in COMPARED if (words := difference(search, *pair))]
    one_seed = f"At the chosen constants, on validation views, one seed, 95 %: {'; '.join(pairs)}.\n\n" if pairs else ""
    return (
        f"{table(columns, rows)}\n\n{one_seed}{'' if search['chosen'] else unfinished}Means over {listed(scenes)}; "
        f"seed {search['seed']}, commit {search['provenance']['commit']}. {search['rule']}"
    )


def difference(search: Search, method: str, against: str) -> str:
    """State the difference of two methods after all steps with their chosen constants, on scenes like these:
    `qnerf − nerf +0.08 dB (−0.17 to +0.34: sign and size open)`; nothing before both have constants.
    """
    if not {method, against} <= search["chosen"].keys():
        return ""
    ours, theirs = (chosen_scores(search, name) for name in (method, against))
    paired = {scene: np.array([ours[scene] - theirs[scene]]) for scene in ours}
    judgement = judged(paired, "psnr", len(COMPARED))
    estimate = judgement.scenes_like_these
    if estimate is None or estimate.simultaneous is None:
        return ""
    known = judged_in_words(estimate.simultaneous, estimate.verdict)
    return f"`{method}` − `{against}` {signed(judgement.difference)} dB ({known})"


def chosen_scores(search: Search, method: str) -> dict[str, float]:
    key = (method, budgets(search)[1], search["chosen"][method])
    rows = [row for row in search["rows"] if (row["method"], row["steps"], row["constants"]) == key]
    return {row["scene"]: row["psnr_val"] for row in rows}


def best(search: Search, method: str, steps: int) -> dict[str, float | None]:
    scores = means(search, method, steps)
    unit, start = max(scores, key=lambda pair: scores[pair])
    return {"unit": unit, "start": start}


def on_complete_scenes(search: Search) -> Search:
    """Return the search without scenes on which some pair is not yet trained."""
    counts = Counter(row["scene"] for row in search["rows"])
    most = max(counts.values())
    return {**search, "rows": [row for row in search["rows"] if counts[row["scene"]] == most]}


def main(record: str, picture: str) -> int:
    search = on_complete_scenes(json.loads(Path(record).read_text(encoding="utf-8")))
    save_sheet(Path(picture), drawings(search), 4)
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
