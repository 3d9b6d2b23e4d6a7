"""Commands with a Python that has none of the pinned packages."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from scenes.files.installed import packages_needed
from tests.harness.shell import ROOT

FULL = Path("/dev/full")


def bare(*command: str) -> subprocess.CompletedProcess[str]:
    """Run `python -m COMMAND` without the folder of installed packages."""
    words = [sys.executable, "-S", "-m", *command]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, env={"PATH": ""})


@pytest.mark.parametrize("command", ["harness judge a.csv", "reports out", "scenes export A --format npz --out B"])
def test_a_missing_package_is_one_line_that_names_the_environment(command: str) -> None:
    ended = bare(*command.split())
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith(f"error: {sys.executable} has no package ")
    assert ". .nox/benchmark/bin/activate" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_every_package_is_locked_by_version_and_hash_and_by_no_address() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    assert "://" not in text
    entries = re.split(r"\n(?=[a-z0-9])", text)[1:]
    locked = {entry.partition("==")[0]: entry.partition("==")[2].split()[0] for entry in entries}
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry) for entry in entries)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups = [*project["project"]["optional-dependencies"].values(), *project["dependency-groups"].values()]
    for text in [*project["project"]["dependencies"], *(entry for group in groups for entry in group)]:
        wanted = Requirement(text)
        assert wanted.specifier.contains(locked[wanted.name.lower()]), f"renew requirements.lock: {text}"


@pytest.mark.parametrize("package", ["harness", "reports", "scenes"])
def test_help_needs_no_package(package: str) -> None:
    assert bare(package, "--help").returncode == 0


def test_doctor_needs_no_package() -> None:
    ended = bare("harness", "doctor")
    assert ended.returncode == 2
    assert ended.stderr == ""
    assert ended.stdout.splitlines()[-1].startswith("missing, and needed: torch, ")


@pytest.mark.parametrize("bug", [ModuleNotFoundError("No module", name="harness.nowhere"), BrokenPipeError()])
def test_a_missing_own_module_and_another_broken_pipe_are_reported_as_bugs(bug: Exception) -> None:
    with pytest.raises(type(bug)), packages_needed():
        raise bug


@pytest.mark.parametrize("command", ["harness gate --list", "reports --help"])
def test_a_closed_pipe_behind_standard_output_is_not_an_error(command: str) -> None:
    reads, writes = os.pipe()
    os.close(reads)
    words = [sys.executable, "-m", *command.split()]
    ended = subprocess.run(words, cwd=ROOT, stdout=writes, stderr=subprocess.PIPE, text=True)
    os.close(writes)
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize("streams", [">&-", "2>&-", ">&- 2>&-"])
def test_a_closed_stream_stops_no_command(streams: str) -> None:
    script = f"{sys.executable} -m harness gate --list {streams}"
    ended = subprocess.run(["sh", "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == 0
    assert "Traceback" not in ended.stdout + ended.stderr


def test_an_encoding_without_greek_letters_stops_no_command() -> None:
    words = [sys.executable, "-m", "harness", "run", "--help"]
    script = "from scenes.files.standard_output import go_on_unheard; go_on_unheard(); print('φ', chr(0xdc80), '×')"
    for encoding, expected in (("ascii", b"\\u03c6 \\udc80 \\xd7"), ("utf-8:strict", "φ \\udc80 ×".encode())):
        surroundings = {**os.environ, "PYTHONIOENCODING": encoding}
        said = subprocess.run([sys.executable, "-c", script], cwd=ROOT, env=surroundings, capture_output=True)
        assert said.stdout.strip() == expected
        assert subprocess.run(words, cwd=ROOT, env=surroundings, capture_output=True).returncode == 0


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full")
def test_a_full_disk_behind_standard_output_is_named() -> None:
    with FULL.open("w") as full:
        words = [sys.executable, "-m", "harness", "gate", "--list"]
        ended = subprocess.run(words, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.stderr.startswith("error: standard output: ")
    assert ended.stderr.count("\n") == 1


@pytest.mark.parametrize(("package", "foreign"), [("harness", "scenes"), ("reports", "baselines")])
def test_a_package_in_this_folder_that_hides_one_of_ours_is_named(package: str, foreign: str, tmp_path: Path) -> None:
    (tmp_path / foreign).mkdir()
    (tmp_path / foreign / "__init__.py").touch()
    words = [sys.executable, "-m", package, "--help"]
    surroundings = {**os.environ, "PYTHONPATH": str(ROOT)}
    ended = subprocess.run(words, cwd=tmp_path, env=surroundings, capture_output=True, text=True)
    assert ended.returncode == 2, ended.stderr
    assert ended.stderr.startswith(f"error: {tmp_path / foreign / '__init__.py'}: is not the package `{foreign}`")
    assert ended.stderr.count("\n") == 1
