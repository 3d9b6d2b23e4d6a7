"""python -m reports.run.published: the numbers of README.md and docs, written from what is published.

    <!-- numbers: NAME -->
    what `BLOCKS[NAME]` makes of docs/*.json
    <!-- end -->

Each public function is a block. A block is empty if its file is not published, or was measured before all methods
had one unit of density: its figures would be those of another program.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from harness.records.study import Studies, read_studies
from reports.claims.estimands import BUDGETS, SENSES, between
from reports.claims.headline import BASELINE, CONTROL, FAVOURITE
from reports.data.wording import VERDICTS, counted, interval, listed, number, signed, significant

SAYS = {
    "better": "scores above",
    "worse": "scores below",
    "equivalent": "scores the same within the margin as",
    "inconclusive": "is not told apart from",
}
"""Map verdict → the verb of a sentence about it: no other words compare two methods on these pages."""
DUELS = ((FAVOURITE, BASELINE), (FAVOURITE, CONTROL), (CONTROL, BASELINE))


@dataclass(frozen=True)
class Published:
    """The folder docs."""

    docs: Path

    def read(self, name: str) -> dict[str, Any]:
        """Return a file's content; empty if it is not there."""
        path = self.docs / name
        return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}

    def current(self, name: str) -> dict[str, Any]:
        """Return the content as `read`; empty, too, if the methods had no common unit of density yet.

        Settings of a run name the unit; the provenance of everything measured since has an instruction set.
        """
        found = self.read(name)
        told = "density_units" in found.get("settings", {}) or "instruction_set" in found.get("provenance", {})
        return found if told else {}

    @property
    def run(self) -> dict[str, Any]:
        """The default run."""
        return self.current("reduced/summary.json")


def main_methods(run: dict[str, Any]) -> list[str]:
    """Return the methods that were trained on every scene."""
    return [method for method in run["methods"] if method in run["settings"]["methods"]]


def row(run: dict[str, Any], scene: str, method: str, against: str, budget: str = "steps") -> dict[str, Any] | None:
    """Return the comparison of two methods by PSNR; None if there is no difference."""
    asked = {"scene": scene, "method": method, "against": against, "metric": "psnr", "budget": budget}
    found = (one for one in run["comparisons"] if asked.items() <= one.items())
    return next((one for one in found if one["difference"] is not None), None)


def estimate(one: dict[str, Any], sense: str) -> str:
    """Format `−0.13 to +0.50: inconclusive`, of the interval that the verdict is taken from."""
    found = one[sense]
    pair = found and (found["simultaneous"] or found["interval"])
    return f"{between(pair)}: {found['verdict']}" if pair else "–"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    head = list(head)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))


def scale(published: Published) -> str:
    """State the scale at which the default run was measured, and its machine."""
    run = published.run
    if not run:
        return ""
    train, provenance, scene = run["settings"]["train"], run["provenance"], run["scenes"][0]
    network = f"{train['network']['depth']} × {train['network']['width']}"
    return (
        f"Published run: {counted(len(run['scenes']), 'scene')} × {counted(len(run['seeds']), 'seed')}, "
        f"{scene['width']} × {scene['height']} px, {network} networks, {run['settings']['budget']['steps']} steps; "
        f"{run['phases']['total'] / 60:.0f} minutes on {provenance['cores']} cores ({provenance['processor']}, "
        f"{train['precision']}), commit {provenance['commit']}."
    )


def result(published: Published) -> str:
    """State the answer, the printed gain, and who scores how much more than whom, asked twice."""
    run = published.run
    if not run:
        return ""
    gain = next((one for one in run["claims"] if one["id"] == "table2-average" and one["printed"] is not None), None)
    printed = f" The paper prints {signed(gain['printed'], 1)} dB on average: *{gain['verdict']}*." if gain else ""
    return f"**{run['headline']}.**{printed}\n\n{differences(run, 'steps')}"


def equal_time(published: Published) -> str:
    """State the same differences where both have trained as long."""
    return differences(published.run, "seconds") if published.run else ""


