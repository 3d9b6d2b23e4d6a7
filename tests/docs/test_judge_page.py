"""docs/judge.md agrees with its tables: every block, every row and every number of its two examples."""

import json
import re
from functools import cache
from pathlib import Path

import pytest

from harness.records.judgements import JudgementRecord, changed_pairs
from harness.verdicts.judging.judgement import judge, lines
from harness.verdicts.tables.result_table import read_table
from tests.harness.shell import ROOT

EXAMPLES = ROOT / "docs" / "examples"
PAGE = (ROOT / "docs" / "judge.md").read_text(encoding="utf-8")
PUBLIC, SEEDED = "nerfbaselines-blender.csv", "own-seeds.csv"
REMEDY = "replace it in docs/judge.md by:\n"


@cache
def judged(name: str, baseline: str | None = None) -> JudgementRecord:
    return judge(read_table([EXAMPLES / name]), None, baseline)


def after(mark: str) -> str:
    """Return the lines after a mark, up to an empty line."""
    return PAGE.split(f"<!-- {mark} -->\n")[1].split("\n\n")[0].strip()


@pytest.mark.parametrize(("name", "baseline", "against"), [(PUBLIC, None, ""), (SEEDED, "nerf", " against nerf")])
def test_the_tables_are_what_the_command_prints(name: str, baseline: str | None, against: str) -> None:
    block = "```\n" + "\n".join(lines(judged(name, baseline))) + "\n```"
    assert after(f"judgement of examples/{name}{against}") == block, REMEDY + block


def test_the_differences_with_seeds_are_those_of_the_table() -> None:
    rows = ["| method | dB | on scenes like these | on these scenes |", "|---|---|---|---|"]
    for pair in judged(SEEDED, "nerf").given.pairs:
        estimates = []
        for estimate in (pair.scenes_like_these, pair.on_these_scenes):
            low, high = (f"{end:+.2f}".replace("-", "−") for end in estimate.simultaneous)
            estimates.append(f"[{low}, {high}] {estimate.verdict.phrase}")
        rows.append(f"| `{pair.method}` | {pair.difference:+.2f} | {' | '.join(estimates)} |".replace("| -", "| −"))
    assert after(f"differences of examples/{SEEDED} against nerf") == "\n".join(rows), REMEDY + "\n".join(rows)


def sentences() -> list[str]:
    """Return the sentences of the page about the leaderboard, made from its table."""
    judgement = judged(PUBLIC)
    places = [row.method for row in judgement.given.places]
    assert places[-1] == "colmap"
    trained = [pair for pair in judgement.given.neighbours if pair.against != "colmap"]
    assert not any(pair.distinguished for pair in trained)
    for pair in trained:
        assert pair.scenes_like_these.interval[0] < 0 < pair.scenes_like_these.interval[1]
    best = places[0]
    from_best = [f"`{pair.against}`" for pair in judgement.given.pairs if pair.method == best and pair.distinguished]
    least = [pair.scenes_like_these.smallest_detectable or 0.0 for pair in trained if pair.scenes_like_these]
    (suspect,) = judgement.suspects
    assert judgement.without_suspects
    rankings = judgement.given.places, judgement.without_suspects.places
    (before, mean), (now, adjusted) = (
        next((at, row.mean) for at, row in enumerate(of, 1) if row.method == suspect.method) for of in rankings
    )
    changes = len(changed_pairs(judgement))
    printed = read_table([EXAMPLES / PUBLIC], "psnr_printed_by_its_paper")
    paper = printed.values[printed.methods.index(suspect.method), printed.scenes.index(suspect.scene), 0]
    return [
        f"Test PSNR of {len(places)} methods on the {len(judgement.scenes)} scenes",
        f"{len(places) - 1} of the methods were trained (`colmap` was not), and none of their {len(trained)} "
        "neighbouring pairs is distinguished: not with intervals for all pairs together, and not where each pair is "
        "looked at alone.",
        f"The best, `{best}`, is distinguished from {', '.join(from_best[:-1])} and {from_best[-1]} alone.",
        f"lies between {min(least):.2f} and {max(least):.2f} dB.",
        f"The row of `{suspect.method}` is a single collapsed cell: {suspect.value:.2f} dB on {suspect.scene}, where "
        f"{suspect.expected:.2f} dB is to be expected and its own paper prints {paper:.2f} dB.",
        f"Without that cell its adjusted mean is {adjusted:.2f} instead of {mean:.2f} dB, and it moves from place "
        f"{before} to place {now}; {changes or 'no'} verdict{'s' * (changes > 1)} change{'s' * (changes < 2)}.",
        f"Our own published run, {judged(SEEDED).seeds} seeds per cell",
    ]


def test_every_number_of_the_examples_is_read_from_the_tables() -> None:
    left = PAGE.split("## A public leaderboard")[1]
    for sentence in sentences():
        assert sentence in left
        left = left.replace(sentence, "")
    # blocks, tables and commands have their own tests
    left = re.sub(r"```.*?```", "", left, flags=re.S)
    prose = [line for line in left.splitlines() if not line.startswith(("|", "    ", "<"))]
    numbers = re.findall(r"(?<![\w.])\d+(?:\.\d+)?(?!\w)", "\n".join(prose))
    assert numbers == ["2025", "80"], numbers  # November 2025; in 80 % of such tables


def test_the_table_with_seeds_is_that_of_the_published_run() -> None:
    run = json.loads((ROOT / "docs" / "reduced" / "summary.json").read_text(encoding="utf-8"))
    cells = [cell for cell in run["cells"] if cell["method"] in run["settings"]["methods"]]
    table = read_table([EXAMPLES / SEEDED])
    assert len(cells) == len((EXAMPLES / SEEDED).read_text(encoding="utf-8").splitlines()) - 1
    for cell in cells:
        method, scene = table.methods.index(cell["method"]), table.scenes.index(cell["scene"])
        value = table.values[method, scene, table.seeds.index(str(cell["seed"]))]
        assert value == pytest.approx(cell["psnr"], abs=6e-5)


def test_the_page_names_the_metrics_that_are_known(tmp_path: Path) -> None:
    for name in re.findall(r"`(\w+)`", PAGE.split("better when lower; ")[1].split(" and names")[0]):
        rows = "".join(f"{scene},{method},1\n" for scene in "ab" for method in "xy")
        (tmp_path / "t.csv").write_text(f"scene,method,{name}\n{rows}")
        assert not read_table([tmp_path / "t.csv"]).higher_is_better
