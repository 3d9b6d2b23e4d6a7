"""python -m reports.documents: the numbers of README.md and docs, written from what is published.

    <!-- numbers: NAME -->
    what `BLOCKS[NAME]` makes of docs/*.json
    <!-- end -->

Blocks of the default run are in `reports.published`, all others here.
"""

import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

from harness.evidence_record import failed_checks, read_evidence
from reports import published as run
from reports.published import Published, table
from reports.wording import interval, listed, number, signed, significant


def environment(published: Published) -> str:
    """Disk space of what is installed."""
    found = published.read("environment.json")
    if not found:
        return ""
    size, gpus = (found[name] / 1e9 for name in ("bytes", "bytes_for_gpus"))
    return (
        f"The environment takes {size:.1f} GB, {gpus:.1f} GB of it for NVIDIA GPUs, which "
        "`UV_TORCH_BACKEND=cpu nox -s benchmark` leaves out."
    )


def evidence(published: Published) -> str:
    """The answer of each study, in the words that were made from its figures, and which checks do not hold."""
    if not published.current("reduced/evidence.json"):
        return ""
    record = read_evidence(published.docs / "reduced/evidence.json")
    checks, broken = list(record.checks()), failed_checks(record)
    lines = [f"* **{study.info.title}** {study.findings[0]}" for study in record.studies if study.findings]
    lost = "; ".join(f"{check.what} ({study.info.title})" for study, check in broken)
    told = f"{len(checks) - len(broken)} of {len(checks)} checks hold{'; not: ' if broken else ''}{lost}."
    drawn = {"What each part does": "reduced/evidence_effects.png", "Frequencies": "reduced/bandwidth.png"}
    pictures = [f"![{title}]({file})" for title, file in drawn.items() if (published.docs / file).is_file()]
    return "\n\n".join(["\n".join(lines), told, *pictures])


def stability(published: Published) -> str:
    """How many checks came out how, by whose formula it is."""
    cases = published.current("stability.json").get("cases", [])
    if not cases:
        return ""
    many = Counter((one["whose"], one["status"]) for case in cases for one in case["outcomes"])
    tried = {whose: many[whose, "pass"] + many[whose, "fail"] for whose in ("ours", "paper", "usual")}
    return (
        f"In {len(cases)} cases {many['ours', 'pass']} of {tried['ours']} checks of our code pass and "
        f"{many['ours', 'inconclusive']} are inconclusive. The paper's printed formulas fail "
        f"{many['paper', 'fail']} of {tried['paper']} and the field's usual ones {many['usual', 'fail']} of "
        f"{tried['usual']}. It took {sum(one['seconds'] for one in cases) / 60:.0f} minutes.\n\n"
        "![The matrix of cases in miniature](stability.png)"
    )


def speed(published: Published) -> str:
    """Ratios and memory, with their targets; none of them depends on what is trained."""
    record = published.read("speed.json")
    found = {one["id"]: one for one in record.get("measurements", [])}
    met = {True: "met", False: "**missed**"}
    rows = [
        (
            one["title"],
            f"{number(one['value'])} {one['unit']} [{number(one['low'])}, {number(one['high'])}]",
            f"{one['target']:g} {one['unit']}, {met[one['met']]}",
        )
        for name in ("training.dense.ratio", "matrix.paper.share", "matrix.reduced.share", "memory.worker.nerf.peak")
        if (one := found.get(name)) and one["value"] is not None
    ]
    where = record["provenance"] if rows else {}
    return table((f"{where['cores']} cores, {where['processor']}", "measured", "target"), rows) if rows else ""


def serving(published: Published) -> str:
    """The view cache and attention (§8)."""
    found = published.current("reduced/serving.json")
    if not found:
        return ""
    cache, reaching = found["cache"], found["attention"]["reaching"]
    hits = [
        f"{number(min(ratios), 0)} to {number(max(ratios), 0)} × from {where}"
        for source, where in (("level 0", "memory"), ("level 2", "disk"))
        if (ratios := [one["ratio"] for one in cache["latencies"] if one["source"] == source])
    ]
    stale = sum(one["stale"] > 0 for one in cache["confusions"])
    times = [
        f"{number(1e3 * median(there), 0)} ms {words}"
        for order, words in (("attention", "by attention"), ("plain", "plainly"))
        if (there := [one["seconds"] for one in reaching if (one["order"], one["measure"]) == (order, "whole")])
        and None not in there
    ]
    return (
        f"Faster than rendering, a hit in the cache is {listed(hits)}. A key of the pose alone, as in Listing 5, would "
        f"return another picture in {stale} of {len(cache['confusions'])} kinds of change. Until 10 % of the coarse "
        f"frame's error is left in the whole picture: {listed(times)} (medians).\n\n![Serving](reduced/serving.png)"
    )


def left_out(published: Published) -> str:
    """What each omission changes on each scene: verdicts by the whole interval."""
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
    """`−0.31 [−0.57, −0.05] dB: inconclusive, 27.7 s saved`; of pictures the change of colour."""
    if one is None or one["difference"] is None:
        return "–"
    between = f" {interval(one['interval'])}" if one["interval"] else ""
    change = f"{signed(one['difference'])}{between} dB" if one["unit"] == "dB" else significant(one["difference"])
    return f"{change}: {one['verdict']}, {number(one['seconds_saved'], 1)} s saved"


BLOCKS: dict[str, Callable[[Published], str]] = {
    "scale": run.scale,
    "result": run.result,
    "equal time": run.equal_time,
    "scores": run.scores,
    "why": run.why,
    "further methods": run.further,
    "failures": run.failed,
    "ledger": run.ledger,
    "processors": run.processors,
    "environment": environment,
    "evidence": evidence,
    "stability": stability,
    "speed": speed,
    "serving": serving,
    "left out": left_out,
}
MARKED = re.compile(r"<!-- numbers: ([\w ]+) -->\n(.*?)<!-- end -->", re.DOTALL)


def pages(root: Path) -> list[Path]:
    """Those that may hold blocks."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def rewritten(text: str, published: Published) -> str:
    """The page with every block as the data have it; raises `KeyError` for a name that no block has."""

    def block(found: re.Match[str]) -> str:
        said = BLOCKS[found[1]](published)
        return f"<!-- numbers: {found[1]} -->\n{said}{chr(10) * bool(said)}<!-- end -->"

    return MARKED.sub(block, text)


def main(root: Path = Path()) -> int:
    """Prints the pages that changed."""
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        new = rewritten(text, Published(root / "docs"))
        if new != text:
            page.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
