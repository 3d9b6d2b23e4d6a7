"""nox -s SESSION -- OPTIONS: uv makes the environment, and `nox -s SESSION -- --help` explains the options."""

import argparse
import os
import re
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ["lint", "tests"]

PROJECT = nox.project.load_toml("pyproject.toml")
LOCKED = dict(re.findall(r"^([a-z0-9-]+)==(\S+)", Path("requirements.lock").read_text(encoding="utf-8"), re.MULTILINE))
SMALL = ("view", "film", "stability")
"""The extras of every environment: they are small, and commands of the README need them."""
OPTIONS = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
OPTIONS.add_argument("--with", dest="packages", action="append", default=[], metavar="FOLDER")
OPTIONS.add_argument("--out")


def install(session: nox.Session, *groups: str) -> None:
    """Install the project as an editable package, and the extras that the options need."""
    options = set(session.posargs)
    words = {"ray": {"ray", "--executor=ray"}, "tensorboard": {"--tensorboard"}}
    words["submitit"] = {"submitit", "--executor=submitit"}
    words["parquet"] = {option for option in options if option.endswith(".parquet")}
    takes_all = session.name in ("commands", "tests", "tests_thorough")
    needed = [*SMALL, *(name for name in words if takes_all or words[name] & options)]
    install_locked(session, *groups, extras=needed)
    session.install("--no-deps", "--editable", ".")


def install_locked(session: nox.Session, *groups: str, extras: Iterable[str]) -> None:
    """Install the dependencies of the project, of groups and of extras, in the versions of requirements.lock."""
    wanted = map(pinned, wanted_by(*groups, extras=extras))
    # other builds of torch have other hashes than that on PyPI
    locked = session.virtualenv.venv_backend == "uv" and not os.environ.get("UV_TORCH_BACKEND")
    session.install(*wanted, *(("--require-hashes", "--constraint", "requirements.lock") if locked else ()))


def wanted_by(*groups: str, extras: Iterable[str]) -> list[str]:
    """Return the requirements of the project, of groups and of extras."""
    optional = PROJECT["project"]["optional-dependencies"]
    of_extras = [package for name in extras for package in optional[name]]
    return [*PROJECT["project"]["dependencies"], *of_extras, *nox.project.dependency_groups(PROJECT, *groups)]


def pinned(requirement: str) -> str:
    name = re.split("[<>=]", requirement)[0]
    return f"{name}=={LOCKED[name.lower()]}"


@nox.session
def benchmark(session: nox.Session) -> None:
    """Train the methods side by side and write the report, from the first scores on."""
    harness(session, "run", "--page")


@nox.session
def judge(session: nox.Session) -> None:
    """Judge any table of results, without training."""
    harness(session, "judge")


@nox.session
def conformance(session: nox.Session) -> None:
    """Hold methods to the contract of the catalogue."""
    harness(session, "conformance")


@nox.session
def view(session: nox.Session) -> None:
    """View a finished run in the browser."""
    harness(session, "view", success_codes=(0, 130))


@nox.session
def film(session: nox.Session) -> None:
    """Render a camera path through a finished run."""
    harness(session, "render")


@nox.session
def evidence(session: nox.Session) -> None:
    """Measure what a verdict depends on."""
    report(session, "evidence")


@nox.session
def frontier(session: nox.Session) -> None:
    """Train one method of each family at budgets of core seconds: error against time."""
    report(session, "frontier")


@nox.session
def stability(session: nox.Session) -> None:
    """Try stiff and extreme cases, on formulas and in training."""
    report(session, "stability")


@nox.session
def speed(session: nox.Session) -> None:
    """Measure how fast this machine trains and renders."""
    report(session, "speed")


@nox.session
def gate(session: nox.Session) -> None:
    """Hold this code to the reviewed limits in gates/."""
    harness(session, "gate")


