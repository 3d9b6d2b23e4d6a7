"""Every measured number of README.md and docs agrees with the published data, to the last printed digit."""

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest

from harness.records.json_record import plain
from harness.records.study import Answer, Table, check, read_studies
from harness.records.verdict import OPEN, Verdict
from tests.harness.shell import ROOT
from tests.reports.fake_studies import fake_studies, study, write_fake_studies
from tools.published.__main__ import BLOCKS, MARKED, block, main, pages, rewritten
from tools.published.replicates import replicate
from tools.published.run_blocks import DUELS

ELSEWHERE = {
    "judge.md": "tests/docs/test_judge_page.py",
    "gate-your-ci.md": "tests/harness/gate",
}
"""Pages whose numbers have other tests."""
PAGES = [page for page in pages(ROOT) if page.name not in ELSEWHERE]
NOT_MEASURED = {
    "README.md": ("arXiv 2512.12683 and 2601.05250", "Python 3.11"),
    "full-setting.md": ("36 dB for training", "40 dB for test"),
    "cluster.md": ("Python 3.11", "Ray 2.60.0"),
    "findings.md": ("95 % interval",),
    "read-the-report.md": ("95 % interval", "± 0.2 dB"),
    "add-a-scene.md": ("4.03 units", "0.01 or larger", "1.36 units", "1.4 units"),
    "images.md": ("±1.5, cut", "1 GiB unpacked"),
}
"""Settings, versions, limits, confidence and figures of others: the only numbers outside of blocks."""
CODE_AND_LINKS = (r"```.*?```", r"(?m:^    [^\n]*$)", r"`[^`]*`", r"\]\([^)]*\)", r"https?://\S+")
UNITS = r"dB|%|m?s|seconds?|min|minutes?|h|hours?|days?|years?|times|[GM]i?B"
MEASURED = re.compile(rf"\d\s?(?:{UNITS})(?!\w)|\d\s?×(?!\s?\d)|\d+ of (?:the |all )?\d+|\d\.\d+")


