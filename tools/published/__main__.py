"""python -m tools.published: write the numbers of README.md and docs from the published files.

    <!-- numbers: NAME -->
    the text that `block(NAME, docs)` makes from docs/*.json
    <!-- end -->

A block is empty if one of its files is not published, except files with ? after the name.
"""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path

from harness.records.study import Studies, read_studies
from tools.published import run_blocks, search_blocks, study_blocks
from tools.published.published_cells import Run

RUN = ("reduced/summary.json",)
REPLICATES = "reduced/replicates.json?"
"""The default run's plan, trained again on other instruction sets (`python -m tools.published.replicates`)."""
BLOCKS: dict[str, tuple[tuple[str, ...], Callable[..., str]]] = {
    "scale": (RUN, run_blocks.scale),
    "result": ((*RUN, REPLICATES), run_blocks.result),
    "equal time": ((*RUN, REPLICATES), run_blocks.equal_time),
    "scores": (RUN, run_blocks.scores),
    "constants": (("constants.json",), lambda search: search_blocks.choice(search_blocks.on_complete_scenes(search))),
    "late constants": (("constants_late.json",), search_blocks.choice),
    "constants at 400 px": (("constants_400.json",), search_blocks.choice),
    "failures": (RUN, run_blocks.failed),
    "last doubling": (RUN, run_blocks.doubling),
    "ceiling": ((*RUN, "converged/summary.json"), run_blocks.ceiling),
    "limits": ((*RUN, "converged/summary.json"), run_blocks.limits),
    "verdict": (("converged/summary.json", *RUN, REPLICATES), run_blocks.verdict),
    "late verdict": ((*RUN, "converged/summary.json", REPLICATES), run_blocks.second_run),
    "late equal time": (("converged/summary.json",), run_blocks.equal_time),
    "twice the steps": (("reduced/halved.json", *RUN), run_blocks.twice_the_steps),
    "under Adam": ((*RUN, "adam/summary.json", REPLICATES), run_blocks.second_run),
    "ledger": (RUN, run_blocks.ledger),
    "processors": (("reduced/processors.json", *RUN, REPLICATES), run_blocks.processors),
    "GPU": (
        ("gpu/compared.json", "gpu/again.json", "gpu/summary.json", "gpu/speed.json", *RUN),
        run_blocks.on_a_gpu,
    ),
    "environment": (("environment.json",), study_blocks.environment),
    "evidence": (("reduced/evidence.json",), study_blocks.evidence),
    "objections": (("reduced/evidence.json",), study_blocks.objections),
    "frontier": (("frontier/frontier.json",), study_blocks.frontier),
    "longer": (("frontier/late.json", "frontier/large.json"), study_blocks.longer),
    "families": (("frontier/families.json",), study_blocks.families),
    "leaders": (("frontier/frontier.json",), study_blocks.leaders),
    "stability": (("stability.json",), study_blocks.stability),
    "fresh fields": (("stability.json",), study_blocks.fresh_fields),
    "speed": (("speed.json",), study_blocks.speed),
    "serving": (("reduced/serving.json",), study_blocks.serving),
    "left out": (("left_out.json",), study_blocks.left_out),
    "left out over scenes": (("left_out.json",), study_blocks.left_out_over_scenes),
}
"""Name → the files below docs, and the function that makes the text from them."""
MARKED = re.compile(r"<!-- numbers: ([\w ]+) -->\n(.*?)<!-- end -->", re.DOTALL)


def block(name: str, docs: Path) -> str:
    """Return a block; raises `KeyError` for a name that no block has."""
    files, write = BLOCKS[name]
    if not all((docs / file).is_file() or file.endswith("?") for file in files):
        return ""
    return write(*(_published(docs / file.removesuffix("?")) for file in files))


def _published(path: Path) -> Run | Studies:
    if not path.is_file():
        return {}
    data: Run = json.loads(path.read_text(encoding="utf-8"))
    return read_studies(path) if "studies" in data else data


def pages(root: Path) -> list[Path]:
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def rewritten(text: str, docs: Path) -> str:
    """Return the page with every block written again; raises `KeyError` for a name that no block has."""

    def write(place: re.Match[str]) -> str:
        words = block(place[1], docs)
        return f"<!-- numbers: {place[1]} -->\n{words}{chr(10) * bool(words)}<!-- end -->"

    return MARKED.sub(write, text)


def main(root: Path = Path()) -> int:
    for page in pages(root):
        text = page.read_text(encoding="utf-8")
        new = rewritten(text, root / "docs")
        if new != text:
            page.write_text(new, encoding="utf-8")
            sys.stdout.write(f"{page}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
