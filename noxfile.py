"""nox -s benchmark · judge · view · film · conformance · evidence · stability · speed · gate · tests · tests_slow ·
commands · tests_thorough · fuzz · endurance · lint; uv makes their environments.
"""

import sys
import time

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv"
nox.options.reuse_existing_virtualenvs = True
nox.options.sessions = ["lint", "tests"]

PROJECT = nox.project.load_toml("pyproject.toml")


def install(session: nox.Session, *groups: str) -> None:
    """The pinned dependencies of the project and of the named groups."""
    extras = PROJECT["project"]["optional-dependencies"]
    asked = {"ray": {"ray", "--executor=ray"}, "tensorboard": {"--tensorboard"}}
    asked["parquet"] = {word for word in session.posargs if word.endswith(".parquet")}
    whole = session.name in ("commands", "tests", "tests_slow", "tests_thorough")
    wanted = [one for name, words in asked.items() if whole or words & set(session.posargs) for one in extras[name]]
    session.install(*PROJECT["project"]["dependencies"], *nox.project.dependency_groups(PROJECT, *groups), *wanted)


@nox.session
def benchmark(session: nox.Session) -> None:
    """Train the methods side by side and write the report: `python -m harness run --help`; `--with FOLDER`.

    FOLDER is a package of your own that has methods.
    """
    install(session)
    options = with_packages(session)
    # a diverged cell (3) is part of the result: the report is written, and says 3 in its turn
    session.run("python", "-m", "harness", "run", *options, success_codes=[0, 3])
    if not {"--dry-run", "--help", "-h"} & set(options):
        session.run("python", "-m", "reports", out_folder(options))


@nox.session
def judge(session: nox.Session) -> None:
    """Verdicts on anybody's table of results, without training; options as in `python -m harness judge --help`."""
    install(session)
    session.run("python", "-m", "harness", "judge", *session.posargs)


@nox.session
def conformance(session: nox.Session) -> None:
    """Hold methods to the contract of the catalogue, as `python -m harness conformance --help`; `--with FOLDER`."""
    install(session)
    session.run("python", "-m", "harness", "conformance", *with_packages(session))


@nox.session
def view(session: nox.Session) -> None:
    """Look at a finished run in the browser; options as in `python -m harness view --help`."""
    install(session)
    session.run("python", "-m", "harness", "view", *with_packages(session), success_codes=[0, 130])


@nox.session
def film(session: nox.Session) -> None:
    """A camera path through a finished run; options as in `python -m harness render --help`."""
    install(session)
    session.run("python", "-m", "harness", "render", *with_packages(session))


@nox.session
def evidence(session: nox.Session) -> None:
    """The studies that a verdict rests on; options as in `python -m harness evidence --help`."""
    measured(session, "evidence", not_for_a_report={"--list"})


@nox.session
def stability(session: nox.Session) -> None:
    """Try the catalogue of stiff and extreme cases; options as in `python -m harness stability --help`."""
    measured(session, "stability", not_for_a_report={"--list"})


@nox.session
def speed(session: nox.Session) -> None:
    """Measure how fast this machine trains and renders; options as in `python -m harness speed --help`."""
    measured(session, "speed")


def measured(session: nox.Session, command: str, not_for_a_report: set[str] | None = None) -> None:
    """A command that writes its figures to a folder, and the page about them."""
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
    """Hold this code to the reviewed limits in gates/; options as in `python -m harness gate --help`."""
    install(session)
    session.run("python", "-m", "harness", "gate", *session.posargs)


@nox.session
def tests(session: nox.Session) -> None:
    """The test suite without its slow part."""
    install(session, "test")
    session.run("pytest", "-n", "auto", *(session.posargs or ["-m", "not slow"]))


@nox.session
def tests_slow(session: nox.Session) -> None:
    """The slow part of the test suite: whole runs, browsers, measurements from end to end.

    The tests of a file share a process: what they start from takes long to make.
    """
    install(session, "test")
    share = ("-n", "auto", "--dist", "loadfile", "--no-loadscope-reorder")
    session.run("pytest", *share, "-m", "slow and not thorough and not cluster", *session.posargs)


@nox.session
def tests_thorough(session: nox.Session) -> None:
    """What takes minutes and seldom breaks: whole contracts, slow readers of the fuzzer, a Ray cluster.

    The cluster has a process of its own, as Ray leaves an event loop behind.
    """
    install(session, "test")
    session.run("pytest", "-n", "auto", "-m", "thorough and not cluster", *session.posargs)
    session.run("pytest", "-m", "cluster", *session.posargs)


@nox.session
def commands(session: nox.Session) -> None:
    """Every session and every command from end to end, each in its shortest form."""
    install(session, "test")
    session.run("python", "-m", "tests.every_command", sys.executable)


@nox.session
def fuzz(session: nox.Session) -> None:
    """Bad input by the thousand for everything that reads a file or an option; as in `python -m tests.fuzz --help`."""
    install(session, "test", "fuzz")
    session.run("python", "-m", "tests.fuzz", *session.posargs)


@nox.session
def endurance(session: nox.Session) -> None:
    """Kill runs a hundred times and damage what they wrote; options as in `python -m tests.endurance --help`."""
    install(session)
    session.run("python", "-m", "tests.endurance", *session.posargs, env={"OMP_NUM_THREADS": "1"})


@nox.session
def lint(session: nox.Session) -> None:
    """Style and types."""
    install(session, "lint")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("mypy")


def with_packages(session: nox.Session) -> list[str]:
    """The options without `--with FOLDER`; the packages in these folders are installed, as they stand there."""
    options, given = [], iter(session.posargs)
    for option in given:
        name, is_joined, value = option.partition("=")
        if name != "--with":
            options.append(option)
        elif folder := value if is_joined else next(given, ""):
            session.install("--editable", folder)
        else:
            session.error("--with: name the folder of a package (with its pyproject.toml)")
    return options


def out_folder(options: list[str]) -> str:
    """The folder that the run wrote: `--out`, else what `out/latest` names."""
    return given_out(options) or "out/latest"


def given_out(options: list[str]) -> str | None:
    """The value of `--out`."""
    for index, option in enumerate(options):
        if option == "--out" and index + 1 < len(options):
            return options[index + 1]
        if option.startswith("--out="):
            return option.removeprefix("--out=")
    return None