def outside_of_blocks(text: str) -> str:
    for pattern in (MARKED, *(re.compile(pattern, re.DOTALL) for pattern in CODE_AND_LINKS)):
        text = pattern.sub(" ", text)
    return text


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_blocks_are_what_the_data_give(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == rewritten(text, ROOT / "docs"), "python -m tools.published"
    assert text.count("<!-- numbers:") == len(MARKED.findall(text)) == text.count("<!-- end -->")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_measured_number_stands_outside_of_a_block(page: Path) -> None:
    text = outside_of_blocks(page.read_text(encoding="utf-8"))
    for known in NOT_MEASURED.get(page.name, ()):
        assert known in text, f"{known}: no longer on the page; take it from the list"
        text = text.replace(known, "")
    assert not (numbers := MEASURED.findall(text)), f"{numbers}: put them into a block of published.py"


def test_the_readme_is_short_and_begins_with_a_command() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    before, command, _ = text.partition("\n    python -m pip")
    assert command
    assert len(before.split()) <= 120
    assert len(text.split()) <= 700


@pytest.mark.parametrize(
    "text", ["1.6 times", "25 to 50 ×", "0 of 60", "7.3 dB", "88 %", "14 minutes", "0.95 GB", "+0.51", "210 of the 211"]
)
def test_a_measured_number_is_known_by_its_look(text: str) -> None:
    assert MEASURED.search(text)
    assert not MEASURED.search("8 × 256, 100 × 100 px, 200 000 steps, exit code 3, §8, eight scenes")


PUBLISHED_RUN = ROOT / "docs" / "reduced" / "summary.json"


def written(docs: Path, name: str, data: dict[str, Any]) -> Path:
    (docs / name).parent.mkdir(parents=True, exist_ok=True)
    (docs / name).write_text(json.dumps(data), encoding="utf-8")
    return docs


def changed(
    docs: Path, change: Callable[[dict[str, Any]], None] = lambda data: None, name: str = "reduced/summary.json"
) -> Path:
    """Write the default run with a change, and return the folder."""
    data = json.loads(PUBLISHED_RUN.read_text(encoding="utf-8"))
    change(data)
    return written(docs, name, data)


def test_what_is_not_published_is_not_told(tmp_path: Path) -> None:
    published = changed(tmp_path)
    needed = {name: {file for file in files if file[-1] != "?"} for name, (files, _) in BLOCKS.items()}
    of_the_run = {name for name, files in needed.items() if files == {"reduced/summary.json"}}
    assert {name for name in BLOCKS if block(name, published)} == of_the_run


BOTH = [Verdict("above 0", "open"), Verdict("below 0", "matters"), Verdict("open", "smaller than matters"), OPEN]


@pytest.mark.parametrize("verdict", BOTH, ids=lambda verdict: verdict.phrase)
def test_the_words_follow_the_verdict(tmp_path: Path, verdict: Verdict) -> None:
    def judged(data: dict[str, Any]) -> None:
        for row in data["comparisons"]:
            row["verdict"] = row["on_these_scenes"]["verdict"] = plain(verdict)

    rows = [line for line in block("result", changed(tmp_path, judged)).splitlines() if line.startswith("| `")]
    assert rows
    words = {verdict.phrase, "too few seeds for a verdict" if verdict == OPEN else verdict.phrase}
    assert all(row.split(" | ")[2].rpartition(": ")[2] in words for row in rows)


PUBLISHED = 0.137


def with_replicates(folder: Path, published: Verdict, replicates: Sequence[Verdict], differences: list[float]) -> Path:
    """Write the default run with one verdict for every pair over all scenes in both senses, and two replicates."""

    def judge(data: dict[str, Any], verdict: Verdict, difference: float) -> None:
        words = plain(verdict)
        for row in data["comparisons"]:
            if row["scene"] == "all" and row["metric"] == "psnr":
                row["difference"] = difference
                row["verdict"] = row["scenes_like_these"]["verdict"] = row["on_these_scenes"]["verdict"] = words

    runs = []
    for verdict, difference in zip(replicates, differences, strict=True):
        data = json.loads(PUBLISHED_RUN.read_text(encoding="utf-8"))
        judge(data, verdict, difference)
        runs.append(replicate(data))
    default = changed(folder, lambda data: judge(data, published, PUBLISHED))
    return written(default, "reduced/replicates.json", {"runs": runs})


SETTINGS = json.loads(PUBLISHED_RUN.read_text(encoding="utf-8"))["settings"]
STEPS, DUELISTS = SETTINGS["budget"]["steps"], SETTINGS["methods"]
PAIRS = [pair for pair in DUELS if set(pair) <= set(DUELISTS)]
"""The pairs of methods that the published run trained."""
ABOVE = Verdict("above 0", "open")
SMALL = Verdict("above 0", "smaller than matters")


@pytest.mark.parametrize(
    ("replicates", "differences", "spread"),
    [
        ((ABOVE, ABOVE), [0.12, 0.144], ""),
        ((ABOVE, SMALL), [0.12, 0.144], ""),
        ((SMALL, OPEN), [0.12, 0.144], "+0.12 to +0.14 dB in three runs"),
        ((OPEN, OPEN), [0.12, 0.144], "+0.12 to +0.14 dB in three runs"),
        # the published run is one of those compared, and is counted once
        ((ABOVE, OPEN), [PUBLISHED, 0.144], "+0.14 dB in two runs"),
    ],
)
def test_a_published_word_that_replicates_do_not_repeat_is_not_printed(
    replicates: tuple[Verdict, Verdict], differences: list[float], spread: str, tmp_path: Path
) -> None:
    docs = with_replicates(tmp_path, ABOVE, replicates, differences)
    text = block("result", docs)
    cell = f"; {spread}: sign and size open |" if spread else ": above 0, size open |"
    for table in (text, block("equal time", docs).partition("\n\n")[0]):
        rows = [line for line in table.splitlines() if " − " in line and line.startswith("|")]
        assert len(rows) == len(PAIRS)
        assert all(line.endswith(cell) and line.count(cell.removesuffix(" |")) == 2 for line in rows), "in both senses"
    favourites = "Neither qnerf nor qnerf_repaired is" if "qnerf_repaired" in DUELISTS else "qnerf is not"
    title = f"**{favourites} shown to differ" if spread else "**qnerf gains"
    assert text.removeprefix("The paper prints +1.5 dB on average: **not seen at this scale**. ").startswith(title)


def test_the_command_rewrites_what_is_out_of_date(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "environment.json").write_text('{"bytes": 2.5e9, "bytes_for_gpus": 1e9}')
    page = tmp_path / "README.md"
    page.write_text("It is large.\n\n<!-- numbers: environment -->\n9 GB\n<!-- end -->\n")
    assert main(tmp_path) == 0
    assert "takes 2.5 GB, 1.0 GB of it" in page.read_text()
    assert "9 GB" not in page.read_text()
    assert capsys.readouterr().out == f"{page}\n"
    assert main(tmp_path) == 0
    assert capsys.readouterr().out == ""
    page.write_text(page.read_text().replace("environment", "nonsense"))
    with pytest.raises(KeyError, match="nonsense"):
        main(tmp_path)


def test_stability_serving_and_what_is_left_out_are_counted() -> None:
    docs = ROOT / "docs"
    ours = [row.status for _, row in read_studies(docs / "stability.json").checks() if row.must_hold]
    passed, failed = ours.count("pass"), ours.count("fail")
    words = f" of {passed + failed} checks of our code with a verdict, {passed} pass and {failed} fail"
    assert words in block("stability", docs)
    latency = read_studies(docs / "reduced/serving.json").study("latency")
    (table,) = latency.tables
    stale = sum(bool(row[2]) for row in table.rows)
    assert f"another picture in {stale} of {len(table.rows)} kinds" in block("serving", docs)
    first = json.loads((docs / "left_out.json").read_text(encoding="utf-8"))["omissions"][0]
    row = next(line for line in block("left out", docs).splitlines() if first["scene"] in line)
    assert f"{first['difference']:+.2f} [{first['interval'][0]:+.2f}, " in row.replace("−", "-")
    assert first["verdict"] in row


def test_the_evidence_names_what_does_not_hold(tmp_path: Path) -> None:
    checks = [check("share of x", 0.5, 0.0, 1.0), check("share of y", 2.0, 0.0, 1.0)]
    answers = [Answer("It is, by 0.31 dB."), Answer("And more.")]
    record = fake_studies("evidence", studies=[study("one", "Is it so?", *answers, *checks)])
    write_fake_studies(tmp_path / "reduced", record)
    told = "* **Is it so?** It is, by 0.31 dB.\n\n1 of 2 checks hold; not: share of y (Is it so?)."
    assert block("evidence", tmp_path).startswith(f"{told}\n\n![")


def test_the_frontier_is_told_by_its_means_and_answers(tmp_path: Path) -> None:
    machine = {"cores": 2, "processor": "some processor"}
    means = Table("over_scenes", 0, "t", ["family", "4 core s"], [["nerf", "21.35"]])
    rows = [[name, "4", "21.35", f"{22.35 + 2 * place:.2f}", "30.10"] for place, name in enumerate("ab")]
    by_scene = Table("by_scene", 0, "t", ["scene", "core s", "nerf", "planes", "splats"], rows)
    front = study("front", "Who is ahead", Answer("splats is best, 30.10 dB."), Answer("It wins."), seconds=120.0)
    scores = study("error_against_time", "Error", means, by_scene)
    write_fake_studies(tmp_path / "frontier", fake_studies("frontier", provenance=machine, studies=[front, scores]))
    text = block("frontier", tmp_path)
    assert "| nerf | 21.35 |" in text
    assert "* **Who is ahead.** splats is best, 30.10 dB." in text
    assert "Measured on 2 cores (some processor)." in text
    near = "At 4 core seconds planes is not distinguished from splats."
    leaders = f"splats is best, 30.10 dB. It wins. {near} 2 scenes, 1 seed, some processor: "
    assert block("leaders", tmp_path).startswith(leaders), "nerf is 8.75 dB behind on both scenes"


def test_longer_budgets_are_told_with_their_scale(tmp_path: Path) -> None:
    amount = {"scenes": list("ab"), "seeds": [0], "resolution": 100, "large_scenes": ["a"], "large_resolution": 400}
    for file, name, mean in (("late", "Error", "31.24"), ("large", "Larger", "34.10")):
        means = Table("over_scenes", 0, "t", ["family", "240 core s"], [["splats", mean]])
        machine = {"cores": 2, "processor": "some processor"}
        settings = {"amount": amount}
        record = fake_studies("frontier", provenance=machine, settings=settings, studies=[study(file, name, means)])
        write_fake_studies(tmp_path / "frontier", record)
        (tmp_path / "frontier/frontier.json").rename(tmp_path / f"frontier/{file}.json")
    text = block("longer", tmp_path)
    assert "Error:\n\n| family | 240 core s |" in text
    assert "| splats | 31.24 |" in text
    assert "| splats | 34.10 |" in text
    assert (
        "2 scenes of 100 pixels, 1 seed; 1 scene of 400 pixels, 1 seed. Measured on 2 cores (some processor)." in text
    )


def test_another_processor_and_failed_runs_are_told(tmp_path: Path) -> None:
    processors = {
        "origins": {"instruction_set": [["AVX2"], ["AVX512"]]},
        "all": {"cells": 24, "rms": 0.296, "largest": -1.272},
    }
    published = written(with_replicates(tmp_path, ABOVE, [OPEN], [0.15]), "reduced/processors.json", processors)
    said = block("processors", published)
    assert "(here: instruction set AVX2 and AVX512)" in said
    assert "0.30 dB (RMS of 24; at most 1.27) (`python" in said, "older ones tell no changes"
    told = "*sign and size open* for `qnerf` − `nerf` (+0.14 to +0.15 dB in two runs, published as above 0, size open)"
    assert told in said
    like = {"simultaneous": [-0.03, 0.05], "verdict": {"sign": "open", "size": "smaller than matters"}}
    moved = {"difference": 0.01, "on_these_scenes": None, "scenes_like_these": like}
    processors["moved"] = [
        {"method": "qnerf", "against": "nerf", "budget": name, **moved} for name in ("steps", "seconds")
    ]
    written(tmp_path, "reduced/processors.json", processors)
    told = "at most 1.27), and the differences over all scenes by +0.01 dB (no sign is known of any) (`python"
    assert told in block("processors", published)
    like |= {"simultaneous": [0.03, 0.05], "verdict": {"sign": "above 0", "size": "smaller than matters"}}
    written(tmp_path, "reduced/processors.json", processors)
    told = "(with a sign: `qnerf` − `nerf` +0.01 dB (+0.03 to +0.05: above 0, smaller than matters)) (`python"
    assert told in block("processors", published)

    def lost(data: dict[str, Any]) -> None:
        data["failures"]["rates"][-1] |= {"diverged": 2, "collapsed": 1, "rate": 0.125, "interval": [0.027, 0.324]}

    text = block("failures", changed(tmp_path / "lost", lost))
    assert "in 3 of 24 runs (95 % interval 3 to 32 %)" in text


def test_what_the_last_doubling_brought_is_told_of_the_main_methods(tmp_path: Path) -> None:
    def with_gains(data: dict[str, Any]) -> None:
        data["last_doubling"] = [
            {"method": name, "gain": 1.234, "interval": [1.0, 1.5], "cells": 24} for name in ("nerf", "another")
        ]
        for cell in data["cells"]:
            cell["train_core_seconds"] = 21.4

    told = block("last doubling", changed(tmp_path, with_gains))
    assert told == (
        "The last doubling of the steps brought `nerf` +1.23 dB (+1.00 to +1.50). "
        "A cell of `nerf` takes 21 core seconds of training."
    )


def test_twice_the_steps_are_told_over_the_scenes_and_seeds_that_both_runs_have(tmp_path: Path) -> None:
    def at(steps: int, nerf: float, qnerf: float, scenes: tuple[str, ...] = ()) -> Callable[[dict[str, Any]], None]:
        def change(data: dict[str, Any]) -> None:
            data["settings"]["budget"]["steps"] = steps
            data["last_doubling"] = [{"method": one, "gain": 3.0, "interval": [2.0, 4.0]} for one in ("nerf", "qnerf")]
            cells = [cell for cell in data["cells"] if cell["scene"] in scenes or not scenes]
            data["cells"] = [cell for cell in cells if cell["seed"] == 0 or not scenes]
            for cell in data["cells"]:
                cell["psnr"] = {"nerf": nerf, "qnerf": qnerf}.get(cell["method"])

        return change

    docs = changed(tmp_path, at(1000, 28.0, 29.0))
    changed(docs, at(500, 27.0, 27.5, ("lego", "mic")), "reduced/halved.json")
    rows = [line.strip("| ").split(" | ") for line in block("twice the steps", docs).splitlines()]
    del rows[1]
    last = "+3.00 dB, +2.00 to +4.00"
    always = "{0} dB, {0} to {0}"
    expected = ["+1.00", last, "+1.50", last, "+0.50", "+1.00"]
    assert rows[0][1] == "500 and 1000 steps; 2 scenes, 1 seed"
    assert [row[1] for row in rows[1:]] == [text if text == last else always.format(text) for text in expected]

    def other_constants(data: dict[str, Any]) -> None:
        data["settings"]["train"]["own"]["nerf"]["density_scale"] *= 2.0

    changed(docs, other_constants, "reduced/summary.json")
    assert block("twice the steps", docs) == ""


def beside_the_default_run(tmp_path: Path, change: Callable[[dict[str, Any]], None]) -> list[str]:
    changed(changed(tmp_path), change, "converged/summary.json")
    return block("late verdict", tmp_path).splitlines()


def test_a_late_verdict_stands_beside_the_early_one(tmp_path: Path) -> None:
    def later(data: dict[str, Any]) -> None:
        data["settings"]["budget"]["steps"] = 4000
        data["settings"]["train"]["optimiser"]["name"] = "adam"
        for duel in data["comparisons"]:
            if (duel["scene"], duel["method"], duel["against"]) == ("all", "nerf_matched", "nerf"):
                duel["scenes_like_these"]["verdict"] = {"sign": "below 0", "size": "open"}
        for cell in data["cells"]:
            cell["psnr"], cell["train_core_seconds"] = 31.5 + cell["seed"], 200.0

    told = beside_the_default_run(tmp_path, later)
    assert f"{STEPS} steps of 512 rays, SOAP | 4000 steps of 512 rays, Adam" in told[0]
    rows = {line.split(" | ")[0]: line.split(" | ") for line in told[2:]}
    early, late = rows["| `nerf`, mean of 8 scenes"][1:]
    published = json.loads(PUBLISHED_RUN.read_text(encoding="utf-8"))
    psnr = [cell["psnr"] for cell in published["cells"] if cell["method"] == "nerf"]
    assert (early.split()[0], late) == (f"{fmean(psnr):.2f}", "32.50 dB, 200 core s |")
    duels = [line for line in told if line.startswith("| `nerf_matched` − `nerf`")]
    early, late = duels[0].split(" | ")[1:]
    assert ": above 0, " in early
    assert late.endswith("below 0, size open |")
    assert len(told) == 2 + len(DUELISTS) * 2 + len(PAIRS) + 2 + (1 + 2 + len(PAIRS)) + 2
    # later all methods score the same, so that the change is minus the early lead
    ahead = duels[0].split(" | ")[1].split()[0]
    assert duels[1].startswith(f"| `nerf_matched` − `nerf` | {ahead.replace('+', '−')} dB | ")
    assert ": below 0, " in duels[1]
    assert duels[1].endswith(" | 8 of 8 scenes |")


def test_a_run_of_some_scenes_is_compared_on_each(tmp_path: Path) -> None:
    def fewer(data: dict[str, Any]) -> None:
        data["scenes"] = [scene for scene in data["scenes"] if scene["scene"] in ("mic", "lego")]

    told = beside_the_default_run(tmp_path, fewer)
    of_lego = [line.split(" | ")[0] for line in told[2 : 2 + len(DUELISTS)]]
    assert of_lego == [f"| `{name}` on lego" for name in DUELISTS]
    assert sum(" − " in line.split(" | ")[0] for line in told) == 2 * len(PAIRS) + len(PAIRS)
    assert not any("last doubling" in line for line in told)


def test_no_published_omission_costs_more_and_leaving_out_empty_space_may_cost_nothing() -> None:
    """This is the sentence above the table of what is left out."""
    rows = json.loads((ROOT / "docs" / "left_out.json").read_text(encoding="utf-8"))["omissions"]
    assert not [row for row in rows if row["verdict"] == "costs more"]
    assert len({row["scene"] for row in rows}) == 8
    empty = [row for row in rows if row["name"] == "empty_space"]
    assert all(row["interval"][0] < 0 < row["interval"][1] for row in empty)
    others = [row["seconds_saved"] for row in rows if row["clock"] == empty[0]["clock"] and row not in empty]
    assert min(row["seconds_saved"] for row in empty) > max(others)
