"""nox -s SESSION -- OPTIONS: uv makes the environment, and `nox -s SESSION -- --help` explains the options."""

import sys
import time

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ["lint", "tests"]

PROJECT = nox.project.load_toml("pyproject.toml")


def install(session: nox.Session, *groups: str) -> None:
    """Install the pinned dependencies of the project and of the named groups, and the extras that the options need."""
    extras = PROJECT["project"]["optional-dependencies"]
    options = set(session.posargs)
    words = {"ray": {"ray", "--executor=ray"}, "tensorboard": {"--tensorboard"}}
    words["parquet"] = {option for option in options if option.endswith(".parquet")}
    takes_all = session.name in ("commands", "tests", "tests_slow", "tests_thorough")
    needed = [package for name in words if takes_all or words[name] & options for package in extras[name]]
    session.install(*PROJECT["project"]["dependencies"], *nox.project.dependency_groups(PROJECT, *groups), *needed)


@nox.session
def benchmark(session: nox.Session) -> None:
    """Train the methods side by side and write the report."""
    install(session)
    options = with_packages(session)
    # a diverged cell (3) is part of the result: the report is written, and says 3 in its turn
    session.run("python", "-m", "harness", "run", *options, success_codes=[0, 3])
    if not {"--dry-run", "--help", "-h"} & set(options):
        session.run("python", "-m", "reports", out_folder(options))


@nox.session
def judge(session: nox.Session) -> None:
    """Judge anybody's table of results, without training."""
    install(session)
    session.run("python", "-m", "harness", "judge", *session.posargs)


@nox.session
def conformance(session: nox.Session) -> None:
    """Hold methods to the contract of the catalogue."""
    install(session)
    session.run("python", "-m", "harness", "conformance", *with_packages(session))


@nox.session
def view(session: nox.Session) -> None:
    """Look at a finished run in the browser."""
    install(session)
    session.run("python", "-m", "harness", "view", *with_packages(session), success_codes=[0, 130])


@nox.session
def film(session: nox.Session) -> None:
    """Render a camera path through a finished run."""
    install(session)
    session.run("python", "-m", "harness", "render", *with_packages(session))


@nox.session
def evidence(session: nox.Session) -> None:
    """Run the studies that a verdict rests on."""
    measure(session, "evidence", not_for_a_report={"--list"})


@nox.session
def stability(session: nox.Session) -> None:
    """Try stiff and extreme cases, on formulas and in training."""
    measure(session, "stability", not_for_a_report={"--list"})


@nox.session
def speed(session: nox.Session) -> None:
    """Measure how fast this machine trains and renders."""
    measure(session, "speed")


def measure(session: nox.Session, command: str, not_for_a_report: set[str] | None = None) -> None:
    """Run a command that measures into a folder, and write the page about it."""
    install(session)
    if {"--help", "-h", *(not_for_a_report or ())} & set(session.posargs):
        session.run("python", "-m", "harness", command, *session.posargs)
        return
    out = given_out(session.posargs)
    fresh = [] if out else ["--out", f"out/{command}-{time.strftime('%Y%m%d-%H%M%S')}"]
    # what failed (3) is part of the result: the page is written, and says 3 in its turn
    session.run("python", "-m", "harness", command, *session.posargs, *fresh, success_codes=[0, 3])
    session.run("python", "-m", "reports", out or fresh[1])


@nox.session
def gate(session: nox.Session) -> None:
    """Hold this code to the reviewed limits in gates/."""
    install(session)
    session.run("python", "-m", "harness", "gate", *session.posargs)


@nox.session
def tests(session: nox.Session) -> None:
    """Run the test suite without its slow part."""
    install(session, "test")
    session.run("pytest", "-n", "auto", *(session.posargs or ["-m", "not slow"]))


@nox.session
def tests_slow(session: nox.Session) -> None:
    """Run the slow tests: whole runs, browsers, processes that are killed."""
    install(session, "test")
    # the tests of a file share a process: what they start from takes long to make
    share = ("-n", "auto", "--dist", "loadfile", "--no-loadscope-reorder")
    session.run("pytest", *share, "-m", "slow and not thorough and not cluster", *session.posargs)


@nox.session
def tests_thorough(session: nox.Session) -> None:
    """Run what takes minutes and seldom breaks: whole contracts, a Ray cluster."""
    install(session, "test")
    session.run("pytest", "-n", "auto", "-m", "thorough and not cluster", *session.posargs)
    # a process of its own: Ray leaves an event loop behind
    session.run("pytest", "-m", "cluster", *session.posargs)


@nox.session
def commands(session: nox.Session) -> None:
    """Run every session and every command from end to end, each in its shortest form."""
    install(session, "test")
    session.run("python", "-m", "tests.every_command", sys.executable)


@nox.session
def fuzz(session: nox.Session) -> None:
    """Try bad input by the thousand on everything that reads a file or an option."""
    install(session, "test", "fuzz")
    session.run("python", "-m", "tests.fuzz", *session.posargs)


@nox.session
def endurance(session: nox.Session) -> None:
    """Kill runs a hundred times, damage what they wrote, and compare what is resumed."""
    install(session)
    session.run("python", "-m", "tests.endurance", *session.posargs, env={"OMP_NUM_THREADS": "1"})


@nox.session
def lint(session: nox.Session) -> None:
    """Check style and types."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


def with_packages(session: nox.Session) -> list[str]:
    """Install the package of each `--with FOLDER` as it stands there, and return the other options."""
    options, words = [], iter(session.posargs)
    for option in words:
        name, is_joined, value = option.partition("=")
        if name != "--with":
            options.append(option)
        elif folder := value if is_joined else next(words, ""):
            session.install("--editable", folder)
        else:
            session.error("--with: name the folder of a package (with its pyproject.toml)")
    return options


def out_folder(options: list[str]) -> str:
    """Return the folder that the run wrote: `--out`, else what `out/latest` names."""
    return given_out(options) or "out/latest"


def given_out(options: list[str]) -> str | None:
    """Return the value of `--out`."""
    for index, option in enumerate(options):
        if option == "--out" and index + 1 < len(options):
            return options[index + 1]
        if option.startswith("--out="):
            return option.removeprefix("--out=")
    return None