def differences(run: dict[str, Any], budget: str) -> str:
    rows = [
        (f"`{pair[0]}` − `{pair[1]}`", f"{signed(one['difference'])} dB", *(estimate(one, name) for name in SENSES))
        for pair in DUELS
        if (one := row(run, "all", *pair, budget))
    ]
    return table((f"test PSNR, {BUDGETS[budget]}", "", *(f"{words}, 95 %" for words in SENSES.values())), rows)


def scores(published: Published) -> str:
    """Tabulate test PSNR by scene, with the ceiling that the truth's noise sets, and the floor: the nearest training
    view.
    """
    run = published.run
    methods = main_methods(run) if run else []
    rows = [
        (
            one["scene"],
            *(spread(psnr_of(run, one["scene"], method)) for method in methods),
            *(number(one[name], 1) for name in ("psnr_ceiling", "psnr_floor")),
        )
        for one in run.get("scenes", [])
    ]
    return table(("test PSNR, dB", *(f"`{method}`" for method in methods), "ceiling", "floor"), rows) if run else ""


def psnr_of(run: dict[str, Any], scene: str, method: str) -> list[float]:
    """Return the scores, one per seed."""
    cells = (one for one in run["cells"] if (one["scene"], one["method"]) == (scene, method))
    return [one["psnr"] for one in cells if one["psnr"] is not None]


def spread(values: list[float]) -> str:
    """Format mean ± standard deviation over seeds."""
    more = f" ± {number(stdev(values))}" if len(values) > 1 else ""
    return f"{number(fmean(values))}{more}" if values else "–"


def ladder(run: dict[str, Any]) -> tuple[str, dict[str, dict[float, list[float]]]]:
    """Return the scene of the further methods, and base → unit of density → scores there."""
    extras = [cell for cell in run["cells"] if cell["method"] not in main_methods(run)]
    scene = extras[0]["scene"] if extras else ""
    found: dict[str, dict[float, list[float]]] = {BASELINE: {}, FAVOURITE: {}}
    for method, unit in run["settings"]["density_units"].items():
        base = method.split("_unit_")[0]
        if base in found and (psnr := psnr_of(run, scene, method)):
            found[base][unit["scale"]] = psnr
    return scene, {base: dict(sorted(rungs.items())) for base, rungs in found.items()}


def why(published: Published) -> str:
    """State the effect of the unit of density, and the printed form apart."""
    run = published.run
    scene, rungs = ladder(run) if run else ("", {})
    moved = [
        f"`{base}` scores {number(min(means), 1)} to {number(max(means), 1)} dB"
        for base, units in rungs.items()
        if len(means := [fmean(psnr) for psnr in units.values()]) > 1
    ]
    units = sorted({unit for of_base in rungs.values() for unit in of_base})
    printed = row(run, scene, f"{FAVOURITE}_printed", BASELINE) if scene else None
    said = []
    if moved:
        said.append(
            f"Between {units[0]:g} and {units[-1]:g} units of density per half of the box, {listed(moved)} on {scene}."
        )
    if printed:
        said.append(
            f"`{printed['method']}` {SAYS[printed['verdict']]} `{BASELINE}` there: {signed(printed['difference'])} dB "
            f"({between(printed['simultaneous'] or printed['interval'])})."
        )
    return " ".join(said)


def further(published: Published) -> str:
    """Tabulate the methods that were trained on one scene alone, without the ladder."""
    run = published.run
    scene, _ = ladder(run) if run else ("", {})
    rows = [
        (f"`{method}`", title, f"{signed(one['difference'])} dB, {estimate(one, 'on_these_scenes')}")
        for method, title in (run["methods"].items() if scene else ())
        if method not in main_methods(run) and "_unit_" not in method and (one := row(run, scene, method, BASELINE))
    ]
    return table((f"on {scene}", "what it is", f"− `{BASELINE}`, 95 % on this scene"), rows) if rows else ""