def harness(session: nox.Session, command: str, *more: str, success_codes: tuple[int, ...] = (0,)) -> None:
    """Run a command with the options of the session; each `--with FOLDER` is installed as an editable package."""
    install(session)
    given, options = OPTIONS.parse_known_args(session.posargs)
    for folder in given.packages:
        session.install("--editable", folder)
    out = ["--out", given.out] if given.out else []
    # after Ctrl-C, nox kills within half a second; a run needs some to write its record
    patience = {"interrupt_timeout": 5.0, "terminate_timeout": 5.0}
    session.run("python", "-m", "harness", command, *options, *out, *more, success_codes=success_codes, **patience)


def report(session: nox.Session, command: str) -> None:
    """Run a command that writes a folder, by default a fresh one, and write its page."""
    if {"--help", "-h", "--list", "--dry-run"} & set(session.posargs):
        harness(session, command)
        return
    out = OPTIONS.parse_known_args(session.posargs)[0].out
    fresh = f"out/{command}-{time.strftime('%Y%m%d-%H%M%S')}"
    # a cell that diverged or failed (3) is part of the result: the page is written, whose command returns 3 again
    harness(session, command, *([] if out else ["--out", fresh]), success_codes=(0, 3))
    session.run("python", "-m", "reports", out or fresh)


@nox.session
def tests(session: nox.Session) -> None:
    """Run the test suite; `-- -m "not slow"` leaves out complete runs, browsers and killed processes."""
    install(session, "test")
    # the tests of a file share a process, as their fixtures are slow
    share = ("-n", "auto", "--dist", "loadfile", "--no-loadscope-reorder")
    session.run("pytest", *share, *(session.posargs or ["-m", "not thorough and not cluster"]))


@nox.session
def tests_thorough(session: nox.Session) -> None:
    """Run tests that take minutes and seldom fail: complete contracts, a Ray cluster."""
    install(session, "test")
    # a path given may hold tests of one kind only: 5 is "no tests collected"
    ends = (0, 5) if session.posargs else (0,)
    session.run("pytest", "-n", "auto", "-m", "thorough and not cluster", *session.posargs, success_codes=ends)
    # in a separate process, as Ray leaves an event loop behind
    session.run("pytest", "-m", "cluster", *session.posargs, success_codes=ends)


@nox.session
def tests_oldest(session: nox.Session) -> None:
    """Run the tests with the oldest packages that pyproject.toml allows."""
    session.install("--resolution", "lowest-direct", *wanted_by("test", extras=(*SMALL, "parquet", "tensorboard")))
    session.run("pytest", "-n", "auto", "-m", "not slow", *session.posargs)


@nox.session
def commands(session: nox.Session) -> None:
    """Run every session and every command end to end, each in its shortest form."""
    install(session, "test")
    session.run("python", "-m", "tools.every_command", sys.executable)


@nox.session
def installed(session: nox.Session) -> None:
    """Install the project as `pip install .` does, and use it in a folder with packages of its names."""
    install_locked(session, extras=())
    session.install("--no-deps", "--force-reinstall", ".")
    table = Path("docs/examples/own-seeds.csv").resolve()
    short = ("--profile", "smoke", "--scenes", "lego", "--methods", "nerf", "--seeds", "1", "--budget-steps", "4")
    with tempfile.TemporaryDirectory() as folder, session.chdir(folder):
        for name in ("scenes", "baselines", "harness", "reports"):
            Path(name).mkdir()
            Path(name, "__init__.py").write_text("raise SystemExit('a foreign package was imported')\n")
        session.run("radiance-verdict", "judge", str(table), "--out", "judged")
        session.run("radiance-verdict", "run", *short, "--resolution", "16", "--out", "run", "--view-sets", "sets")
        session.run("radiance-verdict", "report", "run")


@nox.session
def fuzz(session: nox.Session) -> None:
    """Try thousands of bad inputs on everything that reads a file or an option."""
    install(session, "test")
    campaign = ("-n", "auto", "--timeout", "0", "--hypothesis-profile", "fuzz")
    session.run("pytest", *campaign, "tests/fuzz", *session.posargs)


@nox.session
def endurance(session: nox.Session) -> None:
    """Kill runs a hundred times, damage their files, and compare the resumed results."""
    install(session)
    session.run("python", "-m", "tests.endurance", *session.posargs, env={"OMP_NUM_THREADS": "1"})


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and types."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")
