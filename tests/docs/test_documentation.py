"""The documentation: its commands parse, its links exist, its Python code runs on the records of a run."""

import re
import runpy
import shlex
import sys
from contextlib import nullcontext
from pathlib import Path
from statistics import fmean

import pandas as pd
import pytest

from harness.command.main import COMMANDS, STUDIES, parsed
from harness.records.cells import read_cells
from harness.records.json_record import write_json
from reports.data.load import read_records
from reports.run.saving.publish import summary
from tests.harness.shell import ROOT
from tests.reports.fake_run import write_fake_run
from tools.every_command import blocks

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
SESSIONS = set(re.findall(r"^@nox\.session\ndef (\w+)", (ROOT / "noxfile.py").read_text(encoding="utf-8"), re.M))
THROUGH = {"benchmark": "run", "film": "render"}
"""Session → the command whose options it takes, if their names differ."""


def commands(page: Path) -> list[str]:
    """Return the commands of this program in blocks of code, without comments and line breaks."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line.removeprefix("    ").removeprefix("- run: ") for line in text.splitlines()]
    matches = (re.search(r"(?:^|&& |^\s*- run: )((?:python -m harness|nox -s) .*)$", line) for line in lines)
    return [match.group(1).partition(" # ")[0].strip() for match in matches if match]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_parse(page: Path) -> None:
    for command in commands(page):
        words = shlex.split(command.partition(" && ")[0].partition(" | ")[0])
        if words[0] == "nox":
            names = words[2 : words.index("--")] if "--" in words else words[2:]
            assert set(names) <= SESSIONS, command
            given = words[words.index("--") + 1 :] if "--" in words else []
            if not given or names[0] in ("tests", "lint"):
                continue
            for place in [place for place, word in enumerate(given) if word == "--with"][::-1]:
                del given[place : place + 2]
            words = [THROUGH.get(names[0], names[0]), *given]
        else:
            words = words[3:]
        with pytest.raises(SystemExit) if "--help" in words else nullcontext() as stop:
            parsed(words)
        assert stop is None or stop.value.code == 0, command


def test_every_session_and_command_is_run_from_end_to_end() -> None:
    typed = [line.split() for block in blocks("here") for line in block]
    in_ci = re.findall(r"(?:beside|-s) (\w+)", (ROOT / ".ci" / "run").read_text(encoding="utf-8"))
    sessions = {words[2] for words in typed if words[0] == "nox"}
    assert sessions | set(in_ci) == SESSIONS
    run = {THROUGH.get(name, name) for name in sessions}
    run |= {words[3 + (words[3] == "study")] for words in typed if words[2] == "harness"}
    assert {*COMMANDS, *STUDIES} - {"study"} <= run
    assert "python -m harness study conformance nerf qnerf" in commands(ROOT / "docs" / "add-a-method.md")
    assert len(COMMANDS) <= 13, "a newcomer can read the list"


ELSEWHERE = {
    ("harness run", "--ray-address"): "tests of the cluster",
    ("harness run", "--with"): "tests of a package, which is installed",
    ("harness conformance", "--with"): "tests of a package, which is installed",
    ("harness run", "--lpips"): "its tests, with weights that they make",
    ("harness frontier", "--long"): "more than a night; its plan is tested",
    ("harness gate", "--renew"): "half an hour",
    ("harness constants", "--adopt"): "its tests, into a copy of the file",
    ("harness constants", "--device"): "tests of a GPU",
    ("harness lint", ""): "CI",
    ("harness tests", ""): "CI",
}
"""Documented options that `nox -s commands` does not type → what tests them."""


def options_of(command: str) -> set[tuple[str, str]]:
    """Return the command with each of its options."""
    words = shlex.split(re.split(r" && | [|] | → ", command)[0])
    if words[0] == "nox":
        names, _, given = " ".join(words[2:]).partition(" -- ")
        name, given = f"harness {THROUGH.get(names.split()[0], names.split()[0])}", given.split()
    elif words[2] == "reports":
        name, given = "reports", words[3:]
    else:
        place = 3 + (words[3:4] == ["study"])
        words += [""] * (place + 1 - len(words))
        name, given = f"{words[2]} {words[place]}", words[place + 1 :]
    return {(name, ""), *((name, word.partition("=")[0]) for word in given if word.startswith("--"))}


def test_every_documented_option_is_typed() -> None:
    typed = {each for block in blocks("here") for line in block for each in options_of(line)}
    kinds = r"(?:python -m (?:harness|reports|scenes)|nox -s) "
    for page in [page for page in PAGES if page.name != "CHANGELOG.md"]:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        lines = [line.strip().removeprefix("- run: ").partition(" # ")[0] for line in text.splitlines()]
        for command in [*filter(re.compile(kinds).match, lines), *re.findall(rf"`({kinds}[^`]+)`", text)]:
            missing = options_of(command) - typed - set(ELSEWHERE)
            assert not {each for each in missing if each[0] != "harness NAME"}, f"{page.name}: {command}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)\)", text):
        if not target.startswith(("http:", "https:", "mailto:")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_with_commands_of_python_says_in_which_environment(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"\. \.nox/(\w+)/bin/activate", text)
    assert set(named) <= SESSIONS
    if re.search(r"^ +python -m ", text, re.M):
        assert named or "on every node" in text


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fake_run(tmp_path_factory.mktemp("docs") / "run", pictures=False)


def test_the_python_of_the_records_page_gives_a_row_per_cell(run: Path) -> None:
    write_json(run / "summary.json", summary(read_records(run)))
    text = (ROOT / "docs" / "records.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    names: dict[str, pd.DataFrame] = {}
    cells = list(read_cells(run))
    scores = {cell.scores["psnr"] for cell in cells if cell.scores.get("psnr")}
    of_summary, of_cells, of_comparisons = (block.replace("out/latest", str(run)) for block in blocks)
    exec(of_summary, names)
    assert len(names["cells"]) == len(cells)
    assert set(names["cells"].psnr.dropna()) == scores
    exec(of_cells, names)
    assert set(names["cells"]["scores.psnr"].dropna()) == scores
    assert len(names["curves"]) == sum(len(cell.curve) for cell in cells)
    exec(of_comparisons, names)
    assert {"method", "against", "difference", "verdict"} <= set(names["comparisons"].columns)


def analyse(monkeypatch: pytest.MonkeyPatch, *words: Path) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(sys, "argv", ["analyse.py", *map(str, words)])
    runpy.run_path(str(ROOT / "docs" / "examples" / "analyse.py"), run_name="__main__")


@pytest.mark.slow
def test_the_example_makes_its_table_and_its_figure(run: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    analyse(monkeypatch, run, tmp_path)
    printed = capsys.readouterr().out
    scores = [cell.scores["psnr"] or 0.0 for cell in read_cells(run) if (cell.scene, cell.method) == ("chair", "nerf")]
    assert f"{fmean(scores):.2f}" in next(line for line in printed.splitlines() if line.startswith("chair"))
    assert (tmp_path / "curves.png").stat().st_size > 5000


def test_the_example_says_what_is_missing(tmp_path: Path, monkeypatch, capsys) -> None:
    with pytest.raises(SystemExit, match="2"):
        analyse(monkeypatch)
    assert "required: OUT" in capsys.readouterr().err
    cell = {"scene": "chair", "method": "nerf", "seed": 0, "status": "error", "scores": {}, "curve": []}
    write_json(tmp_path / "records" / "cells" / "chair.nerf.0.json", cell)
    with pytest.raises(SystemExit, match=r"none of its 1 cells has a score \(error\)"):
        analyse(monkeypatch, tmp_path)


def test_nothing_of_this_machine_and_no_registry_is_named() -> None:
    for page in [*PAGES, ROOT / ".pre-commit-config.yaml", *(ROOT / "docs" / "examples").rglob("*.py")]:
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"/home/\w+|https?://\S*/simple\b|index-url", text), page