def failed(published: Published) -> str:
    """State how often runs diverged or collapsed."""
    rates = published.run.get("failures", {}).get("rates", [])
    said = [
        f"`{one['method']}` in {one['diverged'] + one['collapsed']} of {counted(one['runs'], 'run')} (95 % interval "
        f"{' to '.join(number(100 * end, 0) for end in one['interval'])} %)"
        for one in rates
        if one["rate"]
    ]
    if said or not rates:
        return f"Diverged or showed background alone: {listed(said)}; differences are of the others." if rates else ""
    return f"None of {sum(one['runs'] for one in rates)} runs diverged or showed background alone."


def ledger(published: Published) -> str:
    """State how many printed statements came out how."""
    claims = published.run.get("claims", [])
    many = Counter(one["verdict"] for one in claims)
    said = listed([f"{many[one]} {one}" for one in VERDICTS if many[one]])
    return f"Of {len(claims)} statements of the paper: {said}." if claims else ""


def processors(published: Published) -> str:
    """State how far the same plan and seeds move on another processor."""
    found = published.read("reduced/processors.json")
    if not found or not found["all"]:
        return ""
    changed = next(one for one in found["changed"] if one["sense"] == "scenes_like_these")
    return (
        f"The same plan and seeds on another processor or instruction set move a run's score by "
        f"{number(found['all']['rms'])} dB (RMS; at most {number(abs(found['all']['largest']))}), and change "
        f"{changed['verdicts']} of {changed['compared']} verdicts on scenes like these, {changed['signs']} in sign "
        "(`python -m harness compare A B`)."
    )


def environment(published: Published) -> str:
    """State the disk space of the installation."""
    found = published.read("environment.json")
    if not found:
        return ""
    size, gpus = (found[name] / 1e9 for name in ("bytes", "bytes_for_gpus"))
    return (
        f"The environment takes {size:.1f} GB, {gpus:.1f} GB of it for NVIDIA GPUs, which "
        "`UV_TORCH_BACKEND=cpu nox -s benchmark` leaves out."
    )


def evidence(published: Published) -> str:
    """State the answer of each study, in the words that were made from its figures, and the failing checks."""
    if not published.current("reduced/evidence.json"):
        return ""
    record = read_studies(published.docs / "reduced/evidence.json")
    checks, broken = list(record.checks()), record.broken
    lines = [f"* **{study.info.title}** {study.answers[0]}" for study in record.studies if study.answers]
    lost = "; ".join(f"{check.what} ({study.info.title})" for study, check in broken)
    told = f"{len(checks) - len(broken)} of {len(checks)} checks hold{'; not: ' if broken else ''}{lost}."
    drawn = {"What each part does": "reduced/evidence_effects.png", "Frequencies": "reduced/bandwidth.png"}
    pictures = [f"![{title}]({file})" for title, file in drawn.items() if (published.docs / file).is_file()]
    return "\n\n".join(["\n".join(lines), told, *pictures])


def stability(published: Published) -> str:
    """How many checks came out how, by whose formula it is."""
    if not published.current("stability.json"):
        return ""
    cases = read_studies(published.docs / "stability.json").studies
    many = Counter((one.owner, one.status) for case in cases for one in case.checks)
    tried = {whose: many[whose, "pass"] + many[whose, "fail"] for whose in ("ours", "paper", "usual")}
    return (
        f"In {len(cases)} cases {many['ours', 'pass']} of {tried['ours']} checks of our code pass and "
        f"{many['ours', 'inconclusive']} are inconclusive. The paper's printed formulas fail "
        f"{many['paper', 'fail']} of {tried['paper']} and the field's usual ones {many['usual', 'fail']} of "
        f"{tried['usual']}. It took {sum(one.seconds for one in cases) / 60:.0f} minutes.\n\n"
        "![The matrix of cases in miniature](stability.png)"
    )


def speed(published: Published) -> str:
    """Ratios and memory, with their targets; none of them depends on what is trained."""
    if not published.read("speed.json"):
        return ""
    record: Studies = read_studies(published.docs / "speed.json")
    found = {one.id: one for _, one in record.checks()}
    met = {True: "met", False: "**missed**"}
    rows = [
        (
            one.what,
            f"{number(one.value)} {one.unit} [{number(one.spread[0])}, {number(one.spread[1])}]",
            f"{one.limit:g} {one.unit}, {met[one.holds]}",
        )
        for name in ("training.dense.ratio", "matrix.paper.share", "matrix.reduced.share", "memory.worker.nerf.peak")
        if (one := found.get(name)) and one.value is not None and one.spread
    ]
    where = record.provenance
    return table((f"{where['cores']} cores, {where['processor']}", "measured", "target"), rows) if rows else ""


def serving(published: Published) -> str:
    """Tabulate the view cache and attention (§8)."""
    if not published.current("reduced/serving.json"):
        return ""
    record = read_studies(published.docs / "reduced/serving.json")
    found = {one.id: one for _, one in record.checks() if one.value is not None}
    hits = [
        f"{number(min(ratios), 0)} to {number(max(ratios), 0)} × from {where}"
        for id, where in (("hit.memory.0.", "memory"), ("hit.disk.warm.", "disk"))
        if (ratios := [one.value or 0.0 for one in found.values() if one.id.startswith(id)])
    ]
    key = found["key.pose"]
    times = [
        f"{number(one.value, 0)} ms {words}"
        for order, words in (("attention", "by attention"), ("plain", "plainly"))
        if (one := found.get(f"whole.{order}"))
    ]
    return (
        f"Faster than rendering, a hit in the cache is {listed(hits)}. A key of the pose alone, as in Listing 5, would "
        f"return another picture in {number(key.value, 0)} of {key.repeats} kinds of change. Until 10 % of the coarse "
        f"frame's error is left in the whole picture: {listed(times)} (medians).\n\n![Serving](reduced/serving.png)"
    )


def left_out(published: Published) -> str:
    """Tabulate the effect of each omission on each scene: verdicts by the complete interval."""
    rows = published.current("left_out.json").get("omissions", [])
    names = list(dict.fromkeys(one["name"] for one in rows))
    by_cell = {(one["scene"], one["name"]): one for one in rows}
    titles = [next(one["what"] for one in rows if one["name"] == name) for name in names]
    lines = [
        (scene, *(omission(by_cell.get((scene, name))) for name in names))
        for scene in dict.fromkeys(one["scene"] for one in rows)
    ]
    return table(("scene", *titles), lines) if rows else ""


def omission(one: dict[str, Any] | None) -> str:
    """Format `−0.31 [−0.57, −0.05] dB: inconclusive, 27.7 s saved`; of pictures the change of colour."""
    if one is None or one["difference"] is None:
        return "–"
    between = f" {interval(one['interval'])}" if one["interval"] else ""
    change = f"{signed(one['difference'])}{between} dB" if one["unit"] == "dB" else significant(one["difference"])
    return f"{change}: {one['verdict']}, {number(one['seconds_saved'], 1)} s saved"


BLOCKS: dict[str, Callable[[Published], str]] = {
    "scale": scale,
    "result": result,
    "equal time": equal_time,
    "scores": scores,
    "why": why,
    "further methods": further,
    "failures": failed,
    "ledger": ledger,
    "processors": processors,
    "environment": environment,
    "evidence": evidence,
    "stability": stability,
    "speed": speed,
    "serving": serving,
    "left out": left_out,
}
MARKED = re.compile(r"<!-- numbers: ([\w ]+) -->\n(.*?)<!-- end -->", re.DOTALL)


def pages(root: Path) -> list[Path]:
    """Return the pages that may hold blocks."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def rewritten(text: str, published: Published) -> str:
    """Return the page with every block as the data have it; raises `KeyError` for a name that no block has."""

    def block(found: re.Match[str]) -> str:
        said = BLOCKS[found[1]](published)
        return f"<!-- numbers: {found[1]} -->\n{said}{chr(10) * bool(said)}<!-- end -->"

    return MARKED.sub(block, text)


def main(root: Path = Path()) -> int:
    """Print the pages that changed."""
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        new = rewritten(text, Published(root / "docs"))
        if new != text:
            page.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
